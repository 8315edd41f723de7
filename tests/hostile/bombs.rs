//! Known decompression bombs. Each is refused with its code, within the memory that `docs/LIMITS.md` states.

use std::io::Cursor;

use pinstack::contract::{Code, Fault};
use pinstack_science::{
    archive::{self, ArchiveLimits, StackArchive},
    imaging::{
        Raster, Slices,
        codec::{self, Limits, Metadata},
    },
};

use crate::{
    peak::peak_of,
    targets::pictures::{pattern, png},
    zips::{Member, deflated, stored, zip},
};

pub const MB: usize = 1 << 20;

/// Memory that inspecting an upload may use besides the directory, bytes: segments and chunks before the pixels.
pub const HEADERS: usize = 72 * MB;

fn open(bytes: Vec<u8>) -> Result<StackArchive, Fault> {
    archive::open_in_memory(bytes, &ArchiveLimits::default()).map_err(Fault::from)
}

/// Opens a zip that must be refused; returns the code.
fn refused(what: &str, bytes: Vec<u8>, most: usize) -> Code {
    let length = bytes.len();
    let (outcome, peak) = peak_of(|| open(bytes).map(|archive| archive.layout().clone()));
    let fault = outcome.expect_err(what);
    assert!(peak <= most, "{what}: {peak} bytes for {length}, at most {most}: {}", fault.detail);
    fault.code
}

/// The same for a zip whose headers may be valid, so that only loading its first slice reveals the defect.
fn refused_or_not_loaded(bytes: Vec<u8>, most: usize) -> Code {
    let (outcome, peak) =
        peak_of(|| open(bytes).and_then(|archive| archive.front().load(0).map(|_| ()).map_err(Fault::from)));
    let fault = outcome.expect_err("a lie");
    assert!(peak <= most, "{peak} bytes, at most {most}: {}", fault.detail);
    fault.code
}

fn two_pictures() -> [Member; 2] {
    [stored("a.png", &png(4, 4, 1)), stored("b.png", &png(4, 4, 1))]
}

#[test]
fn members_that_share_their_bytes_are_refused() {
    let first = stored("0000.png", &vec![0; 100_000]);
    let others = (1..2_000).map(|i| Member { name: format!("{i:04}.png"), lies_at: Some(0), ..first.clone() });
    let members: Vec<Member> = std::iter::once(first.clone()).chain(others).collect();
    assert_eq!(refused("2,000 members in one place", zip(&members), 8 * MB), Code::InvalidArchive);
}

#[test]
fn zips_in_zips_are_never_opened() {
    let mut inner = zip(&two_pictures());
    for _ in 0..20 {
        inner = zip(&[stored("inner.zip", &inner)]);
    }
    let only = zip(&[stored("inner.zip", &inner)]);
    assert_eq!(refused("zips all the way down", only, MB), Code::InvalidArchive);

    let [a, b] = two_pictures();
    let beside = open(zip(&[a, b, stored("inner.zip", &inner)])).expect("a sound stack");
    assert!(beside.warnings().iter().any(|warning| warning.code == "files_passed_over"));
}

#[test]
fn wrong_sizes_are_refused_before_memory_is_allocated() {
    let small = |size: u64| Member { size, ..deflated("a.png", |out| out.write_all(&png(4, 4, 1)).expect("written")) };
    let [_, b] = two_pictures();
    let with = |member: Member| zip(&[member, b.clone()]);

    assert_eq!(refused("4 GB in 200 bytes", with(small(u64::from(u32::MAX) - 9)), MB), Code::ArchiveTooLarge);
    let zip64 = |unpacked, packed| Member { zip64: Some((unpacked, packed)), ..stored("a.png", &png(4, 4, 1)) };
    assert_eq!(refused("2^63 bytes", with(zip64(1 << 63, 80)), MB), Code::ArchiveTooLarge);
    assert_eq!(refused("packed beyond the file", with(zip64(1_000_000, 1 << 40)), MB), Code::InvalidArchive);
    let many: Vec<Member> = (0..70).map(|i| Member { name: format!("{i}.png"), ..small(1_000_000_000) }).collect();
    assert_eq!(refused("70 GB in all", zip(&many), MB), Code::ArchiveTooLarge);

    // within the limits, and still a lie: the header is sound, so the member itself tells
    assert_eq!(refused_or_not_loaded(with(small(60_000_000)), MB), Code::InvalidArchive);
    // and more than any picture of 16 pixels has
    assert_eq!(refused("900 MB for 4 x 4 px", with(small(900_000_000)), MB), Code::ArchiveTooLarge);
}

