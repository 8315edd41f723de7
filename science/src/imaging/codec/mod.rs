//! Picture files: JPEG, PNG and TIFF in and out, 8 and 16 bits, with their ICC profile and EXIF.
//!
//! What comes in is not trusted: sizes are checked against [`Limits`] before anything is allocated, and a file that
//! is torn is refused instead of being filled up with grey. What cannot be shown in its right colours (CMYK, Lab,
//! camera raw, ...) is refused with a sentence that says what to do.

mod encode;
mod exif_block;
mod exif_output;
mod fault;
mod jpeg;
mod metadata;
mod orientation;
mod png;
mod rgba;
mod sniff;
mod tiff;
mod tiff_lists;

use std::io::{BufRead, Cursor, Seek};

use super::Raster;

pub use encode::{encode_jpeg, encode_png, encode_tiff, write_jpeg};
pub use exif_output::OutputCamera;
pub use fault::ImageFault;
pub use metadata::Metadata;
pub use rgba::decode_rgba;
pub use sniff::{is_picture_name, raw_extension};

/// Kinds of file that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// JPEG (baseline and progressive, Huffman coded, 8 bits).
    Jpeg,
    /// PNG.
    Png,
    /// TIFF and BigTIFF.
    Tiff,
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Jpeg => "JPEG",
            Self::Png => "PNG",
            Self::Tiff => "TIFF",
        })
    }
}

/// What the first bytes of a file tell about the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Columns, after the orientation is applied.
    pub width: u32,
    /// Rows, after the orientation is applied.
    pub height: u32,
    /// 1 grey or 3 RGB: what [`decode`] gives (alpha is dropped, palettes are looked up).
    pub channels: u8,
    /// 8 or 16.
    pub bit_depth: u8,
    /// Kind of file.
    pub format: Format,
    /// EXIF orientation as stored, 1 to 8; 1 when there is none.
    pub orientation: u8,
}

/// How large a picture may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Most columns.
    pub max_width: u32,
    /// Most rows.
    pub max_height: u32,
    /// Most pixels.
    pub max_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_width: 65_535, max_height: 65_535, max_pixels: 400_000_000 }
    }
}

impl Limits {
    /// Refuses sizes that are zero or over a limit.
    fn check(&self, width: u32, height: u32) -> Result<(), ImageFault> {
        if width == 0 || height == 0 {
            return Err(ImageFault::NoPixels { width, height });
        }
        let pixels = u64::from(width) * u64::from(height);
        if width > self.max_width || height > self.max_height || pixels > self.max_pixels {
            return Err(ImageFault::TooLarge { width, height, limits: *self });
        }
        Ok(())
    }

    /// Most bytes that a decoder may allocate for its result: four 16-bit channels.
    fn max_bytes(&self) -> usize {
        usize::try_from(self.max_pixels.saturating_mul(8)).unwrap_or(usize::MAX)
    }
}

/// Reads the header of a picture: only as many bytes as it takes.
///
/// # Errors
/// An [`ImageFault`] when the file is no picture, is of a kind that is not read, breaks a limit, or ends within
/// its header.
pub fn probe(mut reader: impl BufRead + Seek, limits: &Limits) -> Result<Header, ImageFault> {
    let format = sniff::format_of(&mut reader)?;
    unpanicked(format, || match format {
        Format::Jpeg => jpeg::probe(reader, limits),
        Format::Png => png::probe(reader, limits),
        Format::Tiff => tiff::probe(reader, limits),
    })
}

/// Decodes a picture to 1 (grey) or 3 (RGB) channels of 8 or 16 bits, upright: the EXIF orientation is applied,
/// alpha is dropped, palettes are looked up.
///
/// # Errors
/// An [`ImageFault`], as [`probe`] gives it, and when the pixels are torn or damaged.
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Raster, ImageFault> {
    let format = sniff::format_of(&mut Cursor::new(bytes))?;
    let (raster, orientation) = unpanicked(format, || match format {
        Format::Jpeg => jpeg::decode(bytes, limits),
        Format::Png => png::decode(bytes, limits),
        Format::Tiff => tiff::decode(bytes, limits),
    })?;
    Ok(orientation::apply(raster, orientation))
}

/// The ICC profile and the EXIF block of a file. Never fails: what cannot be read is absent.
pub fn metadata(bytes: &[u8]) -> Metadata {
    let Ok(format) = sniff::format_of(&mut Cursor::new(bytes)) else { return Metadata::default() };
    let read = unpanicked(format, || {
        Ok(match format {
            Format::Jpeg => jpeg::metadata(bytes),
            Format::Png => png::metadata(bytes),
            Format::Tiff => tiff::metadata(bytes),
        })
    });
    read.unwrap_or_default()
}

/// Runs a decoder of another crate on a file that is not trusted. Where it panics (assertions on odd layouts do
/// occur) the file is refused; nothing of the decoder is used afterwards, so nothing can be left half done.
fn unpanicked<T>(format: Format, decode: impl FnOnce() -> Result<T, ImageFault>) -> Result<T, ImageFault> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err(ImageFault::damaged(format, "its decoder gave up on it")))
}

#[cfg(test)]
mod tests;
