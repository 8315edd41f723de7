//! Writes JPEG: results, previews, and the slices of rendered stacks.

use std::{
    io::{self, Write},
    ops::RangeInclusive,
};

use image::{
    ExtendedColorType, GenericImageView, ImageEncoder, ImageError, Luma, PixelWithColorType, Rgb,
    codecs::jpeg::JpegEncoder,
};

use crate::imaging::{
    Raster, Samples,
    codec::{Metadata, exif_block},
};

/// Sides that JPEG supports, px.
const SIDES: RangeInclusive<usize> = 1..=65_535;

/// Maximum size of EXIF, bytes: the capacity of one segment.
const MAX_EXIF_BYTES: usize = 65_533 - 6;

/// Maximum size of an ICC profile, bytes: the capacity of 255 segments.
const MAX_ICC_BYTES: usize = 255 * (65_533 - 14);

/// Writes a baseline JPEG of `quality` 1 to 100 with full colour resolution (4:4:4), the EXIF block, and the ICC
/// profile if it is for the same number of channels. Alpha is dropped; colours are written as stored. 16 bits are
/// rounded to 8. Pixels are converted block by block, without a second copy. EXIF values that do not fit into a JPEG
/// are dropped, the longest first.
///
/// # Errors
/// Any I/O error of `out`, and [`io::ErrorKind::InvalidInput`] for sides beyond 65,535 px and for other numbers of
/// channels than 1, 3 and 4.
pub fn write_jpeg(out: impl Write, raster: &Raster, metadata: &Metadata, quality: u8) -> io::Result<()> {
    let fits = SIDES.contains(&raster.width) && SIDES.contains(&raster.height);
    if !fits || !matches!(raster.channels, 1 | 3 | 4) {
        let shape = format!("{} x {} px of {} channels", raster.width, raster.height, raster.channels);
        return Err(io::Error::new(io::ErrorKind::InvalidInput, shape));
    }
    let mut encoder = JpegEncoder::new_with_quality(out, quality.clamp(1, 100));
    if let Some(icc) = metadata.icc_for(raster.channels).filter(|icc| icc.len() <= MAX_ICC_BYTES) {
        encoder.set_icc_profile(icc.into_owned()).map_err(|error| io_error(ImageError::Unsupported(error)))?;
    }
    if let Some(exif) = metadata.exif.as_deref().and_then(|block| exif_block::within(block, MAX_EXIF_BYTES)) {
        encoder.set_exif_metadata(exif).map_err(|error| io_error(ImageError::Unsupported(error)))?;
    }
    let written = match raster.channels {
        1 => encoder.encode_image(&View { raster, pixel: |at| Luma([sample(raster, at)]) }),
        _ => encoder.encode_image(&View { raster, pixel: |at| Rgb([0, 1, 2].map(|c| sample(raster, at + c))) }),
    };
    written.map_err(io_error)
}

/// A raster as a pixel source for the encoder.
struct View<'a, F> {
    raster: &'a Raster,
    /// The pixel whose first sample has this index.
    pixel: F,
}

impl<P: PixelWithColorType<Subpixel = u8>, F: Fn(usize) -> P> GenericImageView for View<'_, F> {
    type Pixel = P;

    fn dimensions(&self) -> (u32, u32) {
        (self.raster.width as u32, self.raster.height as u32)
    }

    fn get_pixel(&self, x: u32, y: u32) -> P {
        (self.pixel)((y as usize * self.raster.width + x as usize) * self.raster.channels)
    }
}

fn sample(raster: &Raster, at: usize) -> u8 {
    match &raster.samples {
        Samples::Eight(samples) => samples[at],
        Samples::Sixteen(samples) => ((u32::from(samples[at]) + 128) / 257) as u8,
    }
}

fn io_error(error: ImageError) -> io::Error {
    match error {
        ImageError::IoError(error) => error,
        other => io::Error::new(io::ErrorKind::InvalidInput, other),
    }
}

/// Encodes a JPEG of `quality` 1 to 100. 16 bits are rounded to 8. Pictures with alpha are laid over white, as web
/// pages show them.
///
/// # Panics
/// For sides of 0 or beyond 65,535 px.
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