#[test]
fn members_larger_than_declared_are_read_to_their_declared_size() {
    let bomb = deflated("a.png", |out| {
        out.write_all(&png(4, 4, 1)).expect("written");
        (0..200).for_each(|_| out.write_all(&[0; MB]).expect("written"));
    });
    assert!(bomb.data.len() < MB, "200 MB in {} bytes", bomb.data.len());
    for size in [10, 3_000, 3_000_000] {
        let said = Member { size, ..bomb.clone() };
        let bytes = zip(&[said, stored("b.png", &png(4, 4, 1))]);
        assert_eq!(refused_or_not_loaded(bytes, 8 * MB), Code::InvalidArchive, "200 MB said to be {size} bytes");
    }
}

#[test]
fn oversized_or_inconsistent_directories_are_refused() {
    let many: Vec<Member> = (0..30_000).map(|i| stored(&format!("{i}"), b"")).collect();
    assert_eq!(refused("30,000 members", zip(&many), 64 * MB), Code::ArchiveTooLarge);

    // a zip64 end that speaks of 2^60 entries, of a directory of 2^60 bytes, of one behind the end
    for (entries, length, offset) in
        [(1_u64 << 60, 100_u64, 0_u64), (2, 1 << 60, 0), (2, 100, 1 << 60), (u64::MAX, u64::MAX, u64::MAX)]
    {
        let mut bytes = zip(&two_pictures());
        let end = bytes.split_off(bytes.len() - 22);
        let at = bytes.len() as u64;
        bytes.extend(b"PK\x06\x06");
        bytes.extend(44_u64.to_le_bytes());
        bytes.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        [entries, entries, length, offset].iter().for_each(|number| bytes.extend(number.to_le_bytes()));
        bytes.extend(b"PK\x06\x07\0\0\0\0");
        bytes.extend(at.to_le_bytes());
        bytes.extend([1, 0, 0, 0]);
        bytes.extend(&end[..8]);
        bytes.extend([0xFF; 12]);
        bytes.extend([0, 0]);
        let code = refused("a zip64 end of lies", bytes, MB);
        assert!([Code::InvalidArchive, Code::ArchiveTooLarge, Code::UnsupportedArchive].contains(&code), "{code:?}");
    }
}

#[test]
fn a_picture_bomb_is_refused_without_being_decompressed() {
    let zeros = deflated("a.png", |out| (0..300).for_each(|_| out.write_all(&[0; MB]).expect("written")));
    assert_eq!(refused("zeros", zip(&[zeros, stored("b.png", &png(4, 4, 1))]), 4 * MB), Code::InvalidImage);

    // segments before the picture that go on for ever: comments, and colour profiles, which are kept
    for marker in [0xFE, 0xE2] {
        let head = deflated("a.jpg", |out| {
            out.write_all(&[0xFF, 0xD8]).expect("written");
            let segment = [&[0xFF, marker, 0xFF, 0xFF][..], b"ICC_PROFILE\0\x01\x01", &[0; 65_519]].concat();
            (0..3_000).for_each(|_| out.write_all(&segment).expect("written"));
        });
        let bytes = zip(&[head, stored("b.png", &png(4, 4, 1))]);
        assert_eq!(refused("endless segments", bytes, HEADERS), Code::InvalidImage);
    }
}

