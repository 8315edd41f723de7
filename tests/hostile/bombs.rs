//! Known decompression bombs. Each is refused with its code, within the memory that `docs/OPERATIONS.md` states.

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
    zips::{Member, crc32, deflated, stored, zip},
};

const MB: usize = 1 << 20;

/// Memory that inspecting an upload may use besides the directory, bytes: segments and chunks before the pixels.
const HEADERS: usize = 72 * MB;

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

/// Checks that a picture is refused at its header or when it is decoded.
fn refused_picture(what: &str, bytes: &[u8], most: usize, sentence: &str) {
    let limits = Limits::default();
    let (_, peak) = peak_of(|| codec::probe(Cursor::new(bytes), &limits).is_ok());
    assert!(peak <= most.min(HEADERS), "{what}: {peak} bytes to read its header");
    let (outcome, peak) = peak_of(|| codec::decode(bytes, &limits).map(|_| ()));
    let told = outcome.expect_err(what).to_string();
    assert!(told.contains(sentence), "{what}: {told:?} does not say {sentence:?}");
    assert!(peak <= most, "{what}: {peak} bytes to decode {} ({told})", bytes.len());
    let (_, peak) = peak_of(|| codec::metadata(bytes).for_output(8, 8, &codec::OutputCamera::default()));
    assert!(peak <= HEADERS + 3 * bytes.len(), "{what}: {peak} bytes for its metadata");
}

fn jpeg_frame(process: u8, width: u16, height: u16, components: u8) -> Vec<u8> {
    let mut out = vec![0xFF, 0xD8, 0xFF, process, 0, 8 + 3 * components, 8];
    out.extend(height.to_be_bytes());
    out.extend(width.to_be_bytes());
    out.push(components);
    (1..=components).for_each(|component| out.extend([component, 0x11, 0]));
    out
}

fn jpeg_scan(components: u8) -> Vec<u8> {
    let mut out = vec![0xFF, 0xDA, 0, 6 + 2 * components, components];
    (1..=components).for_each(|component| out.extend([component, 0]));
    out.extend([0, 63, 0]);
    out
}

#[test]
fn jpeg_bombs_are_refused() {
    let closed = |frame: Vec<u8>, components| [frame, jpeg_scan(components), vec![0, 0xFF, 0xD9]].concat();
    refused_picture(
        "65,535 x 65,535 px",
        &closed(jpeg_frame(0xC0, 65_535, 65_535, 3), 3),
        MB,
        "megapixels are allowed",
    );
    refused_picture("CMYK", &closed(jpeg_frame(0xC0, 8, 8, 4), 4), MB, "CMYK");
    refused_picture("200 components", &closed(jpeg_frame(0xC0, 8, 8, 80), 80), MB, "80 colour components");
    refused_picture("400 MP in 60 bytes", &closed(jpeg_frame(0xC2, 20_000, 20_000, 3), 3), MB, "truncated file");

    // a sound progressive picture with its last scan a thousand times
    let sound = include_bytes!("../../science/src/imaging/codec/testdata/progressive.jpg");
    let last = sound.windows(2).rposition(|two| two == [0xFF, 0xDA]).expect("a scan");
    let (head, scan) = (&sound[..last], &sound[last..sound.len() - 2]);
    let repeated = [head, &scan.repeat(1_000), &[0xFF, 0xD9]].concat();
    refused_picture("1,000 scans", &repeated, MB, "more than 100 scans");
    codec::decode(&[head, scan, &[0xFF, 0xD9]].concat(), &Limits::default()).expect("one last scan is fine");

    let restarts = [&sound[..last], &[0xFF, 0xD0].repeat(4 * MB), &[0xFF, 0xD9][..]].concat();
    refused_picture("four million restarts", &restarts, 40 * MB, "");
}

fn png_chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [kind, data].concat();
    [&(data.len() as u32).to_be_bytes(), body.as_slice(), &crc32(&body).to_be_bytes()].concat()
}

