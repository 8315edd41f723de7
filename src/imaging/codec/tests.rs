//! What goes in comes out, and what is not sound is refused.

use std::{
    io::Cursor,
    path::{Path, PathBuf},
};

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

fn without_alpha(raster: &Raster) -> Raster {
    let kept = if raster.channels == 4 { 3 } else { raster.channels };
    let samples = match &raster.samples {
        Samples::Eight(s) => Samples::Eight(png::first_channels(s.clone(), raster.channels, kept)),
        Samples::Sixteen(s) => Samples::Sixteen(png::first_channels(s.clone(), raster.channels, kept)),
    };
    Raster { channels: kept, samples, ..*raster }
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
    for channels in [1, 3, 4] {
        for sixteen in [false, true] {
            let raster = picture(37, 23, channels, sixteen);
            for bytes in [png_of(&raster, &Metadata::default()), tiff_of(&raster, &Metadata::default())] {
                let header = probed(&bytes).unwrap();
                assert_eq!((header.width, header.height), (37, 23));
                assert_eq!(usize::from(header.channels), channels.min(3));
                assert_eq!(header.bit_depth, if sixteen { 16 } else { 8 });
                assert_eq!(
                    decoded(&bytes).unwrap(),
                    without_alpha(&raster),
                    "{channels} {sixteen} {:?}",
                    header.format
                );
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
fn a_jpeg_cut_anywhere_is_refused_and_so_is_one_with_a_made_up_end() {
    for channels in [1, 3] {
        let bytes = encode_jpeg(&picture(96, 80, channels, false), 90);
        for cut in 0..bytes.len() {
            assert!(decoded(&bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
        }
        // a repair tool appends the end marker
        let scan = bytes.len() - (bytes.len() / 3);
        for cut in scan..bytes.len() - 8 {
            let mut patched = bytes[..cut].to_vec();
            patched.extend([0xFF, 0xD9]);
            assert!(decoded(&patched).is_err(), "{cut} of {} with an end marker", bytes.len());
        }
    }
}

#[test]
fn tiff_and_png_cut_anywhere_are_refused() {
    let raster = picture(24, 20, 3, false);
    for bytes in [png_of(&raster, &Metadata::default()), tiff_of(&raster, &Metadata::default())] {
        for cut in 0..bytes.len() - 1 {
            assert!(decoded(&bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
        }
    }
}

#[test]
fn bytes_after_the_end_of_a_jpeg_do_not_matter() {
    let bytes = encode_jpeg(&picture(40, 40, 3, false), 90);
    let mut longer = bytes.clone();
    longer.extend(&bytes);
    assert_eq!(decoded(&longer), decoded(&bytes));
}

#[test]
fn the_exif_orientation_is_applied_and_the_header_tells_the_upright_size() {
    let raster = picture(48, 32, 1, false);
    let plain = encode_jpeg(&raster, 95);
    let upright = decoded(&plain).unwrap();
    for stored in 1..=8 {
        let bytes = with_exif(&plain, &exif_with(stored));
        let header = probed(&bytes).unwrap();
        let turned = decoded(&bytes).unwrap();
        assert_eq!(u16::from(header.orientation), stored);
        assert_eq!((header.width as usize, header.height as usize), (turned.width, turned.height));
        assert_eq!(turned, orientation::apply(upright.clone(), stored as u8));
    }
}

#[test]
fn png_orientation_is_applied_too() {
    let raster = picture(9, 5, 3, false);
    let metadata = Metadata { icc: None, exif: Some(exif_with(6)) };
    let back = decoded(&png_of(&raster, &metadata)).unwrap();
    assert_eq!(back, orientation::apply(raster, 6));
}

#[test]
fn absurd_sizes_are_refused_before_anything_is_allocated() {
    let mut jpeg = encode_jpeg(&picture(16, 16, 1, false), 90);
    let frame = jpeg.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xFF, 0xFF, 0xFF, 0xFF]);
    assert!(matches!(decoded(&jpeg), Err(ImageFault::TooLarge { width: 65_535, height: 65_535, .. })));
    assert!(matches!(probed(&jpeg), Err(ImageFault::TooLarge { .. })));

    let mut png = png_of(&picture(16, 16, 1, false), &Metadata::default());
    png[16..24].copy_from_slice(&[0x7F, 0xFF, 0xFF, 0xFF, 0, 1, 0, 0]);
    let crc = png_crc(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    assert!(matches!(probed(&png), Err(ImageFault::TooLarge { .. })), "{:?}", probed(&png));

    let limits = Limits { max_pixels: 255, ..Limits::default() };
    let tiff = tiff_of(&picture(16, 16, 3, true), &Metadata::default());
    assert!(matches!(decode(&tiff, &limits), Err(ImageFault::TooLarge { .. })));
}

fn png_crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

#[test]
fn what_is_not_read_is_refused_with_a_sentence_that_says_what_to_do() {
    let cases: [(&[u8], &str); 8] = [
        (b"", "empty (0 bytes)"),
        (b"II*\0\x10\0\0\0CR\x02\0........", "16-bit TIFF"),
        (b"\0\0\0\x18ftypcrx \0\0\0\x01", "Canon CR3"),
        (b"\0\0\0\x18ftypheic\0\0\0\0mif1", "HEIC"),
        (b"RIFF\0\0\0\0WEBPVP8 ", "WebP"),
        (b"hello, this is a text", "not a JPEG, PNG or TIFF"),
        (b"FUJIFILMCCD-RAW 0201", "RAF"),
        (b"GIF89a..........", "GIF"),
    ];
    for (bytes, expected) in cases {
        let sentence = decoded(bytes).unwrap_err().to_string();
        assert!(sentence.contains(expected), "{sentence:?} lacks {expected:?}");
    }
    assert_eq!(raw_extension("front/IMG_0001.NEF"), Some("Nikon NEF"));
    assert_eq!(raw_extension("front/IMG_0001.jpg"), None);
}

#[test]
fn colours_that_would_come_out_wrong_are_refused() {
    // a frame header of four components is CMYK
    let mut jpeg = vec![0xFF, 0xD8, 0xFF, 0xC0, 0, 20, 8, 0, 16, 0, 16, 4];
    for component in 1..=4 {
        jpeg.extend([component, 0x11, 0]);
    }
    jpeg.extend([0xFF, 0xDA, 0, 14, 4, 1, 0, 2, 0, 3, 0, 4, 0, 0, 63, 0]);
    assert!(decoded(&jpeg).unwrap_err().to_string().contains("CMYK"));

    let mut twelve = encode_jpeg(&picture(16, 16, 3, false), 90);
    let frame = twelve.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
    twelve[frame + 4] = 12;
    assert!(decoded(&twelve).unwrap_err().to_string().contains("12 bits"));

    let mut out = Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
    encoder.write_image::<::tiff::encoder::colortype::CMYK8>(4, 4, &[9; 64]).unwrap();
    assert!(decoded(&out.into_inner()).unwrap_err().to_string().contains("CMYK"));

    let mut out = Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
    encoder.write_image::<::tiff::encoder::colortype::Gray32Float>(4, 4, &[0.5; 16]).unwrap();
    assert!(probed(&out.into_inner()).is_err());
}

#[test]
fn a_tiff_of_several_pages_is_refused_instead_of_losing_all_but_the_first() {
    let mut out = Cursor::new(Vec::new());
    let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
    for _ in 0..2 {
        encoder.write_image::<::tiff::encoder::colortype::Gray8>(4, 4, &[9; 16]).unwrap();
    }
    let bytes = out.into_inner();
    assert!(probed(&bytes).unwrap_err().to_string().contains("several pages"));
    assert!(decoded(&bytes).unwrap_err().to_string().contains("several pages"));
}

#[test]
fn palettes_are_looked_up_and_grey_with_alpha_is_grey() {
    let mut out = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut out, 2, 2);
    encoder.set_color(::png::ColorType::Indexed);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_palette(vec![1, 2, 3, 40, 50, 60]);
    encoder.set_trns(vec![255, 0]);
    encoder.write_header().unwrap().write_image_data(&[0, 1, 1, 0]).unwrap();
    let expected = Raster::eight(2, 2, 3, vec![1, 2, 3, 40, 50, 60, 40, 50, 60, 1, 2, 3]);
    assert_eq!(decoded(&out).unwrap(), expected);
    assert_eq!(probed(&out).unwrap().channels, 3);

    let mut out = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut out, 2, 1);
    encoder.set_color(::png::ColorType::GrayscaleAlpha);
    encoder.set_depth(::png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&[1, 2, 9, 9, 3, 4, 9, 9]).unwrap();
    assert_eq!(decoded(&out).unwrap(), Raster::sixteen(2, 1, 1, vec![0x0102, 0x0304]));
}

#[test]
fn a_profile_for_other_colours_is_not_written() {
    let mut icc = vec![0; 132];
    icc[16..20].copy_from_slice(b"GRAY");
    let metadata = Metadata { icc: Some(icc.clone()), exif: None };
    let grey = png_of(&picture(4, 4, 1, false), &metadata);
    let colour = png_of(&picture(4, 4, 3, false), &metadata);
    assert_eq!(super::metadata(&grey).icc, Some(icc));
    assert_eq!(super::metadata(&colour).icc, None);
}

fn shared(path: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let file = std::env::var_os("PINSTACK_SHARED").map_or_else(beside, PathBuf::from).join("data").join(path);
    if !file.is_file() {
        eprintln!("skipped: {} is not here", file.display());
        return None;
    }
    Some(file)
}

fn field(block: &[u8], tag: exif::Tag) -> Option<String> {
    let exif = exif::Reader::new().read_raw(block.to_vec()).unwrap();
    exif.get_field(tag, exif::In::PRIMARY).map(|field| field.display_value().to_string())
}

/// An EXIF block as cameras write it: exposure and lens, a maker note, a place in the picture, a thumbnail directory.
fn camera_block() -> Vec<u8> {
    use exif::{Field, In, Rational, Tag, Value};
    let ratio = |num, denom| Value::Rational(vec![Rational { num, denom }]);
    let text = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
    let primary = [
        (Tag::Make, text("Canon")),
        (Tag::Model, text("Canon EOS 5DS")),
        (Tag::DateTime, text("2019:06:01 10:20:30")),
        (Tag::Orientation, Value::Short(vec![6])),
        (Tag::ImageWidth, Value::Long(vec![8688])),
        (Tag::ExposureTime, ratio(1, 60)),
        (Tag::FNumber, ratio(56, 10)),
        (Tag::FocalLength, ratio(65, 1)),
        (Tag::PhotographicSensitivity, Value::Short(vec![100])),
        (Tag::LensModel, text("MP-E65mm f/2.8 1-5x Macro Photo")),
        (Tag::PixelXDimension, Value::Long(vec![8688])),
        (Tag::PixelYDimension, Value::Long(vec![5792])),
        (Tag::FocalPlaneXResolution, ratio(6000, 1)),
        (Tag::FocalPlaneYResolution, ratio(6001, 1)),
        (Tag::MakerNote, Value::Undefined(vec![1; 50], 0)),
        (Tag::SubjectArea, Value::Short(vec![4344, 2896])),
        (Tag::GPSLatitudeRef, text("S")),
    ];
    let thumbnail = [(Tag::Orientation, Value::Short(vec![6])), (Tag::Compression, Value::Short(vec![6]))];
    let fields: Vec<Field> = (primary.into_iter().map(|(tag, value)| Field { tag, ifd_num: In::PRIMARY, value }))
        .chain(thumbnail.into_iter().map(|(tag, value)| Field { tag, ifd_num: In::THUMBNAIL, value }))
        .collect();
    let mut writer = exif::experimental::Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut out = Cursor::new(Vec::new());
    writer.write(&mut out, false).unwrap();
    out.into_inner()
}

#[test]
fn camera_lens_and_exposure_survive_while_what_belongs_to_the_old_file_does_not() {
    use exif::Tag;
    let jpeg = with_exif(&encode_jpeg(&picture(16, 16, 3, false), 90), &camera_block());
    let source = metadata(&jpeg);
    let before = source.exif.clone().unwrap();
    let ours = source.for_output(64, 48);
    let raster = picture(64, 48, 4, true);
    for out in [png_of(&raster, &ours), tiff_of(&raster, &ours)] {
        let block = metadata(&out).exif.unwrap();
        for tag in [
            Tag::Make,
            Tag::Model,
            Tag::DateTime,
            Tag::FNumber,
            Tag::ExposureTime,
            Tag::FocalLength,
            Tag::LensModel,
            Tag::PhotographicSensitivity,
            Tag::GPSLatitudeRef,
        ] {
            assert!(field(&block, tag).is_some(), "{tag}");
            assert_eq!(field(&block, tag), field(&before, tag), "{tag}");
        }
        assert_eq!(field(&block, Tag::PixelXDimension).unwrap(), "64");
        assert_eq!(field(&block, Tag::PixelYDimension).unwrap(), "48");
        assert_eq!(orientation_of(&block), 1);
        // the picture was turned by a quarter: its columns are the sensor's rows
        assert_eq!(field(&block, Tag::FocalPlaneXResolution).unwrap(), "6001");
        for gone in [Tag::MakerNote, Tag::SubjectArea, Tag::ImageWidth] {
            assert_eq!(field(&block, gone), None, "{gone}");
        }
        let exif = exif::Reader::new().read_raw(block).unwrap();
        assert!(exif.fields().all(|field| field.ifd_num == exif::In::PRIMARY), "no thumbnail directory");
    }
}

#[test]
fn profile_and_camera_of_a_real_photograph_survive() {
    let Some(path) = shared("coffee6/0000.jpg") else { return };
    let source = metadata(&std::fs::read(path).unwrap());
    let ours = source.for_output(64, 48);
    let raster = picture(64, 48, 4, false);
    for out in [png_of(&raster, &ours), tiff_of(&raster, &ours)] {
        let back = metadata(&out);
        let block = back.exif.unwrap();
        assert_eq!(field(&block, exif::Tag::Make).unwrap(), "\"Canon\"");
        assert_eq!(field(&block, exif::Tag::Model).unwrap(), "\"Canon EOS 5D Mark II\"");
        assert!(back.icc.is_some());
        assert_eq!(back.icc, source.icc);
    }
}

fn orientation_of(block: &[u8]) -> u8 {
    exif_block::orientation(block).unwrap_or(1)
}

#[test]
fn a_small_block_that_stands_for_gigabytes_is_cut_short() {
    // 3,000 entries of the Exif directory, all of which show the same 40,000 bytes
    let mut block = b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1A\0\0\0\0\0\0\0".to_vec();
    block.extend(3_000u16.to_le_bytes());
    for number in 0..3_000u16 {
        block.extend((0x4000 + number).to_le_bytes());
        block.extend([7, 0]);
        block.extend(40_000u32.to_le_bytes());
        block.extend(64u32.to_le_bytes());
    }
    block.extend(vec![1; 40_100]);
    let written = Metadata { icc: None, exif: Some(block) }.for_output(8, 8).exif.unwrap();
    assert!((400_000..600_000).contains(&written.len()), "{} bytes", written.len());
}

#[test]
fn metadata_of_rubbish_is_absent() {
    assert_eq!(metadata(b"rubbish"), Metadata::default());
    let torn = with_exif(&encode_jpeg(&picture(8, 8, 1, false), 90), &exif_with(3)[..9]);
    assert_eq!(metadata(&torn).for_output(8, 8).exif.as_deref().map(orientation_of).unwrap_or(1), 1);
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(400))]
    #[test]
    fn damaged_pictures_never_panic(kind in 0..4usize, at in 0..4000usize, flip in 1..=255u8, cut in 0..5000usize) {
        let raster = picture(33, 21, 3, kind == 2);
        let metadata = Metadata { icc: Some(vec![7; 200]), exif: Some(exif_with(5)) };
        let mut bytes = match kind {
            0 => with_exif(&encode_jpeg(&raster, 80), &exif_with(8)),
            1 => png_of(&raster, &metadata),
            _ => tiff_of(&raster, &metadata),
        };
        let at = at % bytes.len();
        bytes[at] ^= flip;
        if cut < 1000 {
            bytes.truncate(bytes.len() * cut / 1000);
        }
        let limits = Limits { max_pixels: 1_000_000, ..Limits::default() };
        let _ = probe(Cursor::new(&bytes), &limits);
        let _ = decode(&bytes, &limits);
        let _ = super::metadata(&bytes).for_output(5, 6);
    }
}

#[test]
fn a_decoder_that_panics_means_a_damaged_file() {
    let refused = unpanicked(Format::Tiff, || -> Result<(), ImageFault> { panic!("an assertion of a decoder") });
    assert!(matches!(refused, Err(ImageFault::Damaged { format: Format::Tiff, .. })));
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

#[test]
fn progressive_and_restarted_jpegs_that_are_cut_are_refused() {
    for bytes in CODED {
        for cut in 0..bytes.len() {
            assert!(decoded(&bytes[..cut]).is_err(), "{cut} of {}", bytes.len());
        }
    }
}

#[test]
fn a_jpeg_stored_colour_by_colour_is_refused_because_its_last_rows_would_be_lost() {
    let fault = decoded(include_bytes!("testdata/one_by_one.jpg")).unwrap_err();
    assert!(fault.to_string().contains("colour by colour"), "{fault}");
}
