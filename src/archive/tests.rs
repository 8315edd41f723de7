//! Every rule of the archive, on zips made byte by byte, so that they can be as wrong as they like.

use std::io::{Cursor, Write};

use super::*;
use crate::imaging::{Raster, Slices, codec::Metadata};

/// One member, with everything that can be said wrongly about it.
#[derive(Clone)]
struct Entry {
    name: Vec<u8>,
    data: Vec<u8>,
    method: u16,
    flags: u16,
    crc: Option<u32>,
    /// Size unpacked, as declared.
    size: Option<u32>,
    /// Unix mode.
    mode: u32,
    /// Take the local header of this earlier entry.
    same_as: Option<usize>,
}

fn entry(name: &str, data: &[u8]) -> Entry {
    Entry {
        name: name.as_bytes().to_vec(),
        data: data.to_vec(),
        method: 0,
        flags: 0,
        crc: None,
        size: None,
        mode: 0o100_644,
        same_as: None,
    }
}

/// The entry compressed by deflate in stored blocks, which are the same in deflate64.
fn deflated(mut entry: Entry, method: u16) -> Entry {
    entry.crc = entry.crc.or(Some(crc32(&entry.data)));
    entry.size = entry.size.or(Some(entry.data.len() as u32));
    let blocks: Vec<&[u8]> = entry.data.chunks(60_000).collect();
    let mut out = Vec::new();
    for (i, block) in blocks.iter().enumerate() {
        out.push(u8::from(i + 1 == blocks.len()));
        out.extend((block.len() as u16).to_le_bytes());
        out.extend((!(block.len() as u16)).to_le_bytes());
        out.extend(*block);
    }
    entry.data = out;
    entry.method = method;
    entry
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

fn zip(entries: &[Entry]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut offsets = Vec::new();
    let fields = |e: &Entry| {
        let mut f = Vec::new();
        f.extend(20u16.to_le_bytes());
        f.extend(e.flags.to_le_bytes());
        f.extend(e.method.to_le_bytes());
        f.extend([0, 0, 0x21, 0]);
        f.extend(e.crc.unwrap_or_else(|| crc32(&e.data)).to_le_bytes());
        f.extend((e.data.len() as u32).to_le_bytes());
        f.extend(e.size.unwrap_or(e.data.len() as u32).to_le_bytes());
        f.extend((e.name.len() as u16).to_le_bytes());
        f.extend([0, 0]);
        f
    };
    for e in entries {
        if let Some(earlier) = e.same_as {
            offsets.push(offsets[earlier]);
            continue;
        }
        offsets.push(out.len() as u32);
        out.extend(b"PK\x03\x04");
        out.extend(fields(e));
        out.extend(&e.name);
        out.extend(&e.data);
    }
    let directory = out.len() as u32;
    for (e, offset) in entries.iter().zip(&offsets) {
        out.extend(b"PK\x01\x02");
        out.extend([20, 3]);
        out.extend(fields(e));
        out.extend([0; 6]);
        out.extend((e.mode << 16).to_le_bytes());
        out.extend(offset.to_le_bytes());
        out.extend(&e.name);
    }
    let size = out.len() as u32 - directory;
    out.extend(b"PK\x05\x06\0\0\0\0");
    out.extend((entries.len() as u16).to_le_bytes());
    out.extend((entries.len() as u16).to_le_bytes());
    out.extend(size.to_le_bytes());
    out.extend(directory.to_le_bytes());
    out.extend([0, 0]);
    out
}

fn open_bytes(bytes: &[u8]) -> Result<StackArchive, Fault> {
    open_within(bytes, &ArchiveLimits::default())
}

fn open_within(bytes: &[u8], limits: &ArchiveLimits) -> Result<StackArchive, Fault> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    // the open file outlives its name
    open(file.path(), limits)
}

fn refused(entries: &[Entry]) -> Fault {
    match open_bytes(&zip(entries)) {
        Ok(archive) => panic!("was not refused: {:?}", archive.layout()),
        Err(fault) => fault,
    }
}

/// A picture of 20 x 16 px, different for every `seed`.
fn raster(seed: u8) -> Raster {
    sized(20, 16, seed)
}

