//! Colour spaces that pictures declare in any way, and the profile of outputs.

use std::io::Cursor;

use pinstack_science::imaging::{
    Raster,
    codec::{self, ColourSpace, Limits},
};

use crate::{
    odd_files::{
        BYTES, TEXT, Tag, UNDEFINED, adobe_exif, exif, grey_profile, longs, ratios, shorts, tiff, with_chunk, with_exif,
    },
    odd_pictures::{HEIGHT, Outcome::Pixels, WIDTH, check, picture, plain, png, small},
};

#[test]
fn a_colour_space_is_known_by_any_mark() {
    let numbers = |values: &[u32]| values.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<u8>>();
    let srgb = numbers(&[31_270, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000]);
    let adobe = numbers(&[31_270, 32_900, 64_000, 33_000, 21_000, 71_000, 15_000, 6_000]);
    let (white, primaries) =
        (ratios(318, &[0.3127, 0.329]), |g: [f64; 2]| ratios(319, &[0.64, 0.33, g[0], g[1], 0.15, 0.06]));
    let plain_png = png(&picture(), None);
    let marked = |chunks: &[(&[u8; 4], &[u8])]| {
        chunks.iter().fold(plain_png.clone(), |file, (kind, data)| with_chunk(&file, kind, data))
    };
    let tagged = |exif_tags: &[Tag]| with_exif(&plain_png, &exif(&[], exif_tags, &[]));
    let power = |gamma: u32| numbers(&[gamma]);
    let profile = codec::metadata(&with_exif(&plain_png, &adobe_exif())).icc.expect("a profile");
    let rows: Vec<(&str, Vec<u8>, ColourSpace)> = vec![
        ("nothing", plain_png.clone(), ColourSpace::Srgb),
        ("R03", with_exif(&plain_png, &adobe_exif()), ColourSpace::AdobeRgb),
        ("ColorSpace 2", tagged(&[shorts(0xA001, &[2])]), ColourSpace::AdobeRgb),
        ("ColorSpace 1", tagged(&[shorts(0xA001, &[1])]), ColourSpace::Srgb),
        ("ColorSpace uncalibrated alone", tagged(&[shorts(0xA001, &[65_535])]), ColourSpace::Unknown),
        ("a profile", png(&picture(), Some(profile.clone())), ColourSpace::AdobeRgb),
        (
            "a profile against EXIF",
            with_exif(&png(&picture(), Some(profile)), &exif(&[], &[shorts(0xA001, &[1])], &[])),
            ColourSpace::AdobeRgb,
        ),
        ("cHRM and gAMA of Adobe", marked(&[(b"cHRM", &adobe), (b"gAMA", &power(45_470))]), ColourSpace::AdobeRgb),
        ("cHRM and gAMA of sRGB", marked(&[(b"cHRM", &srgb), (b"gAMA", &power(45_455))]), ColourSpace::Srgb),
        ("gAMA of sRGB", marked(&[(b"gAMA", &power(45_455))]), ColourSpace::Srgb),
        ("sRGB against cHRM", marked(&[(b"cHRM", &adobe), (b"sRGB", &[0])]), ColourSpace::Srgb),
        ("cICP of sRGB", marked(&[(b"cICP", &[1, 13, 0, 1])]), ColourSpace::Srgb),
        ("cICP of HDR", marked(&[(b"cICP", &[9, 16, 0, 1])]), ColourSpace::Unknown),
        ("TIFF: tags of Adobe", tiff(&[plain(&[white.clone(), primaries([0.21, 0.71])])]), ColourSpace::AdobeRgb),
        ("TIFF: tags of sRGB", tiff(&[plain(&[white.clone(), primaries([0.3, 0.6])])]), ColourSpace::Srgb),
        (
            "TIFF: a transfer function",
            tiff(&[plain(&[white, primaries([0.3, 0.6]), shorts(301, &[7; 256])])]),
            ColourSpace::Unknown,
        ),
        (
            "TIFF: a profile for CMYK",
            tiff(&[plain(&[(34_675, BYTES, b"................CMYKLab ....".to_vec())])]),
            ColourSpace::Unknown,
        ),
    ];
    check(rows.into_iter().map(|(what, bytes, space)| (what, bytes, Pixels(picture(), space))).collect());
    for other in [
        marked(&[(b"gAMA", &power(100_000))]),
        marked(&[(b"cICP", &[12, 13, 0, 1])]),
        marked(&[(b"cICP", &[9, 8, 0, 1])]),
    ] {
        let header = codec::probe(Cursor::new(&other), &Limits::default()).expect("a PNG");
        assert!(matches!(header.colour, ColourSpace::Other(_)), "{:?}", header.colour);
        assert!(codec::metadata(&other).icc.is_some());
    }
}

