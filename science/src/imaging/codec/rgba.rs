//! Pictures with their alpha channel: the results of the service, which are read back for conversion and comparison.
//!
//! [`decode`](super::decode) is for slices. It drops alpha, and it refuses torn files more strictly than the decoders
//! of the `image` crate do, which are used here.

use std::io::Cursor;

use image::{DynamicImage, ImageReader};

use super::{
    fault::{ImageFault, catch_panic},
    header::Limits,
    sniff,
};
use crate::imaging::Raster;

/// Decodes a JPEG, PNG or TIFF to 1 (grey), 3 (RGB) or 4 (RGBA, straight alpha) channels of 8 or 16 bits. The EXIF
/// orientation is not applied: results have none.
///
/// # Errors
/// An [`ImageFault`] when the file is no such picture, breaks a limit or is damaged.
pub fn decode_rgba(bytes: &[u8], limits: &Limits) -> Result<Raster, ImageFault> {
    let format = sniff::format_of(&mut Cursor::new(bytes))?;
    let image = catch_panic(format, || {
        let damaged = || ImageFault::damaged(format, "its data cannot be decoded");
        let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|_| damaged())?;
        reader.limits(reader_limits(limits));
        reader.decode().map_err(|_| damaged())
    })?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok(match image {
        DynamicImage::ImageLuma8(i) => Raster::eight(width, height, 1, i.into_raw()),
        DynamicImage::ImageRgb8(i) => Raster::eight(width, height, 3, i.into_raw()),
        DynamicImage::ImageRgba8(i) => Raster::eight(width, height, 4, i.into_raw()),
        DynamicImage::ImageLuma16(i) => Raster::sixteen(width, height, 1, i.into_raw()),
        DynamicImage::ImageRgb16(i) => Raster::sixteen(width, height, 3, i.into_raw()),
        DynamicImage::ImageRgba16(i) => Raster::sixteen(width, height, 4, i.into_raw()),
        other => {
            return Err(ImageFault::unsupported(format!(
                "the {format} has {} bits per pixel",
                other.color().bits_per_pixel()
            )));
        }
    })
}

fn reader_limits(limits: &Limits) -> image::Limits {
    let mut reader = image::Limits::default();
    reader.max_image_width = Some(limits.max_width);
    reader.max_image_height = Some(limits.max_height);
    reader.max_alloc = Some(limits.max_bytes() as u64);
    reader
}
