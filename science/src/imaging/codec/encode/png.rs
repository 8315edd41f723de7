//! Writes PNG.

use std::{
    borrow::Cow,
    io::{self, Write},
};

use ::png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Info};

use crate::imaging::{Depth, Raster, Samples, codec::Metadata};

/// Bytes per IDAT chunk, and so of compressed data in memory.
const CHUNK_BYTES: usize = 1 << 20;

/// Writes a PNG of 1, 3 or 4 channels and 8 or 16 bits, with the EXIF block, and the ICC profile if it is for the same
/// number of channels. `Software` is also written as a text chunk, because few programs read EXIF in PNG. Rows are
/// compressed one by one, without a second copy. On photographs `Compression::Fast` was both the fastest and the
/// smallest.
///
/// # Errors
/// Any I/O error of `out`, and [`io::ErrorKind::InvalidInput`] for other numbers of channels.
pub fn encode_png(mut out: impl Write, raster: &Raster, metadata: &Metadata) -> io::Result<()> {
    encode(&mut out, raster, metadata)
}

/// [`encode_png`], compiled once for all writers.
fn encode(out: &mut dyn Write, raster: &Raster, metadata: &Metadata) -> io::Result<()> {
    let mut info = Info::with_size(side(raster.width)?, side(raster.height)?);
    info.color_type = match raster.channels {
        1 => ColorType::Grayscale,
        3 => ColorType::Rgb,
        4 => ColorType::Rgba,
        other => return Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{other} channels"))),
    };
    info.bit_depth = match raster.depth() {
        Depth::Eight => BitDepth::Eight,
        Depth::Sixteen => BitDepth::Sixteen,
    };
    info.icc_profile = metadata.icc_for(raster.channels);
    info.exif_metadata = metadata.exif.as_deref().map(Cow::Borrowed);

    let mut encoder = Encoder::with_info(out, info).map_err(error)?;
    if let Some(software) = metadata.software().filter(|name| !name.is_empty() && name.is_ascii()) {
        encoder.add_text_chunk("Software".to_owned(), software).map_err(error)?;
    }
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header().map_err(error)?;
    let mut pixels = writer.stream_writer_with_size(CHUNK_BYTES).map_err(error)?;
    let row_samples = raster.width * raster.channels;
    match &raster.samples {
        Samples::Eight(samples) => {
            for row in samples.chunks_exact(row_samples) {
                pixels.write_all(row)?;
            }
        }
        Samples::Sixteen(samples) => {
            let mut big_endian = Vec::with_capacity(row_samples * 2);
            for row in samples.chunks_exact(row_samples) {
                big_endian.clear();
                big_endian.extend(row.iter().flat_map(|v| v.to_be_bytes()));
                pixels.write_all(&big_endian)?;
            }
        }
    }
    pixels.finish().map_err(error)?;
    writer.finish().map_err(error)
}

fn side(length: usize) -> io::Result<u32> {
    u32::try_from(length).map_err(|_| io::Error::new(io::ErrorKind::InvalidInput, "picture too large"))
}

fn error(error: EncodingError) -> io::Error {
    match error {
        EncodingError::IoError(error) => error,
        other => io::Error::new(io::ErrorKind::InvalidInput, other),
    }
}
