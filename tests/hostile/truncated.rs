//! JPEGs that were truncated and closed with an end marker: well-formed, but not complete.

use pinstack_science::imaging::{
    Raster, Samples,
    codec::{self, Format, ImageFault, Limits},
};

/// The same picture in three codings by another program, and a larger one whose last scan is a refinement.
const CODED: [&[u8]; 4] = [
    include_bytes!("../../science/src/imaging/codec/testdata/baseline.jpg"),
    include_bytes!("../../science/src/imaging/codec/testdata/restart.jpg"),
    include_bytes!("../../science/src/imaging/codec/testdata/progressive.jpg"),
    include_bytes!("testdata/progressive.jpg"),
];

const EOI: [u8; 2] = [0xFF, 0xD9];

fn closed(bytes: &[u8]) -> Vec<u8> {
    [bytes, &EOI].concat()
}

/// Maximum difference of a sample.
fn difference(a: &Raster, b: &Raster) -> u8 {
    let (Samples::Eight(a), Samples::Eight(b)) = (&a.samples, &b.samples) else { panic!("JPEGs have 8 bits") };
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

#[test]
fn truncated_and_closed_jpegs_are_refused_or_lack_only_their_last_bits() {
    let limits = Limits::default();
    for bytes in CODED {
        let whole = codec::decode(bytes, &limits).expect("sound");
        // the ends of long files are the interesting part of them
        let from = bytes.len().saturating_sub(1_500);
        for cut in from..bytes.len() - 2 {
            if let Ok(shown) = codec::decode(&closed(&bytes[..cut]), &limits) {
                let (lacking, differs) = (bytes.len() - 2 - cut, difference(&shown, &whole));
                println!("{cut}: {lacking} bytes lacking, samples differ by {differs}");
                // what the last code of the last scan says about blocks to which nothing more is added
                assert!(lacking <= 2 && differs <= 4, "{lacking} bytes lacking, samples differ by {differs}");
            }
        }
    }
}

#[test]
fn a_progressive_jpeg_without_its_last_scans_is_truncated() {
    for bytes in &CODED[2..] {
        let scans: Vec<usize> =
            bytes.windows(2).enumerate().filter(|(_, two)| *two == [0xFF, 0xDA]).map(|(at, _)| at).collect();
        assert!(scans.len() > 5, "{} scans", scans.len());
        for &end in &scans[1..] {
            let told = codec::decode(&closed(&bytes[..end]), &Limits::default());
            assert_eq!(told.err(), Some(ImageFault::Truncated(Format::Jpeg)), "closed at {end}");
        }
    }
}
