//! Writes a stored picture in another file format, with the same pixels, colour profile and EXIF. A JPEG has 8 bits and
//! no alpha.

use std::{
    fs::File,
    io::{BufReader, BufWriter, Write},
    path::Path,
};

use anyhow::Context;

use crate::contract::{artifact::FileFormat, options::JPEG_QUALITY};
use pinstack_science::imaging::codec;

/// Most bytes that headers and metadata add to the samples; incompressible rows add 1/16.
const OVERHEAD: u64 = 4 << 20;

/// Upper bound of the size of the picture at `path` in any other format, from the samples in its header.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn most_bytes(path: &Path) -> anyhow::Result<u64> {
    let file = BufReader::new(File::open(path).context("cannot read the picture")?);
    let header = codec::probe(file, &codec::Limits::default()).context("cannot read the header of the picture")?;
    // red, green, blue and alpha
    let samples = u64::from(header.width) * u64::from(header.height) * 4 * u64::from(header.bit_depth / 8);
    Ok(samples + samples / 16 + OVERHEAD)
}

/// Width and height of the picture at `path`.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn size(path: &Path) -> anyhow::Result<(u32, u32)> {
    let file = BufReader::new(File::open(path).context("cannot read the picture")?);
    let header = codec::probe(file, &codec::Limits::default()).context("cannot read the header of the picture")?;
    Ok((header.width, header.height))
}

/// Writes the picture at `path` as `format` into `file`. Returns the size in bytes.
///
/// # Errors
/// When the picture cannot be read or the file cannot be written.
pub(super) fn convert(path: &Path, file: &File, format: FileFormat) -> anyhow::Result<u64> {
    let bytes = std::fs::read(path).context("cannot read the picture")?;
    let metadata = codec::metadata(&bytes);
    let raster = codec::decode_rgba(&bytes, &codec::Limits::default()).context("cannot decode the picture")?;
    drop(bytes);
    let mut out = BufWriter::with_capacity(1 << 20, file);
    match format {
        FileFormat::Tiff => codec::encode_tiff(&mut out, &raster, &metadata)?,
        FileFormat::Jpeg => codec::write_jpeg(&mut out, &raster, &metadata, JPEG_QUALITY)?,
        // only pictures are converted
        FileFormat::Png | FileFormat::Json | FileFormat::Ply | FileFormat::Glb | FileFormat::Zip | FileFormat::Text => {
            codec::encode_png(&mut out, &raster, &metadata)?
        }
    }
    out.flush()?;
    drop(out);
    Ok(file.metadata()?.len())
}
