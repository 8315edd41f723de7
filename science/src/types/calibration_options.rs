//! Options of a calibration.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::capture_mode::CaptureMode;
use super::report::Grade;

/// What the slices of a calibration show.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationSource {
    /// A dot target.
    #[default]
    DotTarget,
    /// Objects: ordinary stacks.
    Stacks,
}

impl CalibrationSource {
    /// True for `dot_target`, the default.
    pub fn is_dot_target(&self) -> bool {
        *self == Self::DotTarget
    }
}

/// Transform model of a calibration.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelChoice {
    /// The simplest model with a nearly minimal expected error at the image corners.
    #[default]
    Auto,
    /// The rail law: three parameters for the whole stack.
    RailLinear,
    /// Scale, rotation and shift: four parameters per slice.
    Similarity,
    /// Six parameters per slice.
    Affine,
    /// Eight parameters per slice, as in Li and Nguyen (2019).
    Homography,
}

impl ModelChoice {
    /// True for `auto`, the default.
    pub fn is_auto(&self) -> bool {
        *self == Self::Auto
    }
}

/// The calibrations that become the current revision of their profile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// All.
    #[default]
    Always,
    /// Those whose grade is good or usable.
    Usable,
    /// Those whose grade is good.
    Good,
}

impl Keep {
    /// True for `always`, the default.
    pub fn is_always(&self) -> bool {
        *self == Self::Always
    }

    /// Whether a calibration of this grade becomes a revision of its profile.
    pub fn admits(self, grade: Grade) -> bool {
        match self {
            Self::Always => true,
            Self::Usable => grade <= Grade::Usable,
            Self::Good => grade <= Grade::Good,
        }
    }
}

/// Options of a calibration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationOptions {
    /// What the slices show: `dot_target`, or `stacks`: an ordinary stack, or all views of a scan in the layout of
    /// `PUT /v1/scans/{scan}/archive`.
    #[serde(skip_serializing_if = "CalibrationSource::is_dot_target")]
    pub source: CalibrationSource,
    /// With `source=stacks`: the revision of the profile to start from. Its homographies are refined by the stacks, and
    /// the rest of it is kept: gains, distortion, scale and camera. Without a drift that the stacks show, the
    /// homographies are kept too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<u32>,
    /// 0-based index of the reference slice; default: the middle one.
    pub reference_index: Option<u32>,
    /// Distance between neighbouring dots of the target, mm; with `pixel_pitch_mm` it gives the magnification.
    pub target_pitch_mm: Option<f64>,
    /// Size of one pixel on the sensor, mm; stored in the profile.
    pub pixel_pitch_mm: Option<f64>,
    /// Rail position per slice, mm, counted towards the object, strictly increasing or decreasing; default: equal
    /// steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rail_positions_mm: Option<Vec<f64>>,
    /// Rail step from slice to slice, mm, instead of `rail_positions_mm`; negative for a movement away from the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rail_step_mm: Option<f64>,
    /// Focal length of the lens, mm. Where the principal distance is measured, it is checked against that; with a rail
    /// that moves the sensor it gives a rough value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_mm: Option<f64>,
    /// Pupil ratio: diameter of the exit pupil over that of the entrance pupil. With a rail that moves the sensor it
    /// gives the principal distance; where that is measured, it is checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pupil_ratio: Option<f64>,
    /// A calibration of this rig at the same setting, by its id, with the target nearer to the lens by
    /// `target_advance_mm`, instead of pictures in the folder `moved` of the zip. With either, the principal distance
    /// is measured whatever moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moved_target: Option<String>,
    /// How much nearer to the lens the target was in the folder `moved` of the zip, or in `moved_target`, mm; negative
    /// if it was farther. The folder has one picture, taken with the rail where it was for the reference slice, or as
    /// many as there are slices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_advance_mm: Option<f64>,
    /// Dot pitch in the reference slice of `moved_target`, px. The service fills it in. For a folder `moved` the report
    /// has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moved_target_pitch_px: Option<f64>,
    /// What moves between slices. A contradiction with the slices is reported as a warning.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub capture_mode: Option<CaptureMode>,
    /// Transform model; default `auto`.
    #[serde(skip_serializing_if = "ModelChoice::is_auto")]
    pub model: ModelChoice,
    /// Accepts slices of another size than the profile that this calibration replaces. Without it they are refused,
    /// because stacks of the old size would no longer fit the profile.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub allow_new_size: bool,
    /// Grade from which the calibration becomes the current revision of the profile; default `always`. Below it, the
    /// calibration has its report but no revision, and the profile stays as it is.
    #[serde(skip_serializing_if = "Keep::is_always")]
    pub keep: Keep,
    /// Free text, stored in the profile.
    pub note: Option<String>,
}

impl CalibrationOptions {
    /// Image size over target size, by the dot pitch in the image; `None` unless both pitches are specified.
    pub fn magnification(&self, pitch_px: f64) -> Option<f64> {
        let target = self.target_pitch_mm.filter(|pitch| *pitch > 0.0)?;
        Some(pitch_px * self.pixel_pitch_mm? / target)
    }
}