fn sized(width: usize, height: usize, seed: u8) -> Raster {
    Raster::eight(width, height, 1, (0..width * height).map(|i| (i as u8).wrapping_mul(3).wrapping_add(seed)).collect())
}

fn png(seed: u8) -> Vec<u8> {
    png_of(&raster(seed), &Metadata::default())
}

fn png_of(raster: &Raster, metadata: &Metadata) -> Vec<u8> {
    let mut out = Vec::new();
    codec::encode_png(&mut out, raster, metadata).unwrap();
    out
}

/// Pictures under these names, picture `i` with seed `i`.
fn pictures(names: &[&str]) -> Vec<Entry> {
    names.iter().enumerate().map(|(i, name)| entry(name, &png(i as u8))).collect()
}

fn opened(names: &[&str]) -> StackArchive {
    open_bytes(&zip(&pictures(names))).unwrap()
}

#[test]
fn slices_come_in_natural_order_with_their_own_pixels() {
    let archive = opened(&["front/img_10.png", "front/img_2.png", "back/b10.png", "back/b9.png", "front/", "back/"]);
    let layout = archive.layout();
    assert_eq!(layout.front, ["front/img_2.png", "front/img_10.png"]);
    assert_eq!(layout.back, ["back/b9.png", "back/b10.png"]);
    assert_eq!((layout.width, layout.height, layout.bit_depth, layout.channels), (20, 16, 8, 1));
    assert_eq!(archive.warnings(), []);
    assert_eq!(archive.front().count(), 2);
    assert_eq!(archive.front().load(0).unwrap(), raster(1));
    assert_eq!(archive.front().load(1).unwrap(), raster(0));
    assert_eq!(archive.back().load(0).unwrap(), raster(3));
    assert_eq!(archive.front_bytes(1).unwrap(), png(0));
    assert_eq!(archive.front().load(2).unwrap_err().code, Code::Internal);
}

#[test]
fn slices_can_be_loaded_from_several_threads_at_once() {
    let archive = opened(&["a.png", "b.png", "c.png", "d.png"]);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let front = archive.front();
            scope.spawn(move || {
                for round in 0..8 {
                    let index = (thread + round) % 4;
                    assert_eq!(front.load(index).unwrap(), raster(index as u8));
                }
            });
        }
    });
}

#[test]
fn pictures_in_the_root_are_front_light_and_folders_around_everything_are_looked_through() {
    for names in [
        ["a.png", "b.png"],
        ["Stack 7/a.png", "Stack 7/b.png"],
        ["2024/käfer/FrontLight/a.png", "2024/käfer/FrontLight/b.png"],
        ["x/front/session/a.png", "x/front/session/b.png"],
        ["front\\a.png", "front\\b.png"],
    ] {
        let archive = opened(&names);
        assert_eq!(archive.layout().front, names.map(|name| name.replace('\\', "/")));
        assert!(archive.layout().back.is_empty());
        assert_eq!(archive.warnings(), []);
    }
    let archive = opened(&["w/a.png", "w/b.png", "w/Back_Light/1.png", "w/Back_Light/2.png"]);
    assert_eq!(archive.layout().front, ["w/a.png", "w/b.png"]);
    assert_eq!(archive.layout().back, ["w/Back_Light/1.png", "w/Back_Light/2.png"]);
    let archive = opened(&["fg/a.png", "fg/b.png", "bg/a.png", "bg/b.png"]);
    assert_eq!((archive.layout().front.len(), archive.layout().back.len()), (2, 2));
}

#[test]
fn rubbish_of_operating_systems_is_passed_over_and_other_files_are_named() {
    let mut entries = pictures(&["front/a.png", "front/b.png"]);
    for rubbish in ["__MACOSX/front/._a.png", ".DS_Store", "front/Thumbs.db", "desktop.ini", "front/._b.png"] {
        entries.push(entry(rubbish, b"x"));
    }
    assert_eq!(open_bytes(&zip(&entries)).unwrap().warnings(), []);
    entries.push(entry("notes.txt", b"hello"));
    entries.push(entry("front/a.xmp", b"hello"));
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.warnings().len(), 1);
    assert_eq!(archive.warnings()[0].code, "files_passed_over");
    assert!(archive.warnings()[0].detail.contains("notes.txt, front/a.xmp"));
}

