//! What a calibration found, in full: the numbers behind the report that a technician reads.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    Warning,
    profile::{CaptureMode, HomographyModel},
};

/// Everything that a calibration found. Stored with its results; the report page is drawn from it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationReport {
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// One sentence for the technician.
    pub verdict: String,
    /// Good, usable or poor: the verdict in one word.
    pub grade: Grade,
    /// What the user should know, each with the slices it concerns in its sentence.
    pub findings: Vec<Warning>,
    /// The target as the reference slice shows it.
    pub target: TargetReport,
    /// The family of maps that the profile uses.
    pub model: HomographyModel,
    /// Why that family, in one sentence.
    pub model_reason: String,
    /// What each family would have given, simplest first.
    pub candidates: Vec<ModelCandidate>,
    /// What moved, as told and as the scales show it.
    pub capture: CaptureReport,
    /// The law of the rail; null when too few slices were measured to fit one.
    pub rail: Option<RailReport>,
    /// The camera as downstream tools need it, where it can be known.
    pub camera: CameraReport,
    /// One entry per slice, in order.
    pub slices: Vec<SliceReport>,
}

/// How good a calibration is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// Every image corner is known to 0.3 px.
    Good,
    /// Every image corner is known to 0.6 px.
    Usable,
    /// Some corner is known worse than that.
    Poor,
}

/// The dot target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TargetReport {
    /// Distance of neighbouring dots in the reference slice, px.
    pub pitch_px: f64,
    /// The same on the target, mm, when it was told.
    pub pitch_mm: Option<f64>,
    /// Diameter of a dot over the pitch.
    pub fill: f64,
    /// True for bright dots on a dark ground.
    pub bright_dots: bool,
    /// True when every other row is shifted by half a step.
    pub asymmetric: bool,
    /// Dots that the reference slice shows.
    pub dots: u32,
    /// Share of the reference slice that the dots span, 0 to 1.
    pub coverage: f64,
    /// Image size over target size, when both pitches were told.
    pub magnification: Option<f64>,
}

/// What one family of maps would have given for the whole stack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ModelCandidate {
    /// The family.
    pub model: HomographyModel,
    /// Free numbers for the whole stack.
    pub parameters: u32,
    /// RMS distance of the dots in the reference slice, px; null when it could not be fitted.
    pub rms_px: Option<f64>,
    /// RMS distance of dots that were held out of the fit, px.
    pub held_out_px: Option<f64>,
    /// Bayesian information criterion: less is better.
    pub bic: Option<f64>,
    /// Standard deviation of the worst image corner of the worst slice, px.
    pub corner_sigma_px: Option<f64>,
    /// True for the family that was taken.
    pub chosen: bool,
}

/// What moved between the slices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CaptureReport {
    /// As the user said.
    pub told: Option<CaptureMode>,
    /// As the law of the scales shows; null when they leave it open.
    pub found: Option<CaptureMode>,
    /// One sentence: how that is known, or why it is not.
    pub detail: String,
}

/// The law that binds the slices together: seen from the reference slice, a point moves by
/// `dz (a x + e)`, `dz` the steps of the rail from the reference slice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RailReport {
    /// Growth of the image per step (per mm when positions were told), `a`.
    pub growth: f64,
    /// The point of the reference slice that does not move, `[x, y]` px; null when the image hardly scales.
    pub fixed_point_px: Option<[f64; 2]>,
    /// True when positions in mm were told, false when steps are counted by slices.
    pub in_mm: bool,
    /// Per slice: the position on the rail that the law was fitted with.
    pub positions: Vec<f64>,
    /// Per slice: where the scales say it stood, in the same unit; null where nothing was measured.
    pub measured_positions: Vec<Option<f64>>,
    /// RMS distance of the image corners between the law and the measured slices, px.
    pub corner_rms_px: f64,
}

/// A pinhole, as photogrammetry wants it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CameraReport {
    /// Distance from the lens to the sensor in the reference slice, mm.
    pub principal_distance_mm: Option<f64>,
    /// The same in px: what photogrammetry calls the focal length.
    pub principal_distance_px: Option<f64>,
    /// The same from another source than the first (pitch against rail), mm, so that they can be compared.
    pub cross_check_mm: Option<f64>,
    /// Where the axis meets the reference slice, `[x, y]` px.
    pub principal_point_px: Option<[f64; 2]>,
    /// Size of one pixel, mm.
    pub pixel_pitch_mm: Option<f64>,
    /// Focal length as told, mm.
    pub focal_mm: Option<f64>,
    /// One sentence: where the numbers come from, or what to tell so that they can be known.
    pub detail: String,
}

/// One slice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SliceReport {
    /// 0-based.
    pub index: u32,
    /// Name of its file.
    pub name: String,
    /// Scale towards the reference slice.
    pub scale: f64,
    /// What the law of the rail says it is; null without a law.
    pub law_scale: Option<f64>,
    /// Shift of the image centre towards the reference slice, `[x, y]` px.
    pub shift_px: [f64; 2],
    /// What the law of the rail says it is; null without a law.
    pub law_shift_px: Option<[f64; 2]>,
    /// Distance of the corners between the slice as measured alone and the law, px.
    pub off_law_px: Option<f64>,
    /// Radius of the blur, px of the slice; null where nothing was measured.
    pub blur_radius_px: Option<f64>,
    /// How far the dots stand out from the ground, 0 to 1; negative where blur has inverted them.
    pub contrast: Option<f64>,
    /// Multiply by this to match the reference.
    pub gain: f64,
    /// Share of the pixels at full scale.
    pub clipped: Option<f64>,
    /// Dots found.
    pub dots_found: u32,
    /// Dots that agree with the homography.
    pub inliers: u32,
    /// RMS distance of the inliers in the reference slice, px.
    pub rms_px: Option<f64>,
    /// Standard deviation of the worst image corner, px.
    pub corner_sigma_px: f64,
    /// True when the rail's law predicted it.
    pub interpolated: bool,
    /// The dots, at most 2,000 of them, evenly chosen.
    pub dots: Vec<DotReport>,
}

/// One dot of one slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DotReport {
    /// Where it is, `[x, y]` px of the slice.
    pub at: [f64; 2],
    /// Where the homography sends it minus where the reference slice shows it, `[x, y]` px of the reference; null when
    /// the reference does not show it.
    pub residual: Option<[f64; 2]>,
    /// False when it was left out.
    pub inlier: bool,
}

/// How far a rig moved between two profiles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Drift {
    /// Revision that is compared against, the older one.
    pub from_revision: u32,
    /// The newer one.
    pub to_revision: u32,
    /// Per slice: the farthest that an image corner moved, px; null where only one of the two has the slice.
    pub corner_px: Vec<Option<f64>>,
    /// The largest of them.
    pub worst_px: Option<f64>,
    /// The slice where it is largest.
    pub worst_slice: Option<u32>,
    /// Per slice: gain over the gain it had.
    pub gain_ratio: Vec<Option<f64>>,
    /// Why no distance can be told (other image size, count or reference), or one sentence that says how far it moved.
    pub detail: String,
}
