//! What is cut, damaged, absurd or of a kind that would come out wrong.

use super::*;

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
fn unsupported_files_are_refused_with_a_message_that_says_what_to_do() {
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

    // another PhotometricInterpretation (262): palette, Lab
    for (interpretation, named) in [(3, "a palette picture"), (8, "Lab"), (9, "Lab"), (10, "Lab")] {
        let mut out = Cursor::new(Vec::new());
        let mut encoder = ::tiff::encoder::TiffEncoder::new(&mut out).unwrap();
        encoder.write_image::<::tiff::encoder::colortype::RGB8>(4, 4, &[9; 48]).unwrap();
        let mut tiff = out.into_inner();
        let entry = tiff.windows(8).position(|entry| entry == [6, 1, 3, 0, 1, 0, 0, 0]).unwrap();
        tiff[entry + 8] = interpretation;
        assert!(decoded(&tiff).unwrap_err().to_string().contains(named), "{interpretation}");
    }

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

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig::with_cases(400))]
    #[test]
    fn damaged_pictures_never_panic(kind in 0..4usize, at in 0..4000usize, flip in 1..=255u8, cut in 0..5000usize) {
        let raster = picture(33, 21, 3, kind == 2);
        let given = Metadata { icc: Some(vec![7; 200]), exif: Some(exif_with(5)) };
        let mut bytes = match kind {
            0 => with_exif(&encode_jpeg(&raster, 80), &exif_with(8)),
            1 => png_of(&raster, &given),
            _ => tiff_of(&raster, &given),
        };
        let at = at % bytes.len();
        bytes[at] ^= flip;
        if cut < 1000 {
            bytes.truncate(bytes.len() * cut / 1000);
        }
        let limits = Limits { max_pixels: 1_000_000, ..Limits::default() };
        let _ = probe(Cursor::new(&bytes), &limits);
        let _ = decode(&bytes, &limits);
        let _ = metadata(&bytes).for_output(5, 6, &OutputCamera::default());
    }
}

#[test]
fn a_decoder_that_panics_means_a_file_that_is_damaged_or_unusual() {
    let refused = catch_panic(Format::Tiff, || -> Result<(), ImageFault> { panic!("an assertion of a decoder") });
    assert_eq!(refused, Err(ImageFault::Undecodable(Format::Tiff)));
    let sentence = ImageFault::Undecodable(Format::Tiff).to_string();
    assert!(sentence.starts_with("the TIFF cannot be decoded: it is damaged, or of an unusual kind; "), "{sentence}");
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
    let fault = decoded(include_bytes!("../testdata/one_by_one.jpg")).unwrap_err();
    assert!(fault.to_string().contains("colour by colour"), "{fault}");
}
