//! Metadata: orientation, colour profile, camera.

use std::path::{Path, PathBuf};

use super::*;

fn shared(path: &str) -> Vec<u8> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let file = std::env::var_os("PINSTACK_SHARED").map_or_else(beside, PathBuf::from).join("data").join(path);
    std::fs::read(file).expect("a picture of PINSTACK_SHARED")
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
fn a_profile_for_other_colours_is_not_written() {
    let mut icc = vec![0; 132];
    icc[16..20].copy_from_slice(b"GRAY");
    let given = Metadata { icc: Some(icc.clone()), exif: None };
    let grey = png_of(&picture(4, 4, 1, false), &given);
    let colour = png_of(&picture(4, 4, 3, false), &given);
    assert_eq!(metadata(&grey).icc, Some(icc));
    assert_eq!(metadata(&colour).icc, None);
}

#[test]
fn camera_lens_and_exposure_survive_while_what_belongs_to_the_old_file_does_not() {
    use exif::Tag;
    let jpeg = with_exif(&encode_jpeg(&picture(16, 16, 3, false), 90), &camera_block());
    let source = metadata(&jpeg);
    let before = source.exif.clone().unwrap();
    let ours = source.for_output(64, 48, &OutputCamera::default());
    let raster = picture(64, 48, 4, true);
    for out in [png_of(&raster, &ours), tiff_of(&raster, &ours), jpeg_of(&raster, &ours)] {
        let block = metadata(&out).exif.unwrap();
        for tag in [
            Tag::Make,
            Tag::Model,
            Tag::DateTime,
            Tag::FNumber,
            Tag::ExposureTime,
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
        // the principal distance is unknown, and a wrong focal length is worse than none
        for gone in [Tag::MakerNote, Tag::SubjectArea, Tag::ImageWidth, Tag::FocalLength] {
            assert_eq!(field(&block, gone), None, "{gone}");
        }
        let exif = exif::Reader::new().read_raw(block).unwrap();
        assert!(exif.fields().all(|field| field.ifd_num == exif::In::PRIMARY), "no thumbnail directory");
    }
}

/// What a program computes that divides the focal length by the size of a pixel, px.
fn focal_px(block: &[u8]) -> Option<f64> {
    let exif = exif::Reader::new().read_raw(block.to_vec()).unwrap();
    let number = |tag| match &exif.get_field(tag, exif::In::PRIMARY)?.value {
        exif::Value::Rational(ratios) => Some(ratios[0].to_f64()),
        _ => None,
    };
    assert_eq!(field(block, exif::Tag::FocalPlaneResolutionUnit)?, "inch");
    Some(number(exif::Tag::FocalLength)? * number(exif::Tag::FocalPlaneXResolution)? / 25.4)
}

#[test]
fn principal_distance_and_pixel_pitch_of_the_profile_replace_what_the_camera_said() {
    use exif::Tag;
    let camera = |distance, pitch| OutputCamera {
        principal_distance_mm: distance,
        pixel_pitch_mm: pitch,
        software: "pinstack 1.2.3",
    };
    let with_camera = Metadata { icc: None, exif: Some(camera_block()) };
    let raster = picture(64, 48, 4, false);
    for source in [&with_camera, &Metadata::default()] {
        let ours = source.for_output(64, 48, &camera(Some(121.37), Some(0.0041)));
        for out in [png_of(&raster, &ours), tiff_of(&raster, &ours), jpeg_of(&raster, &ours)] {
            let block = metadata(&out).exif.unwrap();
            let focal = focal_px(&block).unwrap();
            assert!((focal / (121.37 / 0.0041) - 1.0).abs() < 1e-4, "{focal}");
            assert_eq!(field(&block, Tag::PixelXDimension).unwrap(), "64");
            assert_eq!(field(&block, Tag::Software).unwrap(), "\"pinstack 1.2.3\"");
            assert_eq!(field(&block, Tag::FocalLengthIn35mmFilm), None);
            // by the model COLMAP 3.8 would find another size of the sensor
            assert_eq!(field(&block, Tag::Model), None);
            assert_eq!(orientation_of(&block), 1);
        }
    }
    let block = with_camera.for_output(64, 48, &camera(Some(121.37), Some(0.0041))).exif.unwrap();
    assert_eq!(field(&block, Tag(exif::Context::Tiff, 0xC614)).unwrap(), "\"Canon EOS 5DS\"");

    let block = with_camera.for_output(64, 48, &camera(Some(121.37), None)).exif.unwrap();
    assert_eq!(field(&block, Tag::FocalLength).unwrap(), "121.37");
    assert_eq!(field(&block, Tag::Model).unwrap(), "\"Canon EOS 5DS\"");
    let block = with_camera.for_output(64, 48, &camera(None, Some(0.0041))).exif.unwrap();
    assert_eq!(field(&block, Tag::FocalLength), None);
    assert!(field(&block, Tag::FocalPlaneXResolution).unwrap().starts_with("6195."));
}

#[test]
fn a_png_names_its_maker_in_a_text_chunk() {
    let camera = OutputCamera { software: "pinstack 1.2.3", ..OutputCamera::default() };
    let file = png_of(&picture(4, 4, 3, false), &Metadata::default().for_output(4, 4, &camera));
    let reader = ::png::Decoder::new(Cursor::new(&file)).read_info().unwrap();
    let texts = &reader.info().uncompressed_latin1_text;
    assert_eq!((texts[0].keyword.as_str(), texts[0].text.as_str()), ("Software", "pinstack 1.2.3"));
}

#[test]
fn a_jpeg_keeps_colour_at_full_resolution() {
    let file = jpeg_of(&picture(40, 24, 4, true), &Metadata::default());
    let frame = file.windows(2).position(|pair| pair == [0xFF, 0xC0]).expect("a baseline frame");
    let [components, sampling] = [file[frame + 9], file[frame + 11]];
    assert_eq!((components, sampling, file[frame + 14], file[frame + 17]), (3, 0x11, 0x11, 0x11));
}

#[test]
fn a_jpeg_drops_the_longest_values_that_its_segment_cannot_hold() {
    use exif::{Field, In, Tag, Value};
    let long = Field { tag: Tag::UserComment, ifd_num: In::PRIMARY, value: Value::Undefined(vec![32; 60_000], 0) };
    let other =
        Field { tag: Tag::RelatedSoundFile, ifd_num: In::PRIMARY, value: Value::Ascii(vec![vec![b'x'; 60_000]]) };
    let make = Field { tag: Tag::Make, ifd_num: In::PRIMARY, value: Value::Ascii(vec![b"Canon".to_vec()]) };
    let block = exif_block::written(&[long, other, make], true).unwrap();
    let ours = Metadata { icc: None, exif: Some(block) }.for_output(8, 8, &OutputCamera::default());
    let block = metadata(&jpeg_of(&picture(8, 8, 3, false), &ours)).exif.unwrap();
    assert_eq!(field(&block, Tag::Make).unwrap(), "\"Canon\"");
    assert_eq!(field(&block, Tag::UserComment), None);
}

#[test]
#[ignore = "needs the pictures of PINSTACK_SHARED"]
fn profile_and_camera_of_a_real_photograph_survive() {
    let source = metadata(&shared("coffee6/0000.jpg"));
    let ours = source.for_output(64, 48, &OutputCamera::default());
    let raster = picture(64, 48, 4, false);
    for out in [png_of(&raster, &ours), tiff_of(&raster, &ours), jpeg_of(&raster, &ours)] {
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
    let written = Metadata { icc: None, exif: Some(block) }.for_output(8, 8, &OutputCamera::default()).exif.unwrap();
    assert!((400_000..600_000).contains(&written.len()), "{} bytes", written.len());
}

#[test]
fn metadata_of_rubbish_is_absent() {
    assert_eq!(metadata(b"rubbish"), Metadata::default());
    let torn = with_exif(&encode_jpeg(&picture(8, 8, 1, false), 90), &exif_with(3)[..9]);
    assert_eq!(
        metadata(&torn).for_output(8, 8, &OutputCamera::default()).exif.as_deref().map(orientation_of).unwrap_or(1),
        1
    );
}