#[test]
fn the_profile_of_grey_slices_is_kept_in_grey_and_in_colour() {
    let grey = Raster::eight(WIDTH, HEIGHT, 1, vec![77; WIDTH * HEIGHT]);
    let file = png(&grey, Some(grey_profile(1.0)));
    let header = codec::probe(Cursor::new(&file), &Limits::default()).expect("a PNG");
    assert!(matches!(header.colour, ColourSpace::Other(_)), "{:?}", header.colour);
    let source = codec::metadata(&file);
    assert_eq!(source.icc, Some(grey_profile(1.0)));
    let mut out = Vec::new();
    codec::encode_png(&mut out, &picture(), &source).expect("a PNG");
    let profile = codec::metadata(&out).icc.expect("a profile");
    assert_eq!(&profile[16..20], b"RGB ");
    // the curve of the grey profile, for each colour
    let curves = profile.windows(14).filter(|bytes| *bytes == b"curv\0\0\0\0\0\0\0\x01\x01\0").count();
    assert_eq!(curves, 1, "one curve, which all colours share");
    assert_eq!([b"rTRC", b"gTRC", b"bTRC"].map(|tag| profile.windows(4).filter(|four| *four == tag).count()), [1; 3]);
    // of another curve, and that of sRGB, which needs no word
    assert_ne!(
        codec::probe(Cursor::new(png(&grey, Some(grey_profile(2.2)))), &Limits::default()).expect("a PNG").colour,
        header.colour
    );
}
#[test]
fn the_metadata_of_a_tiff_are_those_of_the_page_that_is_the_picture() {
    let make = |name: &str| (271, TEXT, format!("{name}\0").into_bytes());
    let profile =
        (34_675, UNDEFINED, codec::metadata(&with_exif(&png(&picture(), None), &adobe_exif())).icc.expect("one"));
    let thumbnail = small(&[longs(254, &[1]), make("of the thumbnail")]);
    let file = tiff(&[thumbnail, plain(&[make("of the picture"), profile.clone()])]);
    let found = codec::metadata(&file);
    assert_eq!(found.icc, Some(profile.2));
    let text = String::from_utf8_lossy(&found.exif.expect("a block")).into_owned();
    assert!(text.contains("of the picture") && !text.contains("thumbnail"), "{text:?}");
}

#[test]
fn a_tiff_says_adobe_rgb_in_its_exif_directory() {
    let of = |space: u16| {
        let block = exif(&[], &[shorts(0xA001, &[space])], &[]);
        let mut out = Cursor::new(Vec::new());
        let metadata = codec::Metadata { icc: None, exif: Some(block) };
        codec::encode_tiff(&mut out, &picture(), &metadata).expect("a TIFF");
        out.into_inner()
    };
    check(vec![
        ("2", of(2), Pixels(picture(), ColourSpace::AdobeRgb)),
        ("1", of(1), Pixels(picture(), ColourSpace::Srgb)),
        ("65535", of(65_535), Pixels(picture(), ColourSpace::Unknown)),
    ]);
}

#[test]
fn a_jpeg_that_lacks_a_part_of_its_profile_is_in_an_unknown_space() {
    let profile = codec::metadata(&with_exif(&png(&picture(), None), &adobe_exif())).icc.expect("a profile");
    let with_part = |number: u8, count: u8| {
        let data = [&b"ICC_PROFILE\0"[..], &[number, count], &profile].concat();
        let file = codec::encode_jpeg(&picture(), 95);
        let length = (data.len() as u16 + 2).to_be_bytes();
        let bytes = [&file[..2], &[0xFF, 0xE2], &length, &data, &file[2..]].concat();
        codec::probe(Cursor::new(bytes), &Limits::default()).expect("a JPEG").colour
    };
    assert_eq!(with_part(1, 1), ColourSpace::AdobeRgb);
    assert_eq!(with_part(1, 2), ColourSpace::Unknown);
}
