//! Readers of camera poses, one per format.

mod alicevision;
mod colmap_binary;
mod colmap_cameras;
mod colmap_model;
mod colmap_text;
mod csv;
mod found;
mod json;
mod metashape;
mod openmvg;

#[cfg(test)]
mod tests;

use super::{PoseFile, PoseFormat, invalid};
use crate::{
    archive::{self, ArchiveLimits},
    types::{Error, ErrorKind},
};
pub use colmap_model::colmap_views;
use found::Found;

/// The files of a COLMAP model that are read. Binary files come first, because they are exact.
pub const COLMAP_MODEL: [[&str; 2]; 2] = [["images.bin", "images.txt"], ["cameras.bin", "cameras.txt"]];
/// Largest file of a zip, bytes.
const MAX_MEMBER_BYTES: u64 = 128 << 20;

/// Reads a file of camera poses, or a zip of the folder of a COLMAP model. Without a format, the content decides.
///
/// # Errors
/// [`crate::types::error::ErrorKind::InvalidPoses`], with the line or element: a file of another kind, truncated, with
/// numbers that are not finite, with more than 10,000 views, or without a registered view.
pub fn read(bytes: &[u8], format: Option<PoseFormat>) -> Result<PoseFile, Error> {
    let mut found = Found::default();
    if !bytes.starts_with(b"PK\x03\x04") {
        return read_file(bytes, format, found);
    }
    let limits = ArchiveLimits { max_member_bytes: MAX_MEMBER_BYTES, ..ArchiveLimits::default() };
    let read = archive::read_files(bytes.to_vec(), COLMAP_MODEL, &limits);
    let [images, cameras] = read.map_err(|error| Error { kind: ErrorKind::InvalidPoses, ..error })?;
    let (name, images) = images.ok_or_else(|| {
        invalid("the zip has no images.bin or images.txt: zip the folder of a COLMAP model, or send the file itself")
    })?;
    if let Some((name, cameras)) = cameras {
        colmap_cameras::read(&name, &cameras, &mut found)?;
    }
    let format = if name.ends_with(".bin") { PoseFormat::ColmapBinary } else { PoseFormat::ColmapText };
    read_file(&images, Some(format), found)
}

/// Reads a file that is no zip, after its cameras where they are in a file of their own.
fn read_file(bytes: &[u8], format: Option<PoseFormat>, mut found: Found) -> Result<PoseFile, Error> {
    let format = match format {
        Some(format) => format,
        None => detect(bytes)?,
    };
    match format {
        PoseFormat::ColmapBinary => colmap_binary::read(bytes, &mut found)?,
        PoseFormat::ColmapText => colmap_text::read(text(bytes)?, &mut found)?,
        PoseFormat::Alicevision => alicevision::read(text(bytes)?, &mut found)?,
        PoseFormat::Metashape => metashape::read(text(bytes)?, &mut found)?,
        PoseFormat::Openmvg => openmvg::read(text(bytes)?, &mut found)?,
        PoseFormat::Csv => csv::read(text(bytes)?, &mut found)?,
    }
    let Found { poses, unregistered, focal_px, .. } = found;
    if poses.is_empty() {
        let listed = match unregistered.len() {
            0 => String::new(),
            n => format!("; it lists {n} views without one"),
        };
        return Err(invalid(format!("the file has no view with a pose{listed}; export the poses after the alignment")));
    }
    Ok(PoseFile { format, poses, unregistered, focal_px })
}

/// Finds the format of a file from its content.
fn detect(bytes: &[u8]) -> Result<PoseFormat, Error> {
    refuse_utf16(bytes)?;
    if bytes.starts_with(b"\x1F\x8B") {
        return Err(invalid("the file is compressed by gzip; unpack it, and send the file of the poses itself"));
    }
    let head = &bytes[..bytes.len().min(1 << 16)];
    if head.contains(&0) {
        return Ok(PoseFormat::ColmapBinary);
    }
    let text = text(bytes)?;
    match text.trim_start().as_bytes().first() {
        None => return Err(invalid("the file is empty")),
        Some(b'<') => return Ok(PoseFormat::Metashape),
        // the names of members tell the two apart; the values may be hundreds of megabytes
        Some(b'{') if text.contains("\"sfm_data_version\"") || text.contains("\"extrinsics\"") => {
            return Ok(PoseFormat::Openmvg);
        }
        Some(b'{') => return Ok(PoseFormat::Alicevision),
        Some(_) => {}
    }
    let mut lines = text.lines().filter(|line| !line.trim().is_empty());
    let first = lines.clone().find(|line| !line.starts_with('#'));
    let numbers = |line: &str| line.split_ascii_whitespace().take_while(|word| word.parse::<f64>().is_ok()).count();
    if first.is_some_and(|line| numbers(line) >= 9) {
        return Ok(PoseFormat::ColmapText);
    }
    if lines.next().is_some_and(|line| line.contains([',', ';', '\t'])) {
        return Ok(PoseFormat::Csv);
    }
    Err(invalid(
        "the file is not COLMAP images.txt or images.bin, AliceVision cameras.sfm, Metashape XML, OpenMVG sfm_data.json, \
         or CSV with the columns name, x, y, z; of COLMAP, send images and not cameras or points3D",
    ))
}

/// Refuses text with the byte order mark of UTF-16. Binary files of COLMAP with such a start have too many images.
fn refuse_utf16(bytes: &[u8]) -> Result<(), Error> {
    match bytes {
        [0xFF, 0xFE, ..] | [0xFE, 0xFF, ..] => Err(invalid("the file is UTF-16 text; save it as UTF-8")),
        _ => Ok(()),
    }
}

fn text(bytes: &[u8]) -> Result<&str, Error> {
    refuse_utf16(bytes)?;
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    std::str::from_utf8(bytes)
        .map_err(|error| invalid(format!("the file is not UTF-8 text (byte {})", error.valid_up_to())))
}
