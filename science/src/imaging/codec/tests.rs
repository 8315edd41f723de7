//! Round trips of all formats, and refusals.

mod metadata;
mod refusals;

use std::io::Cursor;

use super::*;
use crate::imaging::{Raster, Samples};

/// A picture in which every pixel and channel differs from its neighbours, smooth enough for JPEG.
fn picture(width: usize, height: usize, channels: usize, sixteen: bool) -> Raster {
    let value = |i: usize| {
        let (pixel, channel) = (i / channels, i % channels);
        let (x, y) = (pixel % width, pixel / width);
        (x * 3 + y * 5 + channel * 40 + (x / 7 + y / 5) % 2 * 30) % 251
    };
    let count = width * height * channels;
    if sixteen {
        let samples = (0..count).map(|i| (value(i) * 257 + i % 7) as u16).collect();
        return Raster::sixteen(width, height, channels, samples);
    }
    Raster::eight(width, height, channels, (0..count).map(|i| value(i) as u8).collect())
}

fn png_of(raster: &Raster, metadata: &Metadata) -> Vec<u8> {
    let mut out = Vec::new();
    encode_png(&mut out, raster, metadata).unwrap();
    out
}

fn tiff_of(raster: &Raster, metadata: &Metadata) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    encode_tiff(&mut out, raster, metadata).unwrap();
    out.into_inner()
}

fn jpeg_of(raster: &Raster, metadata: &Metadata) -> Vec<u8> {
    let mut out = Vec::new();
    write_jpeg(&mut out, raster, metadata, 95).unwrap();
    out
}

/// The picture with a fourth channel that is opaque everywhere.
fn with_opaque_alpha(raster: &Raster) -> Raster {
    let samples = match &raster.samples {
        Samples::Eight(s) => Samples::Eight(s.chunks(3).flat_map(|rgb| [rgb, &[u8::MAX]].concat()).collect()),
        Samples::Sixteen(s) => Samples::Sixteen(s.chunks(3).flat_map(|rgb| [rgb, &[u16::MAX]].concat()).collect()),
    };
    Raster { channels: 4, samples, ..*raster }
}

fn decoded(bytes: &[u8]) -> Result<Raster, ImageFault> {
    decode(bytes, &Limits::default())
}

fn probed(bytes: &[u8]) -> Result<Header, ImageFault> {
    probe(Cursor::new(bytes), &Limits::default())
}

/// An EXIF block with one Orientation and a Model.
fn exif_with(orientation: u16) -> Vec<u8> {
    let mut block = b"MM\0\x2A\0\0\0\x08\0\x02".to_vec();
    block.extend([0x01, 0x10, 0, 2, 0, 0, 0, 4, b'C', b'a', b'm', 0]);
    block.extend([0x01, 0x12, 0, 3, 0, 0, 0, 1, 0, orientation as u8, 0, 0]);
    block.extend([0, 0, 0, 0]);
    block
}

/// A JPEG with an EXIF block as its first segment.
fn with_exif(jpeg: &[u8], exif: &[u8]) -> Vec<u8> {
    let mut out = jpeg[..2].to_vec();
    out.extend([0xFF, 0xE1]);
    out.extend(((exif.len() + 8) as u16).to_be_bytes());
    out.extend(b"Exif\0\0");
    out.extend(exif);
    out.extend(&jpeg[2..]);
    out
}

#[test]
fn png_and_tiff_give_back_every_sample_of_every_kind() {
    for (channels, has_alpha) in [(1, false), (3, false), (3, true)] {
        for sixteen in [false, true] {
            let raster = picture(37, 23, channels, sixteen);
            let stored = if has_alpha { with_opaque_alpha(&raster) } else { raster.clone() };
            for bytes in [png_of(&stored, &Metadata::default()), tiff_of(&stored, &Metadata::default())] {
                let header = probed(&bytes).unwrap();
                assert_eq!((header.width, header.height), (37, 23));
                assert_eq!(usize::from(header.channels), channels);
                assert_eq!(header.bit_depth, if sixteen { 16 } else { 8 });
                assert_eq!(decoded(&bytes).unwrap(), raster, "{channels} {has_alpha} {sixteen} {:?}", header.format);
            }
        }
    }
}

#[test]
fn jpeg_comes_back_close_in_grey_and_colour() {
    for channels in [1, 3] {
        let raster = picture(61, 45, channels, false);
        let bytes = encode_jpeg(&raster, 95);
        assert_eq!(probed(&bytes).unwrap().format, Format::Jpeg);
        let back = decoded(&bytes).unwrap();
        assert_eq!((back.width, back.height, back.channels), (61, 45, channels));
        let (Samples::Eight(a), Samples::Eight(b)) = (&raster.samples, &back.samples) else { panic!("not 8 bits") };
        let mean = a.iter().zip(b).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.len() as f64;
        assert!(mean < 8.0, "mean difference {mean}");
    }
}

#[test]
fn palettes_are_looked_up_and_grey_with_alpha_is_grey() {
    let mut out = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut out, 2, 2);
    encoder.set_color(::png::ColorType::Indexed);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_palette(vec![1, 2, 3, 40, 50, 60]);
    encoder.set_trns(vec![255, 255]);
    encoder.write_header().unwrap().write_image_data(&[0, 1, 1, 0]).unwrap();
    let expected = Raster::eight(2, 2, 3, vec![1, 2, 3, 40, 50, 60, 40, 50, 60, 1, 2, 3]);
    assert_eq!(decoded(&out).unwrap(), expected);
    assert_eq!(probed(&out).unwrap().channels, 3);

    let mut out = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut out, 2, 1);
    encoder.set_color(::png::ColorType::GrayscaleAlpha);
    encoder.set_depth(::png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&[1, 2, 255, 255, 3, 4, 255, 255]).unwrap();
    assert_eq!(decoded(&out).unwrap(), Raster::sixteen(2, 1, 1, vec![0x0102, 0x0304]));
}

#[test]
fn results_are_decoded_with_their_alpha() {
    for (channels, sixteen) in [(1, false), (1, true), (3, false), (3, true), (4, false), (4, true)] {
        let raster = picture(23, 17, channels, sixteen);
        for bytes in [png_of(&raster, &Metadata::default()), tiff_of(&raster, &Metadata::default())] {
            assert_eq!(decode_rgba(&bytes, &Limits::default()).unwrap(), raster, "{channels} channels");
            let torn = decode_rgba(&bytes[..bytes.len() / 2], &Limits::default());
            assert!(matches!(torn, Err(ImageFault::Damaged { .. })), "{torn:?}");
        }
    }
    let few = Limits { max_width: 20, ..Limits::default() };
    let wide = decode_rgba(&png_of(&picture(23, 17, 4, false), &Metadata::default()), &few);
    assert!(wide.is_err(), "{wide:?}");
    assert_eq!(decode_rgba(b"hello, world, this is a text", &Limits::default()), Err(ImageFault::Unknown));
}

/// The same coefficients, coded in three ways by another program (45 x 38 px, chroma at half size).
const CODED: [&[u8]; 3] = [
    include_bytes!("testdata/baseline.jpg"),
    include_bytes!("testdata/progressive.jpg"),
    include_bytes!("testdata/restart.jpg"),
];

#[test]
fn progressive_and_restarted_jpegs_give_the_pixels_of_the_baseline() {
    let expected = decoded(CODED[0]).unwrap();
    assert_eq!((expected.width, expected.height, expected.channels), (45, 38, 3));
    assert_eq!(decoded(CODED[1]).unwrap(), expected);
    assert_eq!(decoded(CODED[2]).unwrap(), expected);
}