#[test]
fn what_is_no_zip_is_told_from_a_zip_that_ends_early() {
    let whole = zip(&pictures(&["a.png", "b.png"]));
    for (bytes, expected) in [
        (&b""[..], "empty"),
        (b"PK\x03\x04 and no more", "ends early"),
        (&whole[..whole.len() - 30], "ends early"),
        (b"7z\xBC\xAF\x27\x1C", "7z"),
        (b"hello world, no zip here", "not a zip"),
    ] {
        let fault = open_bytes(bytes).err().unwrap();
        assert_eq!(fault.code, Code::InvalidArchive);
        assert!(fault.detail.contains(expected), "{:?} lacks {expected:?}", fault.detail);
    }
}

#[test]
fn a_wrong_crc_names_the_member() {
    for make in [|e| e, |e| deflated(e, 8)] {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries[1].crc = Some(1);
        let entries: Vec<Entry> = entries.into_iter().map(make).collect();
        let fault = open_bytes(&zip(&entries)).and_then(|archive| archive.front().load(1)).unwrap_err();
        assert_eq!(fault.code, Code::InvalidArchive);
        assert!(fault.detail.contains("front/b.png"), "{}", fault.detail);
        assert_eq!(fault.places[0].file.as_deref(), Some("front/b.png"));
        assert_eq!(fault.places[0].slice, Some(1));
    }
}

#[test]
fn deflate_and_deflate64_are_read_and_other_methods_refused_by_name() {
    for method in [8, 9] {
        let entries: Vec<Entry> =
            pictures(&["a.png", "b.png"]).into_iter().map(|entry| deflated(entry, method)).collect();
        let archive = open_bytes(&zip(&entries)).unwrap();
        assert_eq!(archive.front().load(1).unwrap(), raster(1), "method {method}");
    }
    for (method, name) in [(12, "Bzip2"), (14, "Lzma"), (93, "Zstd"), (98, "Ppmd"), (77, "77")] {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries[0].method = method;
        let fault = refused(&entries);
        assert_eq!(fault.code, Code::UnsupportedArchive);
        assert!(fault.detail.contains(name) && fault.detail.contains("front/a.png"), "{}", fault.detail);
    }
}

#[test]
fn a_deflate64_zip_of_another_program_is_read() {
    let archive = open_bytes(include_bytes!("testdata/deflate64.zip")).unwrap();
    assert_eq!(archive.layout().front, ["img_1.tif", "img_2.tif"]);
    assert_eq!((archive.layout().width, archive.layout().height), (40, 30));
    let expected = (0..40 * 30).map(|i| ((i % 40 / 4 * 16 + i / 40 / 3 * 10 + 40) % 256) as u8).collect();
    assert_eq!(archive.front().load(1).unwrap(), Raster::eight(40, 30, 1, expected));
}

#[test]
fn encrypted_members_are_refused() {
    let mut entries = pictures(&["front/a.png", "front/b.png"]);
    entries[1].flags = 1;
    let fault = refused(&entries);
    assert_eq!(fault.code, Code::UnsupportedArchive);
    assert!(fault.detail.contains("front/b.png is encrypted"), "{}", fault.detail);
}

#[test]
fn hostile_names_are_refused() {
    for name in
        ["../a.png", "front/../../b.png", "/a.png", "C:\\a.png", "front/a\0.png", "..\\..\\a.png", "x/a\u{1b}[2J.png"]
    {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries.push(entry(name, &png(9)));
        assert_eq!(refused(&entries).code, Code::InvalidArchive, "{name:?}");
    }
    let mut entries = pictures(&["front/a.png", "front/b.png", "front/c.png"]);
    entries[2].mode = 0o120_777;
    let fault = refused(&entries);
    assert_eq!(fault.code, Code::InvalidArchive);
    assert!(fault.detail.contains("symbolic link"));
}

