//! The result of a calibration: homography, gain and measured dots of every slice, findings, report.

use crate::types::profile::{CaptureMode, HomographyModel, ProfileSlice};
use crate::types::{Warning, distortion::Distortion, lateral_colour::LateralColour, report::CalibrationReport};

/// How a dot was used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DotUse {
    /// It agrees with the homography of its slice.
    Inlier,
    /// It does not agree, and was excluded from the fit.
    Outlier,
    /// It was not used: the reference slice does not show it, or the slice's homography was predicted.
    Unused,
}

/// A measured dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// Column and row in the grid, the same for all slices. The origin is arbitrary.
    pub label: [i32; 2],
    /// Centre in px of its slice.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate, px.
    pub sigma: f64,
    /// How it was used.
    pub used: DotUse,
}

/// The result of a calibration.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// 0-based index of the slice that all others are mapped to.
    pub reference_index: usize,
    /// One entry per slice: homography, gain, and their uncertainties.
    pub slices: Vec<ProfileSlice>,
    /// Per slice its measured dots.
    pub dots: Vec<Vec<Dot>>,
    /// Dot pitch in the reference slice, px.
    pub dot_pitch_px: f64,
    /// Image size over target size; `None` unless the pixel pitch and the target pitch were specified.
    pub magnification: Option<f64>,
    /// What moves between slices: as found from the scales, else as specified.
    pub capture_mode: Option<CaptureMode>,
    /// The transform model of the homographies.
    pub model: HomographyModel,
    /// Lens distortion that stays with the sensor; the homographies are then between images without it. `None`: none.
    pub distortion: Option<Distortion>,
    /// Lateral colour that is large enough to correct; `None`: no, or not measured.
    pub lateral_colour: Option<LateralColour>,
    /// Findings for the user.
    pub warnings: Vec<Warning>,
    /// The verdict in one sentence.
    pub verdict: String,
    /// The full report.
    pub report: CalibrationReport,
}
