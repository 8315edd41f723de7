//! Reads PNG.

use std::io::{BufRead, Cursor, Seek};

use ::png::{BitDepth, ColorType, Decoder, DecodingError, Info, OutputInfo, Reader, Transformations};

use super::{Format, Header, ImageFault, Limits, Metadata, exif_block, orientation};
use crate::imaging::{Raster, simd};

/// Maximum memory of the decoder besides the pixels, bytes: compressed profiles can be bombs.
const MAX_CHUNK_BYTES: usize = 32 << 20;

/// Maximum expansion ratio of deflate. A file that declares more is truncated and refused before memory is allocated.
const LARGEST_RATIO: usize = 1_100;

fn open<R: BufRead + Seek>(reader: R, limits: &Limits) -> Result<Reader<R>, ImageFault> {
    let mut decoder = Decoder::new_with_limits(reader, ::png::Limits { bytes: MAX_CHUNK_BYTES });
    // palettes and 1, 2 and 4 bits become 8 bits; 16 bits stay
    decoder.set_transformations(Transformations::EXPAND);
    let first = decoder.read_header_info().map_err(|error| fault(&error))?;
    limits.check(first.width, first.height)?;
    decoder.read_info().map_err(|error| fault(&error))
}

fn fault(error: &DecodingError) -> ImageFault {
    match error {
        DecodingError::IoError(error) => ImageFault::from_io(Format::Png, error),
        other => ImageFault::damaged(Format::Png, other),
    }
}

fn header(info: &Info<'_>, limits: &Limits) -> Result<Header, ImageFault> {
    let channels = match info.color_type {
        ColorType::Grayscale | ColorType::GrayscaleAlpha => 1,
        ColorType::Rgb | ColorType::Rgba | ColorType::Indexed => 3,
    };
    let bit_depth = if info.bit_depth == BitDepth::Sixteen { 16 } else { 8 };
    let orientation = info.exif_metadata.as_deref().and_then(exif_block::orientation).unwrap_or(1);
    let taken = info.exif_metadata.as_deref().and_then(exif_block::taken);
    let (mut width, mut height) = (info.width, info.height);
    if orientation::swaps(orientation) {
        (width, height) = (height, width);
    }
    limits.check(width, height)?;
    Ok(Header { width, height, channels, bit_depth, format: Format::Png, orientation, taken })
}

pub(super) fn probe(reader: impl BufRead + Seek, limits: &Limits) -> Result<Header, ImageFault> {
    let reader = open(reader, limits)?;
    header(reader.info(), limits)
}

pub(super) fn metadata(bytes: &[u8]) -> Metadata {
    let Ok(reader) = open(Cursor::new(bytes), &Limits::default()) else { return Metadata::default() };
    let info = reader.info();
    Metadata {
        icc: info.icc_profile.as_ref().map(|icc| icc.to_vec()),
        exif: info.exif_metadata.as_ref().map(|exif| exif.to_vec()),
    }
}

/// The picture as stored, and its orientation, of a file of `length` bytes.
pub(super) fn decode(reader: impl BufRead + Seek, length: u64, limits: &Limits) -> Result<(Raster, u8), ImageFault> {
    let mut reader = open(reader, limits)?;
    let orientation = header(reader.info(), limits)?.orientation;
    let size = reader.output_buffer_size().ok_or_else(|| ImageFault::damaged(Format::Png, "its size overflows"))?;
    if (size / LARGEST_RATIO) as u64 > length {
        return Err(ImageFault::Truncated(Format::Png));
    }
    let raster = if reader.output_color_type().1 == BitDepth::Sixteen {
        // decoded into its final memory: the memory budget of a job has no space for a second copy of 16 bits
        let mut samples = vec![0u16; size.div_ceil(2)];
        let frame = read(&mut reader, simd::bytes_of_mut(&mut samples))?;
        samples.truncate(frame.buffer_size() / 2);
        samples.iter_mut().for_each(|sample| *sample = u16::from_be(*sample));
        let (stored, kept) = channels(&frame)?;
        Raster::sixteen(frame.width as usize, frame.height as usize, kept, first_channels(samples, stored, kept))
    } else {
        let mut samples = vec![0; size];
        let frame = read(&mut reader, &mut samples)?;
        samples.truncate(frame.buffer_size());
        let (stored, kept) = channels(&frame)?;
        Raster::eight(frame.width as usize, frame.height as usize, kept, first_channels(samples, stored, kept))
    };
    Ok((raster, orientation))
}

/// Reads the pixels, and the rest of the file for its checksums.
fn read<R: BufRead + Seek>(reader: &mut Reader<R>, bytes: &mut [u8]) -> Result<OutputInfo, ImageFault> {
    let frame = reader.next_frame(bytes).map_err(|error| fault(&error))?;
    reader.finish().map_err(|error| fault(&error))?;
    Ok(frame)
}

/// The number of stored channels, and of those that are kept.
fn channels(frame: &OutputInfo) -> Result<(usize, usize), ImageFault> {
    match frame.color_type {
        ColorType::Grayscale => Ok((1, 1)),
        ColorType::GrayscaleAlpha => Ok((2, 1)),
        ColorType::Rgb => Ok((3, 3)),
        ColorType::Rgba => Ok((4, 3)),
        ColorType::Indexed => Err(ImageFault::damaged(Format::Png, "its palette cannot be expanded")),
    }
}

/// Keeps the first `kept` of `stored` channels: drops alpha.
pub(super) fn first_channels<T: Copy>(mut samples: Vec<T>, stored: usize, kept: usize) -> Vec<T> {
    if stored == kept {
        return samples;
    }
    let pixels = samples.len() / stored;
    for pixel in 0..pixels {
        samples.copy_within(pixel * stored..pixel * stored + kept, pixel * kept);
    }
    samples.truncate(pixels * kept);
    samples
}
