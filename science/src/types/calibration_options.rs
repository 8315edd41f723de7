//! What a caller can ask of a calibration.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::profile::CaptureMode;

/// Which family of maps a calibration uses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelChoice {
    /// The simplest that explains the dots.
    #[default]
    Auto,
    /// One law for the whole stack, three numbers.
    RailLinear,
    /// Scale, rotation and shift per slice.
    Similarity,
    /// Six numbers per slice.
    Affine,
    /// Eight numbers per slice, as in the paper.
    Homography,
}

impl ModelChoice {
    /// True for the default.
    pub fn is_auto(&self) -> bool {
        *self == Self::Auto
    }
}

/// Options of a calibration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationOptions {
    /// 0-based index of the reference slice; default: the middle one.
    pub reference_index: Option<u32>,
    /// Distance between neighbouring dots, mm; gives the magnification.
    pub target_pitch_mm: Option<f64>,
    /// Size of one pixel on the sensor, mm; kept in the profile.
    pub pixel_pitch_mm: Option<f64>,
    /// Position of what moves on the rail, per slice, mm, counted towards the object, strictly rising or falling;
    /// default: equal steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rail_positions_mm: Option<Vec<f64>>,
    /// Distance from slice to slice on the rail, mm, instead of `rail_positions_mm`; negative when it moves away from
    /// the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rail_step_mm: Option<f64>,
    /// Focal length engraved on the lens, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_mm: Option<f64>,
    /// What moves between slices, as you believe: a disagreement with what the pictures show is a warning.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture_mode: Option<CaptureMode>,
    /// Family of maps; default `auto`: the simplest that explains the dots.
    #[serde(skip_serializing_if = "ModelChoice::is_auto")]
    pub model: ModelChoice,
    /// The slices may have another size than the profile that this calibration replaces; without it they are refused,
    /// because stacks of the old size would no longer fit.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub allow_new_size: bool,
    /// Free text kept in the profile.
    pub note: Option<String>,
}
