//! Image files: reads and writes JPEG, PNG and TIFF with 8 and 16 bits, ICC profile and EXIF.
//!
//! Input is untrusted. Sizes are checked against [`Limits`] before memory is allocated. A truncated file is refused
//! instead of being completed with grey. Files whose colours cannot be reproduced (CMYK, Lab, camera raw, ...) are
//! refused with a message that says what to do.

mod alpha;
mod colour_space;
mod colour_tags;
mod encode;
mod exif_block;
mod exif_output;
mod fault;
mod file_metadata;
mod header;
mod icc;
mod icc_parts;
mod jpeg;
mod orientation;
mod png;
mod rgb_space;
mod rgba;
mod sniff;
mod tiff;
mod tiff_colours;
mod tiff_lists;
mod tiff_tiles;

use std::{
    borrow::Cow,
    io::{BufRead, Cursor, Seek},
};

use super::Raster;
use fault::catch_panic;

pub use colour_space::ColourSpace;
pub use encode::{encode_jpeg, encode_png, encode_tiff, write_jpeg};
pub use exif_output::OutputCamera;
pub use fault::ImageFault;
pub use file_metadata::Metadata;
pub use header::{CaptureTime, Format, Header, Limits};
pub use rgba::decode_rgba;
pub use sniff::{is_picture_name, raw_extension};

/// Bytes beyond the file that [`decode_into`] needs in the memory of a JPEG.
pub const JPEG_ROOM: usize = jpeg::guarded::APPENDED;

/// Reads the header of a picture, and no more bytes than necessary.
///
/// # Errors
/// An [`ImageFault`] when the file is not a picture, is not supported, exceeds a limit, or ends within its header.
pub fn probe(mut reader: impl BufRead + Seek, limits: &Limits) -> Result<Header, ImageFault> {
    let format = sniff::format_of(&mut reader)?;
    catch_panic(format, || match format {
        Format::Jpeg => jpeg::probe(reader, limits),
        Format::Png => png::probe(reader, limits),
        Format::Tiff => tiff::probe(reader, limits),
    })
}

/// Decodes a picture to 1 (grey) or 3 (RGB) channels of 8 or 16 bits. The EXIF orientation is applied, palettes are
/// expanded, and alpha is dropped if every pixel is opaque; else the picture is refused.
///
/// # Errors
/// As [`probe`], and when the pixels are truncated or damaged.
///
/// # Example
/// ```
/// use pinstack_science::imaging::{Raster, codec};
///
/// let picture = Raster::sixteen(4, 3, 1, (0..12).collect());
/// let mut tiff = std::io::Cursor::new(Vec::new());
/// codec::encode_tiff(&mut tiff, &picture, &codec::Metadata::default())?;
/// assert_eq!(codec::decode(&tiff.into_inner(), &codec::Limits::default()), Ok(picture));
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn decode(bytes: &[u8], limits: &Limits) -> Result<Raster, ImageFault> {
    decode_any(Cow::Borrowed(bytes), limits, Vec::new())
}

/// The same as [`decode`]. A JPEG of a `Vec` with room for [`JPEG_ROOM`] more bytes is decoded without a copy of the
/// file. The samples of a JPEG are in the memory of `buffer` if it is large enough; the contents of `buffer` are lost.
///
/// # Errors
/// As [`decode`].
pub fn decode_into(bytes: Vec<u8>, limits: &Limits, buffer: Vec<u8>) -> Result<Raster, ImageFault> {
    decode_any(Cow::Owned(bytes), limits, buffer)
}

fn decode_any(bytes: Cow<'_, [u8]>, limits: &Limits, buffer: Vec<u8>) -> Result<Raster, ImageFault> {
    let format = sniff::format_of(&mut Cursor::new(&*bytes))?;
    let length = bytes.len() as u64;
    let (raster, orientation) = catch_panic(format, || match format {
        Format::Jpeg => jpeg::decode(bytes, limits, buffer),
        Format::Png => png::decode(Cursor::new(&*bytes), length, limits),
        Format::Tiff => tiff::decode(Cursor::new(&*bytes), length, limits),
    })?;
    Ok(orientation::apply(raster, orientation))
}

/// The same as [`decode`] for a file of `length` bytes that is read while it is decoded, so that it is never in memory
/// as a whole. `None` for formats that are only decoded from memory (JPEG). `reader` is at the start of the file; it
/// seeks, so it should not be slow at that.
///
/// # Errors
/// As [`decode`]; [`ImageFault::Unreadable`] with the error of the reader.
pub fn decode_while_reading(
    mut reader: impl BufRead + Seek,
    length: u64,
    limits: &Limits,
) -> Result<Option<Raster>, ImageFault> {
    let format = sniff::format_of(&mut reader)?;
    let decoded = catch_panic(format, || match format {
        Format::Jpeg => Ok(None),
        Format::Png => png::decode(reader, length, limits).map(Some),
        Format::Tiff => tiff::decode(reader, length, limits).map(Some),
    })?;
    Ok(decoded.map(|(raster, orientation)| orientation::apply(raster, orientation)))
}

/// The ICC profile and the EXIF block of a file. Never fails: unreadable parts are absent.
pub fn metadata(bytes: &[u8]) -> Metadata {
    let Ok(format) = sniff::format_of(&mut Cursor::new(bytes)) else { return Metadata::default() };
    let read = catch_panic(format, || {
        Ok(match format {
            Format::Jpeg => jpeg::metadata(bytes),
            Format::Png => png::metadata(bytes),
            Format::Tiff => tiff::metadata(bytes),
        })
    });
    read.unwrap_or_default()
}

#[cfg(test)]
mod tests;
