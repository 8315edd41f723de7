//! The rules for archives.

mod container;
mod damage;
mod disk;
mod further_lights;
mod headers;
mod layout;
mod moved_target;
mod named_stack;
mod order;
mod sentences;
mod without_zip64;
mod zips;

use std::io::Write;

use super::*;
use crate::{
    imaging::{
        Raster, Slices,
        codec::{self, Metadata},
    },
    types::ErrorKind,
};
use zips::{Entry, deflated, entry, zip};

fn open_bytes(bytes: &[u8]) -> Result<StackArchive, Error> {
    open_within(bytes, &ArchiveLimits::default())
}

fn open_within(bytes: &[u8], limits: &ArchiveLimits) -> Result<StackArchive, Error> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    // the open file outlives its name
    open(file.path(), limits)
}

fn refused(entries: &[Entry]) -> Error {
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

/// A picture with the EXIF time of capture `10:00:{second}`.
fn taken_at(second: u8) -> Vec<u8> {
    use exif::{Field, In, Tag, Value};
    let text = format!("2026:05:01 10:00:{second:02}").into_bytes();
    let field = Field { tag: Tag::DateTimeOriginal, ifd_num: In::PRIMARY, value: Value::Ascii(vec![text]) };
    let mut writer = exif::experimental::Writer::new();
    writer.push_field(&field);
    let mut block = std::io::Cursor::new(Vec::new());
    writer.write(&mut block, true).unwrap();
    png_of(&raster(second), &Metadata { icc: None, exif: Some(block.into_inner()) })
}

#[test]
fn slices_that_were_not_taken_in_their_order_are_reported() {
    let times = |seconds: &[u8]| {
        let name = |i: usize| format!("s{i}.png");
        let entries: Vec<Entry> = (0..).zip(seconds).map(|(i, &second)| entry(&name(i), &taken_at(second))).collect();
        open_bytes(&zip(&entries)).unwrap().warnings().to_vec()
    };
    for in_order in [&[1, 2, 3, 4][..], &[4, 3, 2, 1], &[1, 1, 2, 2], &[3, 3, 3]] {
        assert_eq!(times(in_order), [], "{in_order:?}");
    }
    let found = times(&[1, 2, 4, 3, 5]);
    assert_eq!((found.len(), found[0].code.as_str()), (1, "order_contradicts_times"));
    assert!(found[0].detail.contains("s3.png was taken before s2.png"), "{}", found[0].detail);
    let found = times(&[5, 4, 2, 3, 1]);
    assert!(found[0].detail.contains("s2.png was taken before s3.png"), "{}", found[0].detail);
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
    assert_eq!(archive.front().load(2).unwrap_err().kind, ErrorKind::Internal);
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
        assert_eq!(fault.kind, ErrorKind::InvalidImage);
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
    assert_eq!(fault.kind, ErrorKind::InvalidArchive);
    assert!(fault.detail.contains("two formats"));
}

#[test]
fn counts_that_do_not_fit_are_refused_with_both_counts() {
    let fault = refused(&pictures(&["front/a.png", "front/b.png", "back/a.png"]));
    assert_eq!(fault.kind, ErrorKind::SliceCountMismatch);
    assert!(fault.detail.contains("2 front-light") && fault.detail.contains("1 back-light"), "{}", fault.detail);
    assert_eq!(refused(&pictures(&["a.png"])).kind, ErrorKind::SliceCountMismatch);
    assert_eq!(refused(&pictures(&["back/a.png", "back/b.png"])).kind, ErrorKind::SliceCountMismatch);
    assert_eq!(refused(&[entry("readme.txt", b"hello")]).kind, ErrorKind::InvalidArchive);
}

#[test]
fn slices_of_another_size_are_named() {
    let mut entries = pictures(&["front/a.png", "front/b.png", "front/c.png"]);
    entries[1].data = png_of(&sized(16, 20, 1), &Metadata::default());
    let fault = refused(&entries);
    assert_eq!(fault.kind, ErrorKind::SizeMismatch);
    assert!(fault.detail.contains("front/b.png (16 x 20 px)"), "{}", fault.detail);
    assert_eq!(fault.locations[0].slice, Some(1));
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
    assert_eq!(fault.kind, ErrorKind::InvalidImage);
    assert!(fault.detail.contains("b.png") && fault.detail.contains("automatic rotation"), "{}", fault.detail);

    let archive = open_bytes(&zip(&[entry("a.png", &turned(6)), entry("b.png", &turned(6))])).unwrap();
    assert_eq!((archive.layout().width, archive.layout().height), (16, 20));
    assert_eq!(archive.front().load(0).unwrap().width, 16);
}

#[test]
fn a_file_of_several_pages_is_named_before_slices_are_counted() {
    let mut out = std::io::Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
    for _ in 0..9 {
        encoder.write_image::<::tiff::encoder::colortype::Gray8>(4, 4, &[9; 16]).unwrap();
    }
    let fault = refused(&[entry("slice.tif", &out.into_inner())]);
    assert_eq!(fault.kind, ErrorKind::InvalidImage);
    assert!(fault.detail.contains("slice.tif") && fault.detail.contains("several pages"), "{}", fault.detail);
}

#[test]
fn names_in_an_unknown_code_page_are_kept_in_order_and_told() {
    let gbk = |digit: u8| [&b"\xC7\xD0\xC6\xAC"[..], &[digit], b".png"].concat();
    let mut entries = pictures(&["1", "2"]);
    (entries[0].name, entries[1].name) = (gbk(b'2'), gbk(b'1'));
    let archive = open_bytes(&zip(&entries)).unwrap();
    assert!(archive.layout().front[0].ends_with("1.png"));
    assert_eq!(archive.warnings()[0].code, "unclear_file_names");
    // letters of code page 437, and UTF-8 without its flag
    for name in [&b"K\x84fer"[..], "K\u{e4}fer".as_bytes()] {
        let with = |digit: u8| [name, &[digit], b".png"].concat();
        (entries[0].name, entries[1].name) = (with(b'1'), with(b'2'));
        let archive = open_bytes(&zip(&entries)).unwrap();
        assert_eq!((archive.warnings(), archive.layout().front[0].as_str()), (&[][..], "K\u{e4}fer1.png"));
    }
}

/// A grey TIFF whose directory follows its pixels.
fn late_tiff(width: u32, height: u32) -> Vec<u8> {
    let pixels = width * height;
    let mut out = [b"II*\0", &(8 + pixels).to_le_bytes()[..]].concat();
    out.extend((0..pixels).map(|i| (i * 7) as u8));
    let entries = [
        (256u16, width),
        (257, height),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, height),
        (279, pixels),
    ];
    out.extend((entries.len() as u16).to_le_bytes());
    for (tag, value) in entries {
        out.extend([&tag.to_le_bytes()[..], &[4, 0, 1, 0, 0, 0], &value.to_le_bytes()].concat());
    }
    out.extend([0; 4]);
    out
}

