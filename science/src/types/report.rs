//! The calibration report and the drift report as data.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    Warning,
    profile::{CaptureMode, HomographyModel},
    pupils::{PrincipalDistanceSource, Pupils},
};

/// The full result of a calibration. Stored with its results; the HTML report is drawn from it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationReport {
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// The verdict in one sentence.
    pub verdict: String,
    /// Good, usable or poor: the verdict in one word.
    pub grade: Grade,
    /// Findings; the sentence of each names the slices concerned.
    pub findings: Vec<Warning>,
    /// The target in the reference slice; null for a calibration from stacks of objects.
    pub target: Option<TargetReport>,
    /// The transform model of the profile.
    pub model: HomographyModel,
    /// Why this model was selected, in one sentence.
    pub model_reason: String,
    /// The transform models that were compared, simplest first.
    pub candidates: Vec<ModelCandidate>,
    /// What moved between the slices, as specified and as found from the scales.
    pub capture: CaptureReport,
    /// The rail law; null when too few slices were measured to fit one.
    pub rail: Option<RailReport>,
    /// The camera, as far as it is known.
    pub camera: CameraReport,
    /// One entry per slice, in order.
    pub slices: Vec<SliceReport>,
}

/// Quality of a calibration by its corner uncertainty, limited by its findings. Ordered from the best to the worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// The worst image corner has a standard deviation of at most 0.1 px, and no finding makes it doubtful.
    Good,
    /// The worst image corner has a standard deviation of at most 0.6 px, or a finding makes the result doubtful.
    Usable,
    /// The worst image corner has a larger standard deviation, or a finding shows that the result is wrong.
    Poor,
}

/// The dot target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TargetReport {
    /// Distance between neighbouring dots in the reference slice, px.
    pub pitch_px: f64,
    /// The same on the target, mm; null when it was not specified.
    pub pitch_mm: Option<f64>,
    /// Dot diameter over pitch.
    pub fill: f64,
    /// True for bright dots on a dark ground.
    pub bright_dots: bool,
    /// True when every other row is shifted by half a step.
    pub asymmetric: bool,
    /// Dots measured in the reference slice.
    pub dots: u32,
    /// Share of the reference slice inside the bounding box of the dots, 0 to 1.
    pub coverage: f64,
    /// Image size over target size; null unless the pixel pitch and the target pitch were specified.
    pub magnification: Option<f64>,
    /// True for a coded target, on which every dot is unique: then no error by a whole pitch is possible.
    #[serde(default)]
    pub coded: bool,
    /// The part of the code in view; null for a target without a code.
    #[serde(default)]
    pub code: Option<CodeReport>,
}

/// The code of a coded target, as seen in the reference slice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CodeReport {
    /// Version of the code.
    pub version: u32,
    /// First and last column in view. The first is 0 to 255; the code repeats after 256 columns.
    pub columns: [u32; 2],
    /// First and last row in view. The first is 0 to 255; the code repeats after 256 rows.
    pub rows: [u32; 2],
    /// True when the slices show the target mirrored.
    pub mirrored: bool,
    /// Negative base-10 logarithm of the probability that the code was recognised by chance.
    pub certainty: f64,
}

/// Result of one transform model for the whole stack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ModelCandidate {
    /// The transform model.
    pub model: HomographyModel,
    /// Number of parameters for the whole stack.
    pub parameters: u32,
    /// RMS residual of the dots in the reference slice, px; null when the model could not be fitted.
    pub rms_px: Option<f64>,
    /// RMS residual of dots that were held out of the fit, px.
    pub held_out_px: Option<f64>,
    /// Bayesian information criterion; less is better.
    pub bic: Option<f64>,
    /// Standard deviation of the worst image corner of the worst slice, px.
    pub corner_sigma_px: Option<f64>,
    /// True for the selected model.
    pub chosen: bool,
}

/// The capture mode: what moved between the slices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CaptureReport {
    /// The specified mode.
    pub told: Option<CaptureMode>,
    /// The mode found from the scales; null when they do not decide it.
    pub found: Option<CaptureMode>,
    /// Probability of the mode that was found from brightness and parallax of stacks, 0 to 1; null otherwise.
    #[serde(default)]
    pub confidence: Option<f64>,
    /// The reason in one sentence.
    pub detail: String,
}

/// The rail law: a point x of the reference slice appears at `x + dz (a x + e)` in a slice `dz` from the reference
/// slice on the rail.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RailReport {
    /// `a`: growth of the image per mm of rail, or per step when positions were not specified.
    pub growth: f64,
    /// The point of the reference slice that does not move, `[x, y]` px; null when the scale is nearly constant.
    pub fixed_point_px: Option<[f64; 2]>,
    /// True when rail positions are in mm, false when they are counted in slices.
    pub in_mm: bool,
    /// Rail position per slice that the law was fitted with.
    pub positions: Vec<f64>,
    /// Rail position per slice derived from its scale, in the same unit; null where the slice was not measured.
    pub measured_positions: Vec<Option<f64>>,
    /// RMS of `off_law_px` over the slices that have it, px; 0 when none has.
    pub corner_rms_px: f64,
}

