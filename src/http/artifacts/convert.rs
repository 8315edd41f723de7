//! A stored picture in another file format: same pixels, colour profile and EXIF.
//!
//! In: the stored file, the media type that is wanted. Out: an open file of that type. A JPEG has 8 bits and no alpha.

use std::{
    fs::File,
    io::{BufReader, BufWriter, Write},
    path::Path,
};

use anyhow::Context;

use crate::contract::options::JPEG_QUALITY;
use pinstack_science::imaging::codec;

/// Most that headers, metadata and incompressible rows add to the samples, as a share of 1/16 and in bytes.
const OVERHEAD: u64 = 4 << 20;

/// Most bytes that the file `path` has in any other format: as many as its samples, which its header tells.
///
/// # Errors
/// When the file cannot be read.
pub(super) fn most_bytes(path: &Path) -> anyhow::Result<u64> {
    let file = BufReader::new(File::open(path).context("cannot read the picture")?);
    let header = codec::probe(file, &codec::Limits::default()).context("cannot read the head of the picture")?;
    // red, green, blue and alpha
    let samples = u64::from(header.width) * u64::from(header.height) * 4 * u64::from(header.bit_depth / 8);
    Ok(samples + samples / 16 + OVERHEAD)
}

/// Writes the picture at `path` as `media_type` into `file`, and says how many bytes it has.
///
/// # Errors
/// When the picture cannot be read or the file cannot be written.
pub(super) fn convert(path: &Path, file: &File, media_type: &str) -> anyhow::Result<u64> {
    let bytes = std::fs::read(path).context("cannot read the picture")?;
    let metadata = codec::metadata(&bytes);
    let raster = codec::decode_rgba(&bytes, &codec::Limits::default()).context("cannot decode the picture")?;
    drop(bytes);
    let mut out = BufWriter::with_capacity(1 << 20, file);
    match media_type {
        "image/tiff" => codec::encode_tiff(&mut out, &raster, &metadata)?,
        "image/jpeg" => codec::write_jpeg(&mut out, &raster, &metadata, JPEG_QUALITY)?,
        _ => codec::encode_png(&mut out, &raster, &metadata)?,
    }
    out.flush()?;
    drop(out);
    Ok(file.metadata()?.len())
}
