//! The views and cameras that a reader has found, each checked when it is added.

use std::collections::HashMap;

use crate::{
    photogrammetry::poses::{MAX_FOCAL_PX, MAX_VIEWS, Pose, invalid},
    types::Error,
};

/// Longest name of an image, bytes.
pub(super) const MAX_NAME: usize = 4096;

/// The views of a file, checked one by one.
#[derive(Default)]
pub(super) struct Found {
    pub poses: Vec<Pose>,
    pub unregistered: Vec<String>,
    /// The focal length of each registered view whose camera has one, px.
    pub focal_px: Vec<f64>,
    /// The id of the camera of each registered view.
    pub camera_ids: Vec<String>,
    /// Focal lengths of the cameras by their ids, px.
    cameras: HashMap<String, f64>,
}

impl Found {
    /// Adds a camera, unless its focal length is none. To be called before its views are added.
    pub(super) fn camera(&mut self, id: impl Into<String>, focal_px: f64) {
        if focal_px > 0.0 && focal_px <= MAX_FOCAL_PX {
            self.cameras.insert(id.into(), focal_px);
        }
    }

    /// Adds a registered view of a camera. `place` says where it is in the file.
    pub(super) fn pose(&mut self, pose: Pose, camera: &str, place: impl Fn() -> String) -> Result<(), Error> {
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
        self.focal_px.extend(self.cameras.get(camera));
        self.camera_ids.push(camera.to_owned());
        Ok(())
    }

    /// Adds a view without a pose.
    pub(super) fn unregistered(&mut self, name: String, place: impl Fn() -> String) -> Result<(), Error> {
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
pub(super) fn shown(name: &str) -> String {
    name.chars().take(80).collect()
}

/// Whether three rows are orthonormal to 1 % and right-handed. Programs write six digits or more.
fn is_rotation(rows: &[[f64; 3]; 3]) -> bool {
    let [x, y, z] = rows.map(nalgebra::Vector3::from);
    let close = |value: f64, wanted: f64| (value - wanted).abs() < 0.01;
    close(x.norm(), 1.0) && close(y.norm(), 1.0) && close(x.dot(&y), 0.0) && (x.cross(&y) - z).norm() < 0.03
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
pub(super) fn colmap_pose(name: String, quaternion: [f64; 4], translation: [f64; 3]) -> Option<Pose> {
    let rotation = rotation_of(quaternion)?;
    let centre = [0, 1, 2].map(|axis| -(0..3).map(|row| rotation[row][axis] * translation[row]).sum::<f64>());
    Some(Pose { name, centre, rotation: Some(rotation), commanded_deg: None })
}