fn png_of(width: u32, height: u32, depth: u8, colour: u8, chunks: &[Vec<u8>]) -> Vec<u8> {
    let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
    header.extend([depth, colour, 0, 0, 0]);
    [&b"\x89PNG\r\n\x1a\n"[..], &png_chunk(b"IHDR", &header), &chunks.concat(), &png_chunk(b"IEND", b"")].concat()
}

/// A zlib stream of `megabytes` of zeros.
fn zlib_of_zeros(megabytes: usize) -> Vec<u8> {
    let raw = deflated("z", |out| (0..megabytes).for_each(|_| out.write_all(&[0; MB]).expect("written"))).data;
    // Adler-32 of n zeros: 1, and n + 0 modulo 65,521
    let sum = ((megabytes * MB) % 65_521) as u32;
    [&[0x78, 0x9C][..], &raw, &(sum << 16 | 1).to_be_bytes()].concat()
}

#[test]
fn png_bombs_are_refused() {
    let idat = || png_chunk(b"IDAT", &zlib_of_zeros(1));
    refused_picture("65,535 x 65,535 px", &png_of(65_535, 65_535, 8, 2, &[idat()]), MB, "megapixels are allowed");
    refused_picture("2^31 px wide", &png_of(u32::MAX / 2, 1, 8, 2, &[idat()]), MB, "are allowed");
    refused_picture("3.2 GB in 1 kB", &png_of(20_000, 20_000, 16, 6, &[idat()]), 2 * MB, "truncated file");

    // what may stand beside the pixels, and unpacks to a gigabyte
    let bomb = zlib_of_zeros(1_000);
    let text = png_chunk(b"zTXt", &[b"Comment\0\0", bomb.as_slice()].concat());
    let profile = png_chunk(b"iCCP", &[b"icc\0\0", bomb.as_slice()].concat());
    let international = png_chunk(b"iTXt", &[b"Comment\0\x01\0\0\0", bomb.as_slice()].concat());
    let pixels = png_chunk(b"IDAT", &zlib_of_zeros(1));
    for (what, chunk) in [("zTXt", text), ("iCCP", profile), ("iTXt", international)] {
        // 1,024 rows of 1,023 px and the byte before each
        let bytes = png_of(1_023, 1_024, 8, 0, &[chunk, pixels.clone()]);
        let (_, peak) = peak_of(|| codec::probe(Cursor::new(&bytes), &Limits::default()).is_ok());
        assert!(peak <= HEADERS + bytes.len(), "{what}: {peak} bytes to read its header");
        let (outcome, peak) = peak_of(|| codec::decode(&bytes, &Limits::default()).map(|_| ()));
        assert!(peak <= HEADERS + 2 * bytes.len(), "{what}: {peak} bytes to decode, {outcome:?}");
        let (_, peak) = peak_of(|| codec::metadata(&bytes).for_output(8, 8, &codec::OutputCamera::default()));
        assert!(peak <= HEADERS + 2 * bytes.len(), "{what}: {peak} bytes for its metadata");
    }
}

/// Entries of a TIFF directory: tag, type, count, value.
type Entries<'a> = &'a [(u16, u16, u64, u64)];

/// A TIFF of 8 x 8 px with 8 bits at offset 8 (16 in a BigTIFF). `other` entries are added to the usual ones, or
/// replace them.
fn tiff(is_big: bool, other: Entries<'_>, next: u64) -> Vec<u8> {
    let pixels_at = if is_big { 16 } else { 8 };
    let directory_at = pixels_at + 64;
    let mut entries: Vec<(u16, u16, u64, u64)> = vec![
        (256, 3, 1, 8),
        (257, 3, 1, 8),
        (258, 3, 1, 8),
        (259, 3, 1, 1),
        (262, 3, 1, 1),
        (273, 4, 1, pixels_at),
        (277, 3, 1, 1),
        (278, 3, 1, 8),
        (279, 4, 1, 64),
    ];
    entries.retain(|entry| other.iter().all(|instead| instead.0 != entry.0));
    entries.extend(other);
    entries.sort();
    let number = |value: u64| value.to_le_bytes()[..if is_big { 8 } else { 4 }].to_vec();
    let mut out = if is_big { b"II+\0\x08\0\0\0".to_vec() } else { b"II*\0".to_vec() };
    out.extend(number(directory_at));
    out.extend((0..64).map(|i| i as u8));
    out.extend(&(entries.len() as u64).to_le_bytes()[..if is_big { 8 } else { 2 }]);
    for (tag, kind, count, value) in entries {
        out.extend(u16::to_le_bytes(tag));
        out.extend(u16::to_le_bytes(kind));
        out.extend(number(count));
        out.extend(number(value));
    }
    out.extend(number(next));
    out
}