#[test]
fn duplicate_names_are_refused_also_when_only_case_or_slashes_differ() {
    for other in ["front/a.png", "Front/A.PNG", "front\\a.png", "./front/a.png"] {
        let mut entries = pictures(&["front/a.png", "front/b.png"]);
        entries.push(entry(other, &png(9)));
        assert_eq!(refused(&entries).code, Code::InvalidArchive, "{other}");
    }
}

#[test]
fn overlapping_members_are_refused() {
    let mut entries = pictures(&["front/a.png", "front/a.png"]);
    entries[1].name = b"front/b.png".to_vec();
    entries[1].data = entries[0].data.clone();
    entries[1].same_as = Some(0);
    let fault = refused(&entries);
    assert_eq!(fault.code, Code::InvalidArchive);
    assert!(fault.detail.contains("overlap"), "{}", fault.detail);
}

#[test]
fn limits_are_kept_and_a_member_that_is_larger_than_it_says_is_refused() {
    let bytes = zip(&pictures(&["a.png", "b.png", "c.png"]));
    let size = png(0).len() as u64;
    let defaults = ArchiveLimits::default();
    for limits in [
        ArchiveLimits { max_members: 2, ..defaults },
        ArchiveLimits { max_member_bytes: size / 2, ..defaults },
        ArchiveLimits { max_total_bytes: size * 2, ..defaults },
        ArchiveLimits { max_directory_bytes: 64, ..defaults },
    ] {
        let fault = open_within(&bytes, &limits).err().unwrap();
        assert_eq!(fault.code, Code::ArchiveTooLarge, "{limits:?}: {fault}");
    }
    let small = codec::Limits { max_pixels: 100, ..codec::Limits::default() };
    let fault = open_within(&bytes, &ArchiveLimits { image: small, ..defaults }).err().unwrap();
    assert_eq!(fault.code, Code::InvalidImage);

    let mut entries = pictures(&["a.png", "b.png"]);
    entries[1].size = Some(entries[1].data.len() as u32 - 9);
    entries[1] = deflated(entries[1].clone(), 8);
    let fault = open_bytes(&zip(&entries)).and_then(|archive| archive.front().load(1)).unwrap_err();
    assert_eq!(fault.code, Code::InvalidArchive, "{fault}");
}

#[test]
fn slices_that_are_no_pictures_are_refused_by_name() {
    for (name, data, expected) in [
        ("front/b.jpg", &b""[..], "empty (0 bytes)"),
        ("front/b.jpg", b"not a picture at all", "not a JPEG, PNG or TIFF"),
        ("front/b.heic", b"\0\0\0\x18ftypheic\0\0\0\0", "HEIC"),
        ("front/b.NEF", b"II*\0\x08\0\0\0", "16-bit TIFF"),
        ("front/b.tif", b"II*\0\x08\0\0\0", "ends before"),
    ] {
        let mut entries = pictures(&["front/a.png"]);
        entries.push(entry(name, data));
        let fault = refused(&entries);
        assert_eq!(fault.code, Code::InvalidImage);
        assert!(fault.detail.contains(name) && fault.detail.contains(expected), "{}", fault.detail);
    }
}

#[test]
fn raw_files_beside_their_pictures_are_passed_over() {
    let mut entries = pictures(&["front/IMG_1.png", "front/IMG_2.png"]);
    entries.push(entry("front/img_1.CR2", b"II*\0\x10\0\0\0CR"));
    entries.push(entry("front/IMG_2.cr2", b"II*\0\x10\0\0\0CR"));
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.front().count(), 2);
    assert_eq!(archive.warnings()[0].code, "raw_passed_over");
    assert!(archive.warnings()[0].detail.contains("front/img_1.CR2"));
}

#[test]
fn one_slice_in_two_formats_is_refused_because_it_would_count_twice() {
    let fault = refused(&pictures(&["front/a.png", "front/a.tif", "front/b.png"]));
    assert_eq!(fault.code, Code::InvalidArchive);
    assert!(fault.detail.contains("two formats"));
}

