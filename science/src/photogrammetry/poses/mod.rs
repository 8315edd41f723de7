//! Camera poses that a reconstruction program found, and a report on how well they fit a turntable.
//!
//! In: the file of a program ([`read()`]), and what the turntable was commanded to do. Out: a [`PoseReport`] with the
//! quantities of table I of Li and Nguyen (2019): registered views, sphere through the centres of projection, steps of
//! pan and tilt.

pub mod circle;
pub mod readers;
mod report;
pub mod sphere;
mod table;
pub mod turntable;

#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::types::{Error, error::ErrorKind, text::folded};

pub use readers::{COLMAP_MODEL, colmap_views, read};
pub use report::{
    FocalLengthReport, KnownLengthReport, LengthUnit, PoseReport, ScaleReport, ScaleSource, StepReport, SurfaceKind,
    SurfaceReport, ViewPose, report,
};

/// Most views of a file.
pub const MAX_VIEWS: usize = 10_000;
/// Largest focal length, px.
pub const MAX_FOCAL_PX: f64 = 1e8;

/// A file of camera poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseFormat {
    /// COLMAP `images.txt`.
    ColmapText,
    /// COLMAP `images.bin`.
    ColmapBinary,
    /// AliceVision and Meshroom: `cameras.sfm`, or any SfMData as JSON.
    Alicevision,
    /// Metashape: cameras exported as XML.
    Metashape,
    /// OpenMVG `sfm_data.json`.
    Openmvg,
    /// CSV with the columns `name`, `x`, `y`, `z`, and perhaps `pan_deg` and `tilt_deg`.
    Csv,
}

/// The pose of a view, in the world and the unit of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Name of the image as the file has it, often a path.
    pub name: String,
    /// Centre of projection.
    pub centre: [f64; 3],
    /// Rotation from world to camera, by rows; `None` where the file has centres alone.
    pub rotation: Option<[[f64; 3]; 3]>,
    /// Commanded pan and tilt, where the file has them, degrees.
    pub commanded_deg: Option<[f64; 2]>,
}

/// What a file of poses contains.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseFile {
    /// Its format.
    pub format: PoseFormat,
    /// The registered views, in the order of the file.
    pub poses: Vec<Pose>,
    /// Names of views without a pose, where the file lists them.
    pub unregistered: Vec<String>,
    /// The focal length of each registered view, px, where the file has it.
    pub focal_px: Vec<f64>,
}

/// A view that should be registered, with the angles that the turntable was commanded to.
#[derive(Debug, Clone, PartialEq)]
pub struct Commanded {
    /// Name of the view; an extension and folders are ignored.
    pub name: String,
    /// Pan and tilt, degrees; `None` if they are unknown.
    pub angles_deg: Option<[f64; 2]>,
}

/// A known length, which gives a reconstruction its scale.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownScale {
    /// Distance from the centre of the turntable to the centre of projection, mm.
    Radius {
        /// The distance, mm.
        mm: f64,
    },
    /// Distance of the centres of projection of two views.
    Pair {
        /// Name of a view.
        from: String,
        /// Name of the other.
        to: String,
        /// Their distance, mm.
        mm: f64,
    },
}

/// A focal length as photogrammetry means it: the principal distance of a pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// The distance, px.
    pub px: f64,
    /// Its standard deviation, px; `None` when it is unknown.
    pub sigma_px: Option<f64>,
}

impl Distance {
    /// The standard deviation over the distance.
    fn relative_sigma(self) -> Option<f64> {
        self.sigma_px.map(|sigma| sigma / self.px)
    }
}

/// What a report is made with.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PoseOptions {
    /// Number of views that should be registered; `None`: that of `commanded`, or what the file lists.
    pub expected: Option<u32>,
    /// A known length.
    pub scale: Option<KnownScale>,
    /// The focal length that the program found; `None`: that of the file, where it has one.
    pub focal_length: Option<Distance>,
    /// The principal distance of the camera that took the images.
    pub principal_distance: Option<Distance>,
    /// Two points of the object in the world and the unit of the file, and their known distance, mm: checks the scale.
    pub known_length: Option<([[f64; 3]; 2], f64)>,
    /// The views that should be registered. If empty, angles come from the file or from the names of the images.
    pub commanded: Vec<Commanded>,
}

/// The error of a file that has no usable poses.
fn invalid(detail: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidPoses, detail)
}

/// Endings of image files that are not part of the name of a view.
const EXTENSIONS: [&str; 11] = ["jpg", "jpeg", "png", "tif", "tiff", "exr", "bmp", "webp", "dng", "nef", "cr3"];

/// The name of a view by which it is found: without folders and extension, [`folded`].
fn view_key(name: &str) -> String {
    folded(without_extension(name.rsplit(['/', '\\']).next().unwrap_or(name)))
}

fn without_extension(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known)) => stem,
        _ => name,
    }
}
