//! Pictures that are decompression bombs. Each is refused at its header or when it is decoded, within the memory that
//! `docs/LIMITS.md` states.

use std::io::Cursor;

use pinstack_science::imaging::codec::{self, Limits};

use crate::{
    bombs::{HEADERS, MB},
    peak::peak_of,
    zips::{crc32, deflated},
};

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
