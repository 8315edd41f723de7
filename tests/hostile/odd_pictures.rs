//! Odd but valid pictures. Each is decoded to what its file says, or refused with a sentence that names the oddity;
//! none is taken for something else. All are generated here.

use std::io::Cursor;

use pinstack_science::{
    imaging::{
        Raster,
        codec::{self, ColourSpace, Limits, Metadata},
    },
    types::ErrorKind,
};

use crate::odd_files::{Page, Tag, chunk, exif, longs, shorts, tiff, with_chunk};

pub const WIDTH: usize = 24;
pub const HEIGHT: usize = 16;

/// What becomes of a picture.
pub enum Outcome {
    /// These pixels, in this colour space.
    Pixels(Raster, ColourSpace),
    /// A refusal that contains these words.
    Refused(&'static str),
}

use Outcome::{Pixels, Refused};

/// Checks that the header and the pixels of each file have the outcome of its row.
pub fn check(rows: Vec<(&str, Vec<u8>, Outcome)>) {
    for (what, bytes, outcome) in rows {
        let header = codec::probe(Cursor::new(&bytes), &Limits::default());
        let decoded = codec::decode(&bytes, &Limits::default());
        match outcome {
            Pixels(expected, space) => {
                assert_eq!(decoded.unwrap_or_else(|fault| panic!("{what}: {fault}")), expected, "{what}");
                let header = header.unwrap_or_else(|fault| panic!("{what}: {fault}"));
                assert_eq!(header.colour, space, "{what}");
            }
            Refused(words) => {
                let fault = decoded.expect_err(what);
                let sentence = fault.to_string();
                assert!(sentence.contains(words), "{what}: {sentence:?} lacks {words:?}");
                assert!(!sentence.contains(['{', '}']) && !sentence.contains("::"), "{what}: {sentence:?}");
                assert_eq!(fault.in_file("a", None).kind, ErrorKind::InvalidImage, "{what}");
            }
        }
    }
}

pub fn sample(x: usize, y: usize, channel: usize) -> u8 {
    (x * 9 + y * 5 + channel * 40) as u8 / 2 + 20
}

pub fn rgb(width: usize, height: usize) -> Vec<u8> {
    (0..width * height * 3).map(|i| sample(i / 3 % width, i / 3 / width, i % 3)).collect()
}

pub fn picture() -> Raster {
    Raster::eight(WIDTH, HEIGHT, 3, rgb(WIDTH, HEIGHT))
}

/// The picture with an alpha channel.
fn with_alpha(alpha: impl Fn(usize) -> u8) -> Vec<u8> {
    rgb(WIDTH, HEIGHT).chunks(3).enumerate().flat_map(|(i, pixel)| [pixel[0], pixel[1], pixel[2], alpha(i)]).collect()
}

/// Opaque but for some pixels in the middle.
fn hole(pixel: usize) -> u8 {
    if pixel % WIDTH == 12 { 0 } else { 255 }
}

fn page(channels: u16, stored: Vec<u8>, tags: &[Tag]) -> Page {
    let (width, height) = (WIDTH as u32, HEIGHT as u32);
    Page { width, height, channels, bits: 8, stored: vec![stored], tags: tags.to_vec() }
}

pub fn plain(tags: &[Tag]) -> Page {
    page(3, rgb(WIDTH, HEIGHT), tags)
}

pub fn small(tags: &[Tag]) -> Page {
    let (width, height) = (8, 4);
    Page { width, height, channels: 3, bits: 8, stored: vec![rgb(8, 4)], tags: tags.to_vec() }
}

fn mask(tags: &[Tag]) -> Page {
    page(1, vec![255; WIDTH * HEIGHT], tags)
}

pub fn png(raster: &Raster, icc: Option<Vec<u8>>) -> Vec<u8> {
    let mut out = Vec::new();
    codec::encode_png(&mut out, raster, &Metadata { icc, exif: None }).expect("a PNG");
    out
}

#[test]
fn alpha_of_a_tiff_is_opaque_or_the_file_is_refused() {
    let (associated, straight, unspecified) = (shorts(338, &[1]), shorts(338, &[2]), shorts(338, &[0]));
    let four = |stored: Vec<u8>, extra: &Tag| tiff(&[page(4, stored, std::slice::from_ref(extra))]);
    let deep = |alpha: u16| Page {
        bits: 16,
        stored: vec![
            with_alpha(|_| 0)
                .chunks(4)
                .flat_map(|p| [p[0], p[0], p[1], p[1], p[2], p[2]].into_iter().chain(alpha.to_le_bytes()))
                .collect(),
        ],
        ..page(4, Vec::new(), std::slice::from_ref(&straight))
    };
    let deep_picture =
        Raster::sixteen(WIDTH, HEIGHT, 3, rgb(WIDTH, HEIGHT).iter().map(|&v| u16::from(v) * 257).collect());
    let planes = |alpha: u8| {
        let plane = |channel: usize| (0..WIDTH * HEIGHT).map(|i| sample(i % WIDTH, i / WIDTH, channel)).collect();
        let stored = vec![plane(0), plane(1), plane(2), vec![alpha; WIDTH * HEIGHT]];
        let strips = longs(278, &[HEIGHT as u32]);
        tiff(&[Page { stored, ..page(4, Vec::new(), &[shorts(284, &[2]), straight.clone(), strips]) }])
    };
    let sound = || Pixels(picture(), ColourSpace::Srgb);
    check(vec![
        (
            "associated alpha of 128",
            four(with_alpha(|_| 128), &associated),
            Refused("384 of its 384 pixels are transparent"),
        ),
        ("associated alpha, opaque", four(with_alpha(|_| 255), &associated), sound()),
        (
            "straight alpha with a hole",
            four(with_alpha(hole), &straight),
            Refused("16 of its 384 pixels are transparent"),
        ),
        ("straight alpha, opaque", four(with_alpha(|_| 255), &straight), sound()),
        (
            "nearly opaque",
            four(with_alpha(|i| if i == 7 { 254 } else { 255 }), &straight),
            Refused("1 of its 384 pixels"),
        ),
        ("a fourth channel that is no alpha", four(with_alpha(hole), &unspecified), sound()),
        ("16 bits, opaque", tiff(&[deep(65_535)]), Pixels(deep_picture, ColourSpace::Srgb)),
        ("16 bits, half transparent", tiff(&[deep(40_000)]), Refused("are transparent")),
        ("planes, opaque", planes(255), sound()),
        ("planes, transparent", planes(9), Refused("384 of its 384 pixels are transparent")),
    ]);
}

#[test]
fn alpha_of_a_png_is_opaque_or_the_file_is_refused() {
    let rgba = |alpha: &dyn Fn(usize) -> u8| png(&Raster::eight(WIDTH, HEIGHT, 4, with_alpha(alpha)), None);
    let key = |colour: [u8; 3]| with_chunk(&png(&picture(), None), b"tRNS", &colour.map(|v| [0, v]).concat());
    let palette = |alpha: &[u8]| {
        let chunks = [
            chunk(b"IHDR", &[0, 0, 0, 2, 0, 0, 0, 2, 8, 3, 0, 0, 0]),
            chunk(b"PLTE", &[1, 2, 3, 40, 50, 60, 9, 9, 9]),
            chunk(b"tRNS", alpha),
            // a stored block of two rows, and its Adler-32
            chunk(b"IDAT", &[0x78, 1, 1, 6, 0, 0xF9, 0xFF, 0, 0, 1, 0, 1, 0, 0, 12, 0, 3]),
            chunk(b"IEND", &[]),
        ];
        [&b"\x89PNG\r\n\x1a\n"[..], &chunks.concat()].concat()
    };
    let of_palette = Raster::eight(2, 2, 3, vec![1, 2, 3, 40, 50, 60, 40, 50, 60, 1, 2, 3]);
    check(vec![
        ("a hole", rgba(&hole), Refused("16 of its 384 pixels are transparent")),
        ("opaque", rgba(&|_| 255), Pixels(picture(), ColourSpace::Srgb)),
        ("a transparent colour that does not occur", key([1, 1, 1]), Pixels(picture(), ColourSpace::Srgb)),
        ("a transparent colour that occurs", key([20, 40, 60]), Refused("2 of its 384 pixels are transparent")),
        ("a palette with a transparent colour", palette(&[255, 0]), Refused("2 of its 4 pixels are transparent")),
        (
            "a palette whose transparent colour is not used",
            palette(&[255, 255, 0]),
            Pixels(of_palette, ColourSpace::Srgb),
        ),
    ]);
}

#[test]
fn the_page_of_a_tiff_that_is_the_picture_is_found() {
    let kind = |bits: u32| [longs(254, &[bits])];
    let old = |kind: u16| [shorts(255, &[kind])];
    let turned = [longs(254, &[1]), shorts(274, &[6])];
    let sound = || Pixels(picture(), ColourSpace::Srgb);
    check(vec![
        ("a thumbnail, then the picture", tiff(&[small(&kind(1)), plain(&kind(0))]), sound()),
        ("a thumbnail that is turned, then the picture", tiff(&[small(&turned), plain(&[])]), sound()),
        ("the same by the old tag", tiff(&[small(&old(2)), plain(&old(1))]), sound()),
        ("a mask, then the picture", tiff(&[mask(&kind(4)), plain(&kind(0))]), sound()),
        ("the picture, then its mask", tiff(&[plain(&kind(0)), mask(&kind(4))]), sound()),
        ("the picture, then a thumbnail and its mask", tiff(&[plain(&[]), small(&kind(1)), mask(&kind(5))]), sound()),
        ("the picture, then a thumbnail by the old tag", tiff(&[plain(&old(1)), small(&old(2))]), sound()),
        ("a reduced picture alone", tiff(&[plain(&kind(1))]), sound()),
        ("a mask alone", tiff(&[mask(&kind(4))]), Refused("a mask or thumbnails and no picture")),
        ("two thumbnails", tiff(&[small(&kind(1)), small(&kind(1))]), Refused("a mask or thumbnails and no picture")),
        ("two pictures", tiff(&[plain(&kind(0)), plain(&kind(0))]), Refused("several pages")),
        ("two pages of a document", tiff(&[plain(&kind(2)), plain(&kind(2))]), Refused("several pages")),
    ]);
}

#[test]
fn an_orientation_behind_the_pixels_of_a_png_is_not_ignored() {
    let whole = png(&picture(), None);
    let block = exif(&[shorts(274, &[6])], &[], &[]);
    let end = whole.len() - 12;
    let late = [&whole[..end], &chunk(b"eXIf", &block), &whole[end..]].concat();
    check(vec![("eXIf after IDAT", late, Refused("orientation tag behind the pixels"))]);
}
