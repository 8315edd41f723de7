//! Readers of camera poses, one per format.

mod alicevision;
mod colmap_binary;
mod colmap_text;
mod csv;
mod json;
mod metashape;
mod openmvg;

#[cfg(test)]
mod tests;

use super::{MAX_VIEWS, Pose, PoseFile, PoseFormat, invalid};
use crate::types::Error;

/// Longest name of an image, bytes.
const MAX_NAME: usize = 4096;

/// Reads a file of camera poses. Without a format, the content decides.
///
/// # Errors
/// [`crate::types::error::ErrorKind::InvalidPoses`], with the line or element: a file of another kind, truncated, with
/// numbers that are not finite, with more than 10,000 views, or without a registered view.
pub fn read(bytes: &[u8], format: Option<PoseFormat>) -> Result<PoseFile, Error> {
    let format = match format {
        Some(format) => format,
        None => detect(bytes)?,
    };
    let mut found = Found::default();
    match format {
        PoseFormat::ColmapBinary => colmap_binary::read(bytes, &mut found)?,
        PoseFormat::ColmapText => colmap_text::read(text(bytes)?, &mut found)?,
        PoseFormat::Alicevision => alicevision::read(text(bytes)?, &mut found)?,
        PoseFormat::Metashape => metashape::read(text(bytes)?, &mut found)?,
        PoseFormat::Openmvg => openmvg::read(text(bytes)?, &mut found)?,
        PoseFormat::Csv => csv::read(text(bytes)?, &mut found)?,
    }
    let Found { poses, unregistered } = found;
    if poses.is_empty() {
        let listed = match unregistered.len() {
            0 => String::new(),
            n => format!("; it lists {n} views without one"),
        };
        return Err(invalid(format!("the file has no view with a pose{listed}; export the poses after the alignment")));
    }
    Ok(PoseFile { format, poses, unregistered })
}

/// The views of a file, checked one by one.
#[derive(Default)]
struct Found {
    poses: Vec<Pose>,
    unregistered: Vec<String>,
}

impl Found {
    /// Adds a registered view. `place` says where it is in the file.
    fn pose(&mut self, pose: Pose, place: impl Fn() -> String) -> Result<(), Error> {
        self.room()?;
        named(&pose.name, &place)?;
        let is_finite = |value: &f64| value.is_finite() && value.abs() < 1e12;
        if !pose.centre.iter().all(is_finite) {
            return Err(invalid(format!("{}: the centre of '{}' is not finite", place(), shown(&pose.name))));
        }
        if pose.rotation.is_some_and(|rows| !is_rotation(&rows)) {
            let detail = format!(
                "{}: the rotation of '{}' is not orthonormal; is the file damaged?",
                place(),
                shown(&pose.name)
            );
            return Err(invalid(detail));
        }
        self.poses.push(pose);
        Ok(())
    }

    /// Adds a view without a pose.
    fn unregistered(&mut self, name: String, place: impl Fn() -> String) -> Result<(), Error> {
        self.room()?;
        named(&name, &place)?;
        self.unregistered.push(name);
        Ok(())
    }

    fn room(&self) -> Result<(), Error> {
        if self.poses.len() + self.unregistered.len() < MAX_VIEWS {
            return Ok(());
        }
        Err(invalid(format!("the file has more than {MAX_VIEWS} views; a scan has at most so many")))
    }
}

fn named(name: &str, place: &impl Fn() -> String) -> Result<(), Error> {
    match name.len() {
        0 => Err(invalid(format!("{}: an image has no name", place()))),
        1..=MAX_NAME => Ok(()),
        _ => Err(invalid(format!("{}: the name of an image is longer than {MAX_NAME} bytes", place()))),
    }
}

/// A name in an error message.
fn shown(name: &str) -> String {
    name.chars().take(80).collect()
}

/// Whether three rows are orthonormal to 1 % and right-handed. Programs write six digits or more.
fn is_rotation(rows: &[[f64; 3]; 3]) -> bool {
    let [x, y, z] = rows.map(nalgebra::Vector3::from);
    let close = |value: f64, wanted: f64| (value - wanted).abs() < 0.01;
    close(x.norm(), 1.0) && close(y.norm(), 1.0) && close(x.dot(&y), 0.0) && (x.cross(&y) - z).norm() < 0.03
}

/// Finds the format of a file from its content.
fn detect(bytes: &[u8]) -> Result<PoseFormat, Error> {
    refuse_utf16(bytes)?;
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

/// The matrix of a quaternion `w, x, y, z` of any length; `None` for one of length 0.
fn rotation_of(quaternion: [f64; 4]) -> Option<[[f64; 3]; 3]> {
    let length = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
    if !(length.is_finite() && length > 1e-9) {
        return None;
    }
    let [w, x, y, z] = quaternion.map(|q| q / length);
    Some([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ])
}

/// The pose of an image of COLMAP: a world point `X` is at `R X + t` in the camera, so the centre is `-R^T t`.
fn colmap_pose(name: String, quaternion: [f64; 4], translation: [f64; 3]) -> Option<Pose> {
    let rotation = rotation_of(quaternion)?;
    let centre = [0, 1, 2].map(|axis| -(0..3).map(|row| rotation[row][axis] * translation[row]).sum::<f64>());
    Some(Pose { name, centre, rotation: Some(rotation), commanded_deg: None })
}
