//! Zips and manifests.

use pinstack::contract::Code;
use pinstack_science::{
    archive::{self, StackArchive},
    imaging::{Slices, codec},
};

use super::{limits, pictures::png, refused_with};

/// Codes with which a zip may be refused.
pub(super) const REFUSALS: [Code; 6] = [
    Code::InvalidArchive,
    Code::UnsupportedArchive,
    Code::ArchiveTooLarge,
    Code::InvalidImage,
    Code::SizeMismatch,
    Code::SliceCountMismatch,
];

/// Maximum number of slices decoded per zip.
const DECODED: usize = 4;

/// A complete zip: directory, names, order, headers, members.
pub fn archive(bytes: &[u8]) {
    match archive::open_in_memory(bytes.to_vec(), &limits()) {
        Ok(archive) => judge(&archive),
        Err(fault) => refused_with(&fault.clone().into(), &REFUSALS),
    }
}

/// The manifest of a valid zip.
pub fn manifest(bytes: &[u8]) {
    let picture = || png(2, 2, 1);
    let names = ["front/a1.png", "front/a2.png", "back/b1.png", "back/b2.png"];
    let members = names.map(|name| (name.to_owned(), picture()));
    let mut zip = std::io::Cursor::new(Vec::new());
    let manifest = ("manifest.json".to_owned(), bytes.to_vec());
    archive::pack(&mut zip, members.into_iter().chain([manifest])).expect("a zip");
    match archive::open_in_memory(zip.into_inner(), &limits()) {
        Ok(archive) => {
            let mut found = [archive.layout().front.clone(), archive.layout().back.clone()].concat();
            found.sort();
            let mut all = names.map(str::to_owned).to_vec();
            all.sort();
            assert_eq!(found, all, "a manifest loses no slice and doubles none");
            judge(&archive);
        }
        Err(fault) => refused_with(&fault.clone().into(), &[Code::InvalidArchive, Code::SliceCountMismatch]),
    }
}

fn judge(archive: &StackArchive) {
    let layout = archive.layout();
    assert!(layout.front.len() >= 2 && (layout.back.is_empty() || layout.back.len() == layout.front.len()));
    assert!(u64::from(layout.width) * u64::from(layout.height) <= limits().image.max_pixels);
    for name in layout.front.iter().chain(&layout.back) {
        assert!(!name.starts_with('/') && name.split('/').all(|part| !["", ".", ".."].contains(&part)), "{name:?}");
    }
    for slices in [archive.front(), archive.back()] {
        for index in 0..slices.count().min(DECODED) {
            match slices.load(index) {
                Ok(raster) => {
                    assert_eq!((raster.width, raster.height), (layout.width as usize, layout.height as usize));
                }
                Err(fault) => {
                    refused_with(&fault.clone().into(), &REFUSALS);
                    assert!(fault.locations.iter().any(|place| place.file.is_some()), "{} names no file", fault.detail);
                }
            }
        }
    }
    if let Ok(bytes) = archive.front_bytes(0) {
        let _ = codec::metadata(&bytes).for_output(layout.width, layout.height, &codec::OutputCamera::default());
    }
}
