//! Colour spaces of slices and outputs.

use super::*;

use pinstack_science::imaging::codec::{ColourSpace, Limits, probe};

/// The members of the front light with another block of EXIF (in `icc`: profile) in each.
fn marked(metadata: &Metadata) -> Vec<(String, Vec<u8>)> {
    let slice = |slice: &Raster| {
        let mut out = Vec::new();
        codec::encode_png(&mut out, slice, metadata).expect("a PNG");
        out
    };
    stack().front.iter().enumerate().map(|(i, of)| (format!("front/img_{i}.png"), slice(of))).collect()
}

/// An EXIF block with `ColorSpace`.
fn colour_space(value: u8) -> Vec<u8> {
    let mut out = b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1A\0\0\0\0\0\0\0".to_vec();
    out.extend([1, 0, 0x01, 0xA0, 3, 0, 1, 0, 0, 0, value, 0, 0, 0, 0, 0, 0, 0]);
    out
}

#[test]
fn adobe_rgb_that_only_exif_declares_is_in_the_profile_of_every_output() {
    let archive = zip(marked(&Metadata { icc: None, exif: Some(colour_space(2)) }));
    let mut first: Option<Vec<u8>> = None;
    for (format, name) in [(ImageFormat::Png, "png"), (ImageFormat::Tiff, "tiff"), (ImageFormat::Jpeg, "jpeg")] {
        let job = TestJob::stack(&archive, StackOptions { format, ..options() });
        let (output, _) = done(&job);
        for artifact in ["image", "preview"] {
            let bytes = file(&output, artifact).1;
            let header = probe(std::io::Cursor::new(&bytes), &Limits::default()).expect("a picture");
            assert_eq!(header.colour, ColourSpace::AdobeRgb, "{artifact} of {name}");
            let icc = codec::metadata(&bytes).icc.expect("a profile");
            assert_eq!(first.get_or_insert(icc.clone()), &icc, "{artifact} of {name}");
        }
        assert!(!output.warnings.iter().any(|warning| warning.code == "mixed_colour_spaces"));
    }
}

#[test]
fn slices_of_several_colour_spaces_and_of_unknown_ones_are_named() {
    let warnings = |odd: u8| {
        let mut members = marked(&Metadata::default());
        members[3] = marked(&Metadata { icc: None, exif: Some(colour_space(odd)) }).swap_remove(3);
        let (output, _) = done(&TestJob::stack(&zip(members), options()));
        output.warnings.into_iter().filter(|warning| warning.code.as_str().contains("colour_space")).collect::<Vec<_>>()
    };
    let told = warnings(2);
    assert_eq!((told.len(), told[0].code.as_str()), (1, "mixed_colour_spaces"));
    assert!(told[0].detail.contains("front/img_3.png is in Adobe RGB"), "{}", told[0].detail);
    assert_eq!(warnings(1), []);
    let told = warnings(255);
    let codes: Vec<&str> = told.iter().map(|warning| warning.code.as_str()).collect();
    assert_eq!(codes, ["mixed_colour_spaces", "unknown_colour_space"]);
    assert!(told[1].detail.starts_with("1 of 5 slices has a colour space that is not known"), "{}", told[1].detail);
}