#[test]
fn folders_that_do_not_tell_the_light_are_refused() {
    for names in [
        &["front/a.png", "front/b.png", "c.png"][..],
        &["one/a.png", "two/b.png"],
        &["front/a.png", "front/b.png", "other/c.png"],
        &["front/1/a.png", "front/2/b.png"],
        &["a.png", "thumbs/a.png"],
    ] {
        assert_eq!(refused(&pictures(names)).code, Code::InvalidArchive, "{names:?}");
    }
}

#[test]
fn counts_that_do_not_fit_are_refused_with_both_counts() {
    let fault = refused(&pictures(&["front/a.png", "front/b.png", "back/a.png"]));
    assert_eq!(fault.code, Code::SliceCountMismatch);
    assert!(fault.detail.contains("2 front-light") && fault.detail.contains("1 back-light"), "{}", fault.detail);
    assert_eq!(refused(&pictures(&["a.png"])).code, Code::SliceCountMismatch);
    assert_eq!(refused(&pictures(&["back/a.png", "back/b.png"])).code, Code::SliceCountMismatch);
    assert_eq!(refused(&[entry("readme.txt", b"hello")]).code, Code::InvalidArchive);
}

#[test]
fn slices_of_another_size_are_named() {
    let mut entries = pictures(&["front/a.png", "front/b.png", "front/c.png"]);
    entries[1].data = png_of(&sized(16, 20, 1), &Metadata::default());
    let fault = refused(&entries);
    assert_eq!(fault.code, Code::SizeMismatch);
    assert!(fault.detail.contains("front/b.png (16 x 20 px)"), "{}", fault.detail);
    assert_eq!(fault.places[0].slice, Some(1));
}

#[test]
fn grey_back_light_under_coloured_front_light_is_nothing_to_warn_of_but_a_mix_within_one_light_is() {
    let colour = png_of(&Raster::eight(20, 16, 3, vec![7; 960]), &Metadata::default());
    let mut entries = pictures(&["front/a.png", "front/b.png", "back/a.png", "back/b.png"]);
    entries[0].data = colour.clone();
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.warnings()[0].code, "mixed_colour");
    entries[1].data = colour;
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.warnings(), []);
    assert_eq!(archive.layout().channels, 3);
}

#[test]
fn slices_that_lie_turned_are_refused_but_all_turned_alike_is_fine() {
    let turned = |orientation: u8| {
        let mut block = b"MM\0\x2A\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
        block.extend([orientation, 0, 0, 0, 0, 0, 0]);
        png_of(&raster(1), &Metadata { icc: None, exif: Some(block) })
    };
    let fault = refused(&[entry("a.png", &turned(1)), entry("b.png", &turned(3)), entry("c.png", &png(0))]);
    assert_eq!(fault.code, Code::InvalidImage);
    assert!(fault.detail.contains("b.png") && fault.detail.contains("automatic rotation"), "{}", fault.detail);

    let archive = open_bytes(&zip(&[entry("a.png", &turned(6)), entry("b.png", &turned(6))])).unwrap();
    assert_eq!((archive.layout().width, archive.layout().height), (16, 20));
    assert_eq!(archive.front().load(0).unwrap().width, 16);
}

#[test]
fn a_manifest_tells_the_order() {
    let mut entries = pictures(&["s/front/a.png", "s/front/b.png", "s/back/a.png", "s/back/b.png"]);
    let text = br#"{"front": ["b.png", "front/a.png"], "back": ["back\\b.png", "s/back/A.PNG"], "note": 1}"#;
    entries.push(entry("s/manifest.json", text));
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.layout().front, ["s/front/b.png", "s/front/a.png"]);
    assert_eq!(archive.layout().back, ["s/back/b.png", "s/back/a.png"]);
    assert_eq!(archive.warnings(), []);

    for text in [
        r#"{"front": ["a.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": ["a.png", "a.png", "b.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": ["a.png", "x.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": ["a.png", "../b.png"], "back": ["a.png", "b.png"]}"#,
        r#"{"front": "a.png"}"#,
        "front: a.png",
    ] {
        entries[4] = entry("s/manifest.json", text.as_bytes());
        assert_eq!(refused(&entries).code, Code::InvalidArchive, "{text}");
    }
    entries[4] = entry("manifest.json", br#"{"version": 3}"#);
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!(archive.warnings()[0].code, "manifest_passed_over");
}