#[test]
fn tiff_bombs_are_refused() {
    for is_big in [false, true] {
        codec::decode(&tiff(is_big, &[], 0), &Limits::default()).expect("without a lie it is a picture");
        let square = [(256, 4, 1, 65_535), (257, 4, 1, 65_535), (278, 4, 1, 65_535)];
        refused_picture("65,535 x 65,535 px", &tiff(is_big, &square, 0), MB, "megapixels are allowed");
        let large = [(256, 4, 1, 20_000), (257, 4, 1, 20_000), (278, 4, 1, 20_000), (279, 4, 1, 400_000_000)];
        refused_picture("400 MP in 250 bytes", &tiff(is_big, &large, 0), MB, "truncated file");
        refused_picture("2^32 strips", &tiff(is_big, &[(273, 1, u64::from(u32::MAX), 8)], 0), MB, "a list of");
        refused_picture("more strips than rows", &tiff(is_big, &[(273, 4, 900_000, 8)], 0), 80 * MB, "");
        refused_picture("strips of no rows", &tiff(is_big, &[(278, 3, 1, 0)], 0), MB, "");
        refused_picture(
            "a tile without a side",
            &tiff(is_big, &[(322, 3, 1, 0), (323, 3, 1, 0), (324, 4, 1, 8), (325, 4, 1, 64)], 0),
            MB,
            "",
        );
    }
    refused_picture("2^61 strips", &tiff(true, &[(273, 16, 1 << 61, 8)], 0), MB, "a list of");
    let mut entries = tiff(true, &[], 0);
    entries[80..88].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    refused_picture("2^60 entries", &entries, MB, "a directory of");
}

#[test]
fn tiffs_with_circular_directories_or_large_metadata_cost_no_more() {
    for is_big in [false, true] {
        let directory = if is_big { 80 } else { 72 };
        let long = u64::from(u32::MAX) - 1;
        for (what, bytes) in [
            ("a directory that follows itself", tiff(is_big, &[], directory)),
            ("a directory far behind the end", tiff(is_big, &[], long)),
            ("4 GB of colour profile", tiff(is_big, &[(34_675, 7, long, 8)], 0)),
            ("4 GB of text", tiff(is_big, &[(270, 2, long, 8)], 0)),
            ("directories of its own", tiff(is_big, &[(330, 13, 1_000_000, directory), (34_665, 13, 1, directory)], 0)),
        ] {
            let (outcome, peak) = peak_of(|| codec::decode(&bytes, &Limits::default()).map(|_| ()));
            assert!(peak <= MB, "{what}: {peak} bytes to decode, {outcome:?}");
            let (_, peak) = peak_of(|| codec::metadata(&bytes).for_output(8, 8, &codec::OutputCamera::default()));
            assert!(peak <= 65 * MB, "{what}: {peak} bytes for its metadata");
        }
    }
}

#[test]
fn valid_pictures_are_decoded_within_the_memory_budget_of_a_job() {
    const SIDE: usize = 512;
    let deep = |channels: usize| {
        let samples = (0..SIDE * SIDE * channels).map(|i| (i * 9_973 % 65_521) as u16).collect();
        Raster::sixteen(SIDE, SIDE, channels, samples)
    };
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
        ("RGBA of 8 bits in a PNG", png_of_raster(&pattern(SIDE, SIDE, 4)), 1),
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
