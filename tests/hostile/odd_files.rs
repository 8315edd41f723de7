//! Writers of odd but valid pictures: TIFF pages with any tags, LZW, JPEGs of any sampling, chunks of PNG.

use crate::zips::crc32;

/// Types of TIFF tags.
pub const BYTES: u16 = 1;
pub const TEXT: u16 = 2;
pub const SHORT: u16 = 3;
pub const LONG: u16 = 4;
pub const RATIO: u16 = 5;
pub const UNDEFINED: u16 = 7;

/// A tag: number, type, value in little-endian bytes.
pub type Tag = (u16, u16, Vec<u8>);

pub fn shorts(number: u16, values: &[u16]) -> Tag {
    (number, SHORT, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

pub fn longs(number: u16, values: &[u32]) -> Tag {
    (number, LONG, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

pub fn ratios(number: u16, values: &[f64]) -> Tag {
    let ratio = |v: &f64| [(v * 1e5).round() as u32, 100_000].map(u32::to_le_bytes).concat();
    (number, RATIO, values.iter().flat_map(ratio).collect())
}

/// A directory at `offset`, with the offset of the next one.
fn directory(mut tags: Vec<Tag>, offset: usize, next: impl Fn(usize) -> usize) -> Vec<u8> {
    tags.sort_by_key(|tag| tag.0);
    let body_at = offset + 2 + 12 * tags.len() + 4;
    let (mut head, mut body) = ((tags.len() as u16).to_le_bytes().to_vec(), Vec::new());
    for (number, kind, value) in &tags {
        let size = match *kind {
            SHORT => 2,
            LONG => 4,
            RATIO => 8,
            _ => 1,
        };
        head.extend([number.to_le_bytes(), kind.to_le_bytes()].concat());
        head.extend(((value.len() / size) as u32).to_le_bytes());
        let mut place = value.clone();
        if value.len() > 4 {
            place = ((body_at + body.len()) as u32).to_le_bytes().to_vec();
            body.extend(value);
            body.resize(body.len().next_multiple_of(2), 0);
        }
        place.resize(4, 0);
        head.extend(place);
    }
    head.extend((next(body_at + body.len()) as u32).to_le_bytes());
    head.extend(body);
    head
}

/// An EXIF block of a main, an Exif and an interoperability directory.
pub fn exif(main: &[Tag], exif: &[Tag], interop: &[Tag]) -> Vec<u8> {
    let none = |_| 0;
    let with = |tags: &[Tag], pointer: u16, at: usize| [tags, &[longs(pointer, &[at as u32])]].concat();
    let main_length = directory(with(main, 0x8769, 0), 8, none).len();
    let exif_at = 8 + main_length;
    let interop_at = exif_at + directory(with(exif, 0xA005, 0), exif_at, none).len();
    let mut out = b"II*\0\x08\0\0\0".to_vec();
    out.extend(directory(with(main, 0x8769, exif_at), 8, none));
    out.extend(directory(with(exif, 0xA005, interop_at), exif_at, none));
    out.extend(directory(interop.to_vec(), interop_at, none));
    out
}

/// The EXIF block of a camera that is set to Adobe RGB.
pub fn adobe_exif() -> Vec<u8> {
    exif(&[], &[shorts(0xA001, &[65_535])], &[(1, TEXT, b"R03\0".to_vec())])
}

/// A page of a TIFF: its shape, its samples as stored, and tags beside the usual ones, or instead of them.
pub struct Page {
    pub width: u32,
    pub height: u32,
    pub channels: u16,
    pub bits: u16,
    pub stored: Vec<Vec<u8>>,
    pub tags: Vec<Tag>,
}

/// A little-endian TIFF.
pub fn tiff(pages: &[Page]) -> Vec<u8> {
    let mut out = b"II*\0\x08\0\0\0".to_vec();
    for (at, page) in pages.iter().enumerate() {
        let is_tiled = page.tags.iter().any(|tag| tag.0 == 322);
        let (offsets, counts) = if is_tiled { (324, 325) } else { (273, 279) };
        let lengths: Vec<u32> = page.stored.iter().map(|part| part.len() as u32).collect();
        let tags = |data_at: usize| {
            let starts = lengths.iter().scan(data_at as u32, |at, length| Some(std::mem::replace(at, *at + length)));
            let mut tags = vec![
                longs(256, &[page.width]),
                longs(257, &[page.height]),
                shorts(258, &vec![page.bits; usize::from(page.channels)]),
                shorts(259, &[1]),
                shorts(262, &[if page.channels < 3 { 1 } else { 2 }]),
                longs(offsets, &starts.collect::<Vec<u32>>()),
                shorts(277, &[page.channels]),
                longs(278, &[page.height]),
                longs(counts, &lengths),
            ];
            tags.retain(|tag| page.tags.iter().all(|other| other.0 != tag.0));
            tags.extend(page.tags.iter().cloned());
            tags
        };
        let data_at = out.len() + directory(tags(0), out.len(), |_| 0).len();
        let bytes = lengths.iter().sum::<u32>() as usize;
        let next = |end: usize| if at + 1 == pages.len() { 0 } else { (end + bytes).next_multiple_of(2) };
        out.extend(directory(tags(data_at), out.len(), next));
        out.extend(page.stored.concat());
        out.resize(out.len().next_multiple_of(2), 0);
    }
    out
}

/// LZW of TIFF: most significant bit first, longer codes one code early.
pub fn lzw(bytes: &[u8]) -> Vec<u8> {
    let mut bits = Vec::new();
    let mut put = |code: usize, width: usize| bits.extend((0..width).rev().map(|bit| code >> bit & 1 == 1));
    let mut table = std::collections::HashMap::new();
    let (mut next, mut width) = (258, 9);
    let mut prefix: Option<usize> = None;
    put(256, width);
    for &byte in bytes {
        let Some(code) = prefix else {
            prefix = Some(usize::from(byte));
            continue;
        };
        if let Some(&longer) = table.get(&(code, byte)) {
            prefix = Some(longer);
            continue;
        }
        put(code, width);
        table.insert((code, byte), next);
        next += 1;
        if next == 4_094 {
            put(256, width);
            table.clear();
            (next, width) = (258, 9);
        } else if next > (1 << width) - 1 {
            width += 1;
        }
        prefix = Some(usize::from(byte));
    }
    if let Some(code) = prefix {
        put(code, width);
        next += 1;
        if next > (1 << width) - 1 && width < 12 {
            width += 1;
        }
    }
    put(257, width);
    bits.chunks(8)
        .map(|byte| byte.iter().enumerate().fold(0, |sum, (i, &bit)| sum | u8::from(bit) << (7 - i)))
        .collect()
}

/// A JPEG of `count` x 1 MCUs, each of one colour (Y, Cb, Cr), whose components have these sampling factors (x, y).
/// Only the means of the blocks are coded.
pub fn jpeg(sampling: &[[u8; 2]], colours: &[[i32; 3]]) -> Vec<u8> {
    let largest = |axis: usize| sampling.iter().map(|of| of[axis]).max().unwrap();
    let (width, height) = (8 * u16::from(largest(0)) * colours.len() as u16, 8 * u16::from(largest(1)));
    let segment =
        |marker: u8, data: &[u8]| [&[0xFF, marker], &(data.len() as u16 + 2).to_be_bytes()[..], data].concat();
    let ids = 1..=sampling.len() as u8;
    let mut frame = [&[8], &height.to_be_bytes()[..], &width.to_be_bytes(), &[sampling.len() as u8]].concat();
    ids.clone().zip(sampling).for_each(|(id, [x, y])| frame.extend([id, x << 4 | y, 0]));
    // twelve sizes of differences, four bits each; the end of a block, one bit
    let means = [&[0, 0, 0, 0, 12], &[0; 12][..], &(0..12).collect::<Vec<u8>>()].concat();
    let rest = [&[0x10, 1][..], &[0; 15], &[0]].concat();
    let mut scan = vec![sampling.len() as u8];
    ids.for_each(|id| scan.extend([id, 0]));
    scan.extend([0, 63, 0]);

    let mut bits: Vec<bool> = Vec::new();
    let mut put = |value: i32, width: u32| bits.extend((0..width).rev().map(|bit| value >> bit & 1 == 1));
    let mut last = [0; 3];
    for colour in colours {
        for (component, [x, y]) in sampling.iter().enumerate() {
            for _ in 0..x * y {
                let mean = 8 * (colour[component] - 128);
                let difference = mean - std::mem::replace(&mut last[component], mean);
                let size = i32::BITS - difference.abs().leading_zeros();
                put(size as i32, 4);
                put(if difference < 0 { difference + (1 << size) - 1 } else { difference }, size);
                put(0, 1);
            }
        }
    }
    bits.resize(bits.len().next_multiple_of(8), true);
    let byte = |bits: &[bool]| bits.iter().fold(0_u8, |sum, &bit| sum << 1 | u8::from(bit));
    let stuffed = |byte: u8| if byte == 0xFF { vec![0xFF, 0] } else { vec![byte] };
    let data: Vec<u8> = bits.chunks(8).map(byte).flat_map(stuffed).collect();
    let quantisation = [&[0][..], &[1; 64]].concat();
    [
        &[0xFF, 0xD8][..],
        &segment(0xDB, &quantisation),
        &segment(0xC0, &frame),
        &segment(0xC4, &means),
        &segment(0xC4, &rest),
        &segment(0xDA, &scan),
        &data,
        &[0xFF, 0xD9],
    ]
    .concat()
}

/// A JPEG or PNG with an EXIF block.
pub fn with_exif(file: &[u8], block: &[u8]) -> Vec<u8> {
    if file.starts_with(b"\x89PNG") {
        return with_chunk(file, b"eXIf", block);
    }
    let length = (block.len() as u16 + 8).to_be_bytes();
    [&file[..2], &[0xFF, 0xE1], &length, b"Exif\0\0", block, &file[2..]].concat()
}

/// A chunk of a PNG.
pub fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let body = [&kind[..], data].concat();
    [&(data.len() as u32).to_be_bytes()[..], &body, &crc32(&body).to_be_bytes()].concat()
}

/// A PNG with another chunk after its header.
pub fn with_chunk(png: &[u8], kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    [&png[..33], &chunk(kind, data), &png[33..]].concat()
}

/// A profile for grey whose curve is a power.
pub fn grey_profile(gamma: f64) -> Vec<u8> {
    let curve = [&b"curv\0\0\0\0\0\0\0\x01"[..], &((gamma * 256.0).round() as u16).to_be_bytes(), &[0, 0]].concat();
    let mut out = vec![0; 128];
    out[16..24].copy_from_slice(b"GRAYXYZ ");
    out[36..40].copy_from_slice(b"acsp");
    out.extend([&[0, 0, 0, 1][..], b"kTRC", &[0, 0, 0, 144], &(curve.len() as u32).to_be_bytes(), &curve].concat());
    let length = (out.len() as u32).to_be_bytes();
    out[..4].copy_from_slice(&length);
    out
}