#[test]
fn a_manifest_can_make_slices_of_any_folders() {
    let mut entries = pictures(&["one/a.png", "two/a.png"]);
    entries.push(entry("manifest.json", br#"{"front": ["two/a.png", "one/a.png"]}"#));
    assert_eq!(open_bytes(&zip(&entries)).unwrap().layout().front, ["two/a.png", "one/a.png"]);
}

#[test]
fn a_tiff_with_its_directory_at_the_end_is_probed_from_a_compressed_member() {
    let tiff = |seed| {
        let mut out = Cursor::new(Vec::new());
        codec::encode_tiff(&mut out, &sized(1800, 900, seed), &Metadata::default()).unwrap();
        out.into_inner()
    };
    let entries = [deflated(entry("a.tif", &tiff(0)), 8), deflated(entry("b.tif", &tiff(1)), 9)];
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert_eq!((archive.layout().width, archive.layout().height), (1800, 900));
    assert_eq!(archive.front().load(1).unwrap(), sized(1800, 900, 1));
}

#[test]
fn what_pack_writes_is_read_and_is_the_same_every_time() {
    let members = || [("front/a.png", 0), ("front/b.png", 1)].map(|(name, seed)| (name.to_owned(), png(seed)));
    let packed = || {
        let mut out = Cursor::new(Vec::new());
        pack(&mut out, members().into_iter()).unwrap();
        out.into_inner()
    };
    assert_eq!(packed(), packed());
    let archive = open_bytes(&packed()).unwrap();
    assert_eq!(archive.front().load(1).unwrap(), raster(1));
}

/// Opens and loads everything; whatever it is, it is an answer.
fn exercise(bytes: &[u8]) {
    let limits = ArchiveLimits {
        max_member_bytes: 1 << 20,
        max_total_bytes: 4 << 20,
        image: codec::Limits { max_pixels: 1 << 18, ..codec::Limits::default() },
        ..ArchiveLimits::default()
    };
    if let Ok(archive) = open_within(bytes, &limits) {
        for slices in [archive.front(), archive.back()] {
            for index in 0..slices.count() {
                let _ = slices.load(index);
            }
        }
    }
}

fn sound() -> Vec<u8> {
    let mut entries = pictures(&["w/front/a.png", "w/front/b.png", "w/back/a.png", "w/back/b.png"]);
    entries[1] = deflated(entries[1].clone(), 8);
    entries[2] = deflated(entries[2].clone(), 9);
    entries.push(entry("w/manifest.json", br#"{"front": ["a.png", "b.png"], "back": ["a.png", "b.png"]}"#));
    zip(&entries)
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_zips_never_panic(flips in proptest::collection::vec((0..100_000usize, 1..=255u8), 1..6), cut in 0..4000usize) {
        let mut bytes = sound();
        for (at, flip) in flips {
            let at = at % bytes.len();
            bytes[at] ^= flip;
        }
        if cut < 1000 {
            bytes.truncate(bytes.len() * cut / 1000);
        }
        exercise(&bytes);
    }

    #[test]
    fn damage_to_the_directory_never_panics(flips in proptest::collection::vec((0..600usize, 1..=255u8), 1..8)) {
        let mut bytes = sound();
        let length = bytes.len();
        for (back, flip) in flips {
            bytes[length - 1 - back % length] ^= flip;
        }
        exercise(&bytes);
    }

    #[test]
    fn random_bytes_never_panic(mut bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..400), tail: bool) {
        if tail {
            bytes.extend(b"PK\x05\x06\0\0\0\0\x02\0\x02\0");
            bytes.extend([40, 0, 0, 0, 1, 0, 0, 0, 0, 0]);
        }
        exercise(&bytes);
    }
}

#[test]
fn every_cut_of_a_sound_zip_is_refused() {
    let bytes = sound();
    assert!(open_bytes(&bytes).is_ok());
    for cut in 0..bytes.len() {
        assert!(open_bytes(&bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
    }
}
