//! JPEG out: small pictures for pages, and the JPEG slices of rendered stacks.

use image::{ExtendedColorType, codecs::jpeg::JpegEncoder};

use crate::imaging::{Raster, Samples};

/// Encodes a JPEG of `quality` 1 to 100. 16 bits are rounded to 8. Pictures with alpha are laid over white, which
/// is how a page shows them.
///
/// # Panics
/// Never for a raster that its own constructors accept and whose sides are 1 to 65,535 px.
pub fn encode_jpeg(raster: &Raster, quality: u8) -> Vec<u8> {
    let eight: std::borrow::Cow<'_, [u8]> = match &raster.samples {
        Samples::Eight(samples) => samples.into(),
        Samples::Sixteen(samples) => samples.iter().map(|&v| ((u32::from(v) + 128) / 257) as u8).collect(),
    };
    let (samples, color) = match raster.channels {
        1 => (eight, ExtendedColorType::L8),
        3 => (eight, ExtendedColorType::Rgb8),
        _ => (over_white(&eight).into(), ExtendedColorType::Rgb8),
    };
    let mut out = Vec::new();
    JpegEncoder::new_with_quality(&mut out, quality.clamp(1, 100))
        .encode(&samples, raster.width as u32, raster.height as u32, color)
        .expect("writing to memory does not fail, and the samples fit the shape");
    out
}

fn over_white(rgba: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(rgba.len() / 4 * 3);
    for pixel in rgba.chunks_exact(4) {
        let alpha = u32::from(pixel[3]);
        out.extend(pixel[..3].iter().map(|&v| ((u32::from(v) * alpha + 255 * (255 - alpha) + 127) / 255) as u8));
    }
    out
}