#[test]
fn a_manifest_bomb_is_refused() {
    let [a, b] = two_pictures();
    let with = |manifest: &[u8]| zip(&[a.clone(), b.clone(), stored("manifest.json", manifest)]);
    assert_eq!(refused("nested lists", with("[".repeat(1_000_000).as_bytes()), 8 * MB), Code::InvalidArchive);
    let nested = format!("{{\"front\": {}", "[".repeat(1_000_000));
    assert_eq!(refused("nested lists", with(nested.as_bytes()), 8 * MB), Code::InvalidArchive);
    let many = format!("{{\"front\": [{}\"a.png\"]}}", "\"a.png\",".repeat(100_000));
    assert_eq!(refused("100,000 names", with(many.as_bytes()), 24 * MB), Code::InvalidArchive);
    assert_eq!(refused("larger than a list", with(&vec![b' '; 2 * MB]), 8 * MB), Code::InvalidArchive);
}

#[test]
fn valid_pictures_are_decoded_within_the_memory_budget_of_a_job() {
    const SIDE: usize = 512;
    let deep = |channels: usize| {
        // alpha is opaque
        let sample = |i: usize| if i % channels == 3 { u16::MAX } else { (i * 9_973 % 65_521) as u16 };
        Raster::sixteen(SIDE, SIDE, channels, (0..SIDE * SIDE * channels).map(sample).collect())
    };
    let opaque = Raster::eight(
        SIDE,
        SIDE,
        4,
        (0..SIDE * SIDE * 4).map(|i| if i % 4 == 3 { u8::MAX } else { (i * 7) as u8 }).collect(),
    );
    let tiff = |raster: &Raster| {
        let mut out = Cursor::new(Vec::new());
        codec::encode_tiff(&mut out, raster, &Metadata::default()).expect("a TIFF");
        out.into_inner()
    };
    let png_of_raster = |raster: &Raster| {
        let mut out = Vec::new();
        codec::encode_png(&mut out, raster, &Metadata::default()).expect("a PNG");
        out
    };
    let progressive = include_bytes!("testdata/progressive.jpg");
    for (what, bytes, sample) in [
        ("RGBA of 16 bits in a PNG", png_of_raster(&deep(4)), 2),
        ("RGBA of 16 bits in a TIFF", tiff(&deep(4)), 2),
        ("RGB of 16 bits in a TIFF", tiff(&deep(3)), 2),
        ("RGBA of 8 bits in a PNG", png_of_raster(&opaque), 1),
        ("a JPEG", codec::encode_jpeg(&pattern(SIDE, SIDE, 3), 95), 1),
        ("a progressive JPEG", progressive.to_vec(), 1),
    ] {
        let (raster, peak) = peak_of(|| codec::decode(&bytes, &Limits::default()).expect(what));
        // 9 bytes per pixel and byte of a sample, as `Plan::memory_bytes` has it for a slice in flight, beside the file
        let most = 9 * sample * raster.width * raster.height + 2 * bytes.len() + MB / 4;
        assert!(peak <= most, "{what}: {peak} bytes, at most {most}");
    }
}

#[test]
fn a_jpeg_is_decoded_from_its_own_memory() {
    const SIDE: usize = 2048;
    let file = codec::encode_jpeg(&pattern(SIDE, SIDE, 3), 100);
    assert!(file.len() > 2 * MB, "{} bytes", file.len());
    let mut bytes = Vec::with_capacity(file.len() + codec::JPEG_ROOM);
    bytes.extend_from_slice(&file);
    let samples = Vec::with_capacity(SIDE * SIDE * 3);
    let (raster, peak) = peak_of(|| codec::decode_into(bytes, &Limits::default(), samples).expect("a JPEG"));
    assert_eq!(Ok(raster), codec::decode(&file, &Limits::default()));
    assert!(peak < MB, "{peak} bytes beside the file and the samples");
}
