//! Slice files that are far larger than their pixels: refused, or included in the memory estimate of the job.

use pinstack::{
    contract::{
        Code,
        request::{JobRequest, StackRequest, Upload},
    },
    jobs::memory::memory_need,
};
use pinstack_science::{
    archive::{self, ArchiveLimits, StackArchive},
    imaging::Slices,
};

use crate::{
    peak::peak_of,
    targets::pictures::png,
    zips::{Member, deflated, zip},
};

const MB: usize = 1 << 20;

/// A PNG of 320 x 240 px followed by `megabytes` of zeros.
fn padded_png(name: &str, megabytes: usize) -> Member {
    deflated(name, |out| {
        out.write_all(&png(320, 240, 3)).expect("written");
        (0..megabytes).for_each(|_| out.write_all(&[0; MB]).expect("written"));
    })
}

/// A JPEG with `megabytes` of comments between its scans.
fn commented_jpeg(name: &str, megabytes: usize) -> Member {
    let sound = include_bytes!("../../science/src/imaging/codec/testdata/progressive.jpg");
    let last = sound.windows(2).rposition(|two| two == [0xFF, 0xDA]).expect("a scan");
    let comment = [&[0xFF, 0xFE, 0xFF, 0xFF][..], &[b'x'; 65_533]].concat();
    deflated(name, |out| {
        out.write_all(&sound[..last]).expect("written");
        (0..16 * megabytes).for_each(|_| out.write_all(&comment).expect("written"));
        out.write_all(&sound[last..]).expect("written");
    })
}

fn open(members: &[Member]) -> Result<StackArchive, pinstack::contract::Fault> {
    archive::open_in_memory(zip(members), &ArchiveLimits::default()).map_err(pinstack::contract::Fault::from)
}

/// The estimated memory of a stack of these slices with one thread, bytes.
fn need(archive: &StackArchive, largest_file_bytes: u64) -> u64 {
    let mut layout = archive.layout().clone();
    layout.largest_file_bytes = largest_file_bytes;
    let upload = Upload { key: String::new(), bytes: 0, sha256: String::new(), filename: None };
    let (options, profile_digest) = (Default::default(), String::new());
    memory_need(
        &JobRequest::Stack(StackRequest {
            options,
            profile_revision: 1,
            profile_digest,
            profile_optics_digest: None,
            upload,
            layout,
            rerun_of: None,
        }),
        1,
    )
}

#[test]
fn files_far_larger_than_their_pixels_are_refused_by_name() {
    let members = [padded_png("a.png", 1), padded_png("b.png", 400)];
    let packed: usize = members.iter().map(|member| member.data.len()).sum();
    assert!(packed < 2 * MB, "400 MB in {packed} bytes");
    let (outcome, peak) = peak_of(|| open(&members).map(|_| ()));
    let fault = outcome.expect_err("a picture of 77 thousand pixels");
    assert_eq!(fault.code, Code::ArchiveTooLarge);
    assert!(fault.detail.starts_with("b.png has 4"), "{}", fault.detail);
    assert!(peak < 8 * MB, "{peak} bytes to refuse it");
}

#[test]
fn the_memory_estimate_includes_the_files() {
    for member in [padded_png, commented_jpeg] {
        let archive =
            open(&[member("a", 60), member("b", 60)].map(|m| Member { name: m.name + ".jpg", ..m })).expect("sound");
        let largest = archive.layout().largest_file_bytes;
        assert!(largest > 60 * MB as u64, "{largest}");
        let counted = need(&archive, largest) - need(&archive, 0);
        let (loaded, peak) = peak_of(|| archive.front().load(0).map(|_| ()));
        loaded.expect("a sound picture");
        assert!(peak as u64 <= counted + 2 * MB as u64, "{peak} bytes held, {counted} counted");
    }
}