#[test]
fn a_quick_look_leaves_what_lies_deep_in_compressed_members_to_the_job() {
    let names = ["a.tif", "b.tif", "c.tif"];
    let entries: Vec<Entry> = names.iter().map(|name| deflated(entry(name, &late_tiff(2_048, 1_024)), 8)).collect();
    let mut broken = entries.clone();
    // the length of a block in the second megabyte of b.tif
    let block = 25 * 60_005 + 1;
    broken[1].data[block] ^= 0xFF;
    let near = |entries: &[Entry]| open_near(Arc::new(zip(entries)), &ArchiveLimits::default());
    let archive = near(&broken).unwrap();
    assert_eq!((archive.layout().width, archive.layout().height), (2_048, 1_024));
    assert!(archive.front().load(0).is_ok());
    assert_eq!(refused(&broken).locations[0].file.as_deref(), Some("b.tif"));
    // what is near is looked at as ever, and so are stored members
    let mut bad = entries.clone();
    bad[2] = deflated(entry("c.tif", b"no picture"), 8);
    assert_eq!(near(&bad).err().map(|fault| fault.kind), Some(ErrorKind::InvalidImage));
    let stored: Vec<Entry> = names.iter().map(|name| entry(name, &late_tiff(2_048, 1_024))).collect();
    let mut another = stored.clone();
    another[1] = entry("b.tif", &late_tiff(1_024, 2_048));
    assert!(near(&stored).is_ok());
    assert_eq!(near(&another).err().map(|fault| fault.kind), Some(ErrorKind::SizeMismatch));
}

#[test]
fn a_stack_can_be_reversed() {
    let archive = opened(&["front/a1.png", "front/a2.png", "back/b1.png", "back/b2.png"]).reversed();
    assert_eq!(archive.layout().front, ["front/a2.png", "front/a1.png"]);
    assert_eq!(archive.layout().back, ["back/b2.png", "back/b1.png"]);
    assert_eq!(archive.front().load(0).unwrap(), raster(1));
    assert_eq!(archive.front().name(1), "front/a1.png");
}
