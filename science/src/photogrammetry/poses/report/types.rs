//! What a report says. The OpenAPI document describes the same members; `docs/SCANS.md` lists the findings.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{
    photogrammetry::poses::{PoseFormat, turntable::Steps},
    types::Warning,
};

/// How well the poses of a scan fit a turntable.
///
/// All lengths are in `scale.unit`. Standard deviations have `n - 1` in the denominator unless they say otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PoseReport {
    /// Format of the file.
    pub format: PoseFormat,
    /// Number of registered views.
    pub registered: u32,
    /// Number of views that should be registered; null when it is unknown.
    pub expected: Option<u32>,
    /// Views that should be registered and are not.
    pub not_registered: Vec<String>,
    /// Registered views that the scan does not have.
    pub unknown: Vec<String>,
    /// Names that occur more than once; the first of each counts.
    pub duplicates: Vec<String>,
    /// The unit of all lengths, and where it comes from.
    pub scale: ScaleReport,
    /// The sphere through the centres of projection, or the circle if they are in one plane; null when there is none.
    pub surface: Option<SurfaceReport>,
    /// Axis of the turntable in the world of the file, upwards, a unit vector; null when it is unknown.
    pub axis: Option<[f64; 3]>,
    /// Pan grows clockwise, seen from above; null when it is unknown.
    pub pan_is_clockwise: Option<bool>,
    /// Steps of pan between neighbouring views, from the centres of projection.
    pub pan_steps: Option<StepReport>,
    /// Steps of tilt between neighbouring views, from the centres of projection.
    pub tilt_steps: Option<StepReport>,
    /// Steps of pan from the optical axes, which do not depend on the sphere.
    pub pan_steps_of_axes: Option<StepReport>,
    /// Steps of tilt from the optical axes.
    pub tilt_steps_of_axes: Option<StepReport>,
    /// The registered views.
    pub views: Vec<ViewPose>,
    /// What to consider.
    pub findings: Vec<Warning>,
    /// The focal length of the reconstruction and that of the camera; null unless both are known.
    #[serde(default)]
    pub focal_length: Option<FocalLengthReport>,
    /// A known length of the object and that of the reconstruction; null unless one was given.
    #[serde(default)]
    pub known_length: Option<KnownLengthReport>,
    /// What nothing in the report checks, as a sentence: whether the focal length is right. Null where something does.
    #[serde(default)]
    pub not_checked: Option<String>,
}

/// The focal length of a reconstruction against the principal distance of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FocalLengthReport {
    /// Focal length of the reconstruction, px.
    pub reconstruction_px: f64,
    /// Its standard deviation, px; null when it is unknown.
    pub reconstruction_sigma_px: Option<f64>,
    /// Principal distance of the camera, px.
    pub camera_px: f64,
    /// Its standard deviation, px; null when it is unknown.
    pub camera_sigma_px: Option<f64>,
    /// How much longer that of the reconstruction is, percent.
    pub difference_percent: f64,
}

/// A known length of the object against the reconstruction, whose scale comes from the cameras.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct KnownLengthReport {
    /// The known length, mm.
    pub known_mm: f64,
    /// The same length in the reconstruction, mm.
    pub reconstruction_mm: f64,
    /// How much longer that of the reconstruction is, percent.
    pub difference_percent: f64,
}

/// The unit of lengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LengthUnit {
    /// Millimetres.
    Mm,
    /// Shares of the fitted radius: a reconstruction has no scale of its own.
    Radius,
}

/// Where the scale comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScaleSource {
    /// Nothing: lengths are shares of the radius.
    None,
    /// The known distance from the centre of the turntable to the camera. The reported radius is therefore that
    /// distance, and says nothing about the poses.
    KnownRadius,
    /// The known distance of two views.
    ViewPair,
}

/// The scale of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScaleReport {
    /// Unit of all lengths of the report.
    pub unit: LengthUnit,
    /// Where it comes from.
    pub source: ScaleSource,
    /// Units of the report per unit of the file.
    pub per_file_unit: f64,
}

/// A surface on which the centres of projection lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceKind {
    /// A sphere.
    Sphere,
    /// A circle: all centres are in one plane.
    Circle,
}

/// The fitted sphere or circle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurfaceReport {
    /// Sphere or circle.
    pub kind: SurfaceKind,
    /// Its centre, in the world and the unit of the file.
    pub centre: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Mean distance of the centres of projection from its centre (of a circle: from its axis).
    pub mean_radius: f64,
    /// Standard deviation of that distance.
    pub std: f64,
    /// The same with `n` in the denominator, as the paper computes it.
    pub std_population: f64,
    /// The same as `std`, in percent of the radius.
    pub std_percent: f64,
    /// Root of the mean squared residual.
    pub rms: f64,
    /// Largest residual of a view that was used.
    pub max: f64,
    /// Views that were used.
    pub used: u32,
    /// Views that were rejected: their residual exceeds five robust standard deviations.
    pub rejected: u32,
}

/// Steps of the turntable between commanded neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StepReport {
    /// Commanded step, degrees.
    pub commanded_deg: f64,
    /// Mean measured step, degrees.
    pub mean_deg: f64,
    /// Standard deviation of the measured steps, degrees: `sqrt 2` times that of the angle of one view.
    pub std_deg: f64,
    /// Number of steps.
    pub count: u32,
}

impl From<Steps> for StepReport {
    fn from(Steps { commanded_deg, mean_deg, std_deg, count }: Steps) -> Self {
        Self { commanded_deg, mean_deg, std_deg, count: u32::try_from(count).unwrap_or(u32::MAX) }
    }
}

/// A registered view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewPose {
    /// Its name in the file.
    pub name: String,
    /// Commanded pan, degrees.
    pub commanded_pan_deg: Option<f64>,
    /// Commanded tilt, degrees.
    pub commanded_tilt_deg: Option<f64>,
    /// Measured pan, degrees, with the zero of the commanded pan; null within 10 degrees of the pole.
    pub pan_deg: Option<f64>,
    /// Measured tilt, degrees, with the zero of the commanded tilt.
    pub tilt_deg: Option<f64>,
    /// Distance from the centre less the radius.
    pub radial_residual: Option<f64>,
    /// Measured less commanded pan, after one offset per ring of equal tilt, degrees.
    pub pan_residual_deg: Option<f64>,
    /// Measured less commanded tilt, after one offset for all views, degrees.
    pub tilt_residual_deg: Option<f64>,
    /// The residual of both angles as a length on the surface.
    pub tangential_residual: Option<f64>,
    /// The view does not fit the others, and counts neither for the surface nor for the steps it fails.
    pub is_outlier: bool,
}
