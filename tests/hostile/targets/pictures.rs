//! Picture files.

use std::io::Cursor;

use pinstack::contract::Code;
use pinstack_science::imaging::{
    Raster, Samples,
    codec::{self, Header, ImageFault, Metadata},
};

use super::{limits, refused_with};

/// The header and the metadata: what is copied into results must be valid.
pub fn header(bytes: &[u8]) {
    match codec::probe(Cursor::new(bytes), &limits().image) {
        Ok(header) => judge(&header),
        Err(fault) => refused(&fault),
    }
    let metadata = codec::metadata(bytes).for_output(3, 2, &codec::OutputCamera::default());
    let picture = Raster::eight(3, 2, 3, (1..=18).collect());
    let mut png = Vec::new();
    codec::encode_png(&mut png, &picture, &metadata).expect("no metadata keep a PNG from being written");
    assert_eq!(codec::decode(&png, &limits().image).as_ref(), Ok(&picture));
    let mut tiff = Cursor::new(Vec::new());
    codec::encode_tiff(&mut tiff, &picture, &metadata).expect("no metadata keep a TIFF from being written");
    assert_eq!(codec::decode(tiff.get_ref(), &limits().image).as_ref(), Ok(&picture));
}

/// The pixels: the decoded raster matches the header.
pub fn decode(bytes: &[u8]) {
    let limits = limits().image;
    let header = codec::probe(Cursor::new(bytes), &limits);
    match codec::decode(bytes, &limits) {
        Ok(raster) => {
            let header = header.expect("what can be decoded has a header");
            let depth = match raster.samples {
                Samples::Eight(_) => 8,
                Samples::Sixteen(_) => 16,
            };
            let shape = (raster.width, raster.height, raster.channels, depth);
            let told = (header.width as usize, header.height as usize, usize::from(header.channels), header.bit_depth);
            assert_eq!(shape, told);
        }
        Err(fault) => refused(&fault),
    }
}

fn judge(header: &Header) {
    assert!(header.width > 0 && header.height > 0);
    assert!(u64::from(header.width) * u64::from(header.height) <= limits().image.max_pixels);
    assert!([1, 3].contains(&header.channels) && [8, 16].contains(&header.bit_depth));
    assert!((1..=8).contains(&header.orientation));
}

fn refused(fault: &ImageFault) {
    refused_with(&fault.in_file("slice", None).into(), &[Code::InvalidImage, Code::InvalidArchive]);
}

/// A small PNG.
pub fn png(width: usize, height: usize, channels: usize) -> Vec<u8> {
    let mut out = Vec::new();
    codec::encode_png(&mut out, &pattern(width, height, channels), &Metadata::default()).expect("a PNG");
    out
}

/// A small picture.
pub fn pattern(width: usize, height: usize, channels: usize) -> Raster {
    // transparent slices are refused, so alpha is opaque
    let is_alpha = |i: usize| channels == 4 && i % 4 == 3;
    let samples =
        (0..width * height * channels).map(|i| if is_alpha(i) { 255 } else { (i * 37 % 251) as u8 }).collect();
    Raster::eight(width, height, channels, samples)
}
