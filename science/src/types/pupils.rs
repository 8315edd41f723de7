//! What is known of the two pupils of the lens: in the profile, and in the report of the calibration that measured it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What the principal distance is known from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PrincipalDistanceSource {
    /// Measured with a rail that moves camera and lens.
    CameraRail,
    /// Measured with a second set of the target, moved by a known distance.
    MovedTarget,
    /// The pupil ratio as it was given, with the measured distance of the exit pupil or the focal length.
    PupilRatio,
    /// The focal length as it was given: a rough value.
    FocalLength,
    /// It is not known.
    #[default]
    Unknown,
}

/// The pupils of the lens at the reference slice; null where unknown. Standard deviations include the tolerances of the
/// target, of the rail, and of numbers that were given.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default)]
pub struct Pupils {
    /// Standard deviation of `principal_distance_mm`. Bundles give the distance as fixed if this is below 0.5 % of it.
    pub principal_distance_sigma_mm: Option<f64>,
    /// Distance from the exit pupil to the sensor, mm, 0.1 to 100,000.
    pub exit_pupil_distance_mm: Option<f64>,
    /// Its standard deviation.
    pub exit_pupil_distance_sigma_mm: Option<f64>,
    /// Distance from the entrance pupil, the centre of projection, to the plane in focus, mm, 0.1 to 1,000,000.
    pub entrance_pupil_distance_mm: Option<f64>,
    /// Its standard deviation.
    pub entrance_pupil_distance_sigma_mm: Option<f64>,
    /// Pupil ratio: diameter of the exit pupil over that of the entrance pupil, 0.05 to 20.
    pub pupil_ratio: Option<f64>,
    /// Its standard deviation.
    pub pupil_ratio_sigma: Option<f64>,
}

impl Pupils {
    /// Every number with its name and its range.
    pub fn numbers(&self) -> [(&'static str, Option<f64>, [f64; 2]); 7] {
        [
            ("principal_distance_sigma_mm", self.principal_distance_sigma_mm, [0.0, 1e5]),
            ("exit_pupil_distance_mm", self.exit_pupil_distance_mm, [0.1, 1e5]),
            ("exit_pupil_distance_sigma_mm", self.exit_pupil_distance_sigma_mm, [0.0, 1e5]),
            ("entrance_pupil_distance_mm", self.entrance_pupil_distance_mm, [0.1, 1e6]),
            ("entrance_pupil_distance_sigma_mm", self.entrance_pupil_distance_sigma_mm, [0.0, 1e6]),
            ("pupil_ratio", self.pupil_ratio, [0.05, 20.0]),
            ("pupil_ratio_sigma", self.pupil_ratio_sigma, [0.0, 20.0]),
        ]
    }
}
