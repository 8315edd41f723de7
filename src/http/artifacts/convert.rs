//! A stored picture in another file format: same pixels, colour profile and EXIF.
//!
//! In: the stored file, the media type that is wanted. Out: an open file of that type. A JPEG has 8 bits and no alpha.

use std::{
    fs::File,
    io::{BufReader, BufWriter, Cursor, Write},
    path::Path,
};

use anyhow::{Context, anyhow};
use image::{DynamicImage, ImageReader, Limits};

use crate::contract::options::JPEG_QUALITY;
use pinstack_science::imaging::{Raster, codec};

/// Largest side of a result.
const MAX_SIDE: u32 = 65_535;
/// Most memory that one conversion may take for its pixels, bytes: 400 megapixels of 16-bit RGBA.
const MAX_PIXEL_BYTES: u64 = 400_000_000 * 8;
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
    let raster = decode(&bytes)?;
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

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_PIXEL_BYTES);
    limits
}

/// Decodes a result of ours with its alpha channel, which slices never have.
fn decode(bytes: &[u8]) -> anyhow::Result<Raster> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format()?;
    reader.limits(limits());
    let image = reader.decode().context("cannot decode the picture")?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok(match image {
        DynamicImage::ImageLuma8(i) => Raster::eight(width, height, 1, i.into_raw()),
        DynamicImage::ImageRgb8(i) => Raster::eight(width, height, 3, i.into_raw()),
        DynamicImage::ImageRgba8(i) => Raster::eight(width, height, 4, i.into_raw()),
        DynamicImage::ImageLuma16(i) => Raster::sixteen(width, height, 1, i.into_raw()),
        DynamicImage::ImageRgb16(i) => Raster::sixteen(width, height, 3, i.into_raw()),
        DynamicImage::ImageRgba16(i) => Raster::sixteen(width, height, 4, i.into_raw()),
        other => return Err(anyhow!("a result of kind {:?}", other.color())),
    })
}
