//! The image in the other file format, made on the way: same pixels, colour profile and EXIF.

use std::{
    fs::File,
    io::{BufWriter, Cursor, Seek, Write},
    path::{Path, PathBuf},
};

use anyhow::{Context, anyhow};
use axum::http::HeaderMap;
use image::{DynamicImage, ImageReader, Limits};

use super::download::{Download, stored};
use crate::{
    http::{
        background,
        extract::conditional::not_modified,
        problem::{ApiError, ApiResult},
        state::App,
    },
    imaging::{Raster, codec},
    model::{Code, outcome::Artifact},
    store::step::step,
};

/// Largest side of a result.
const MAX_SIDE: u32 = 65_535;
/// Most memory that one conversion may take for its pixels, bytes: 400 megapixels of 16-bit RGBA.
const MAX_PIXEL_BYTES: u64 = 400_000_000 * 8;

/// The image of a job as `media_type`. The entity tag tells it from the stored file.
///
/// # Errors
/// `not_found` when it was deleted a moment ago.
pub async fn converted(
    app: &App,
    headers: &HeaderMap,
    artifact: &Artifact,
    media_type: &'static str,
    name: String,
) -> ApiResult<Download> {
    let tag = format!("{}-{}", artifact.sha256, media_type.trim_start_matches("image/"));
    if not_modified(headers, &tag) {
        // nothing will be sent: spare the work
        let stored = stored(app, artifact, name).await?;
        return Ok(Download { tag, media_type: media_type.to_owned(), ..stored });
    }
    let path = app.blobs.local_path(&artifact.key).await?;
    let path = path.ok_or_else(|| ApiError::new(Code::NotFound, "the image was deleted"))?;
    let spool = app.blobs.spool_dir().to_owned();
    // each conversion holds the whole image
    let _turn = app.conversions.acquire().await.map_err(ApiError::internal)?;
    let made = background::spawn_blocking(move || convert(&path, &spool, media_type));
    let (file, length) = made.await.map_err(ApiError::internal)?.map_err(|e| cannot(&e))?;
    Ok(Download { file: tokio::fs::File::from_std(file), length, tag, media_type: media_type.to_owned(), name })
}

fn cannot(error: &anyhow::Error) -> ApiError {
    use std::io::ErrorKind::{QuotaExceeded, StorageFull};
    let is_full = |cause: &std::io::Error| matches!(cause.kind(), StorageFull | QuotaExceeded);
    if error.chain().filter_map(|cause| cause.downcast_ref()).any(is_full) {
        let detail = "the disk of the server is full, so the image could not be converted; ask for it as it is stored \
                      (no Accept), or make room";
        return ApiError::new(Code::InsufficientStorage, detail);
    }
    ApiError::internal(format!("{error:#}"))
}

/// Writes the converted image into a file without a name: it goes when nobody reads it any more.
fn convert(path: &Path, spool: &PathBuf, media_type: &str) -> anyhow::Result<(File, u64)> {
    let bytes = std::fs::read(path).context("cannot read the image")?;
    let metadata = codec::metadata(&bytes);
    let raster = decode(&bytes)?;
    drop(bytes);
    step("convert.make")?;
    let mut file = tempfile::tempfile_in(spool).context("cannot make a file in the spool")?;
    let mut out = BufWriter::new(&mut file);
    match media_type {
        "image/tiff" => codec::encode_tiff(&mut out, &raster, &metadata)?,
        _ => codec::encode_png(&mut out, &raster, &metadata)?,
    }
    out.flush()?;
    drop(out);
    let length = file.stream_position().and(file.metadata())?.len();
    Ok((file, length))
}

/// Decodes a result of ours with its alpha channel, which slices never have.
fn decode(bytes: &[u8]) -> anyhow::Result<Raster> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format()?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_PIXEL_BYTES);
    reader.limits(limits);
    let image = reader.decode().context("cannot decode the image")?;
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