/// The camera as a pinhole, in the terms of photogrammetry.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CameraReport {
    /// Principal distance of the reference slice, mm; null where the numbers do not tell it.
    pub principal_distance_mm: Option<f64>,
    /// The same in px; photogrammetry programs call it the focal length.
    pub principal_distance_px: Option<f64>,
    /// What the principal distance is known from.
    #[serde(default)]
    pub source: PrincipalDistanceSource,
    /// What is known of the two pupils of the lens.
    #[serde(flatten)]
    pub pupils: Pupils,
    /// The focal length that follows from the two pupils, mm; null unless both were measured.
    #[serde(default)]
    pub measured_focal_mm: Option<f64>,
    /// Where the optical axis meets the reference slice, `[x, y]` px. Always null at present: the rail tells it only
    /// together with its own tilt, which is unknown.
    pub principal_point_px: Option<[f64; 2]>,
    /// Size of one pixel, mm.
    pub pixel_pitch_mm: Option<f64>,
    /// The specified focal length, mm.
    pub focal_mm: Option<f64>,
    /// Where the numbers come from, or which options to specify to obtain them.
    pub detail: String,
}

/// Measurements of one slice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SliceReport {
    /// 0-based index.
    pub index: u32,
    /// Name of its file.
    pub name: String,
    /// Scale from this slice to the reference slice.
    pub scale: f64,
    /// Scale by the rail law; null for the reference slice, and without a law.
    pub law_scale: Option<f64>,
    /// Shift of the image centre from this slice to the reference slice, `[x, y]` px.
    pub shift_px: [f64; 2],
    /// Shift by the rail law, px; null for the reference slice, and without a law.
    pub law_shift_px: Option<[f64; 2]>,
    /// Largest distance of an image corner between the slice's own estimate and the rail law, px; null for the
    /// reference slice, without a law, and where nothing was measured.
    pub off_law_px: Option<f64>,
    /// Blur radius, px of the slice; null where nothing was measured.
    pub blur_radius_px: Option<f64>,
    /// Contrast of the dot pattern relative to the sharpest slice, 0 to 1; negative where blur has inverted the dots.
    pub contrast: Option<f64>,
    /// Factor that makes the slice as bright as the reference slice.
    pub gain: f64,
    /// Relative standard deviation of the gain; null when it is unknown.
    #[serde(default)]
    pub gain_sigma: Option<f64>,
    /// The gain by the smooth law over the rail; null without one.
    #[serde(default)]
    pub law_gain: Option<f64>,
    /// Share of the pixels at full scale.
    pub clipped: Option<f64>,
    /// Number of measured dots.
    pub dots_found: u32,
    /// Number of dots that agree with the homography.
    pub inliers: u32,
    /// RMS residual of the inliers in the reference slice, px.
    pub rms_px: Option<f64>,
    /// Standard deviation of the worst image corner, px.
    pub corner_sigma_px: f64,
    /// True when the homography was predicted by the rail law.
    pub interpolated: bool,
    /// The dots; at most 2,000, evenly selected.
    pub dots: Vec<DotReport>,
}

/// One dot of one slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DotReport {
    /// Position, `[x, y]` px of the slice.
    pub at: [f64; 2],
    /// Residual: the position mapped by the homography minus the dot in the reference slice, `[x, y]` px of the
    /// reference; null when the reference slice does not show it. With a lens distortion both are taken without it,
    /// although `at` is as seen in the slice.
    pub residual: Option<[f64; 2]>,
    /// False when it was an outlier or was not used.
    pub inlier: bool,
}

/// Drift: how far a rig moved between two profiles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Drift {
    /// The older revision.
    pub from_revision: u32,
    /// The newer revision.
    pub to_revision: u32,
    /// Largest movement of an image corner per slice, px; null where a corner has no finite position, and
    /// everywhere when the profiles cannot be compared (see `detail`).
    pub corner_px: Vec<Option<f64>>,
    /// The largest of these movements, px.
    pub worst_px: Option<f64>,
    /// Index of the slice with the largest movement.
    pub worst_slice: Option<u32>,
    /// New gain over old gain per slice; null everywhere when the profiles cannot be compared.
    pub gain_ratio: Vec<Option<f64>>,
    /// How far the rig moved, in one sentence, or why the profiles cannot be compared (different image size or slice
    /// count).
    pub detail: String,
}
