//! Quality metrics of one stack, as the contract shows them. Definitions: `docs/METRICS.md`. A number that could not be
//! computed is null.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::WarningCode;

/// The quality metrics of a stack.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Metrics {
    /// How well the fused image preserves the detail of the sharpest slices.
    pub fusion: FusionMetrics,
    /// Whether the slices cover the object in depth.
    pub focus: FocusMetrics,
    /// One entry per front-light slice.
    pub slices: Vec<SliceMetrics>,
    /// Whether the profile fits this stack.
    pub alignment: AlignmentMetrics,
    /// One entry per further light; absent without any.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<LightMetrics>,
    /// Null without a back-light stack.
    pub mask: Option<MaskMetrics>,
    /// Diagnosis in sentences: what is wrong with the stack or could be improved, warnings first.
    #[serde(default)]
    pub findings: Vec<Finding>,
    /// Versions of the metrics, `name:version`. Only numbers of equal versions can be compared.
    #[serde(default)]
    pub versions: Vec<String>,
    /// Processing time.
    pub timing_ms: Timing,
}

/// One diagnosis of a stack.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Finding {
    /// Stable machine-readable code, `snake_case`.
    #[schema(value_type = String)]
    pub code: WarningCode,
    /// `warning`: the result is affected; `note`: it is not, but the next stack could be better or smaller.
    pub severity: Severity,
    /// What is wrong, in which slices, and what to do.
    pub detail: String,
    /// 0-based indices of the slices concerned; empty if all are.
    #[serde(default)]
    pub slices: Vec<u32>,
}

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The result is affected.
    Warning,
    /// The result is not affected.
    Note,
}

/// Quality of the fused image, measured on luma 0..255 (16-bit slices are scaled) over valid pixels, and over the
/// object alone when there is a mask.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FusionMetrics {
    /// Gradient preservation (Xydeas and Petrovic 2000) against the slice with the strongest gradient at each pixel;
    /// upper bound 0.9748.
    pub q_g_top: Option<f64>,
    /// Quality index (Piella and Heijmans 2003) against the slice with the largest variance in each 8x8 window; upper
    /// bound 1.
    pub q_w_top: Option<f64>,
    /// Gradient energy of the fused image relative to that of the sharpest slice at each pixel. Above 1.02: ringing.
    /// Far below 1: lost detail or misaligned slices.
    pub sharpness_retention: Option<f64>,
    /// Square root of the sum of the mean squared differences to the right and to the lower neighbour.
    pub spatial_frequency: Option<f64>,
    /// Mean squared Sobel gradient.
    pub tenengrad: Option<f64>,
    /// Variance of the 4-neighbour Laplacian.
    pub laplacian_variance: Option<f64>,
    /// Share of pixels more than one grey level outside the range of the slices at that pixel.
    pub overshoot_fraction: Option<f64>,
    /// Mean distance of the pixels from that range, grey levels of 255: the strength of halos.
    #[serde(default)]
    pub overshoot_levels: Option<f64>,
    /// Share of pixels at full scale (grey level 254 or more) or at zero (below 0.5).
    #[serde(default)]
    pub clipped_fraction: Option<f64>,
    /// Mean grey level, 0 to 255. Compare it between the views of a scan.
    #[serde(default)]
    pub mean_level: Option<f64>,
}

/// Coverage in depth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FocusMetrics {
    /// Share of pixels (of the object, with a mask) whose focus measure exceeds the noise floor in some slice.
    pub textured_fraction: Option<f64>,
    /// Share of the object's pixels that are not textured: smooth, or never in focus. Null without a mask.
    pub unfocused_fraction: Option<f64>,
    /// True if the object extends beyond the plane of the first slice, whichever side is near the camera.
    pub range_too_short_near: Option<bool>,
    /// True if the object extends beyond the plane of the last slice.
    pub range_too_short_far: Option<bool>,
    /// 0-based indices of inner slices that contribute almost no pixels.
    pub redundant_slices: Vec<u32>,
    /// `n`: between slices n and n + 1 the step exceeds the depth of field.
    pub coverage_gaps: Vec<u32>,
    /// `n`: from slice n to n + 1 focus moves much farther than usual in this stack.
    #[serde(default)]
    pub uneven_steps: Vec<u32>,
    /// Share of the textured pixels that are taken from the first slice (decision map) and are less sharp in each of
    /// the next two.
    #[serde(default)]
    pub peak_at_first_fraction: Option<f64>,
    /// Share of the textured pixels that are taken from the last slice (decision map) and are less sharp in each of the
    /// two before it.
    #[serde(default)]
    pub peak_at_last_fraction: Option<f64>,
    /// Share of the textured pixels whose slice in the decision map is not the most frequent one of their 5x5
    /// neighbourhood.
    #[serde(default)]
    pub label_noise: Option<f64>,
    /// Median lead of the sharpest slice over the second sharpest, as a share of its focus measure: 0 (none) to 1.
    #[serde(default)]
    pub ambiguity: Option<f64>,
    /// The largest connected area of the object without texture in any slice. Null without a mask.
    #[serde(default)]
    pub unfocused_area: Option<UnfocusedArea>,
    /// The slices in the order of focus (or its reverse), if they do not come in that order; else null.
    #[serde(default)]
    pub order: Option<Vec<u32>>,
}

/// An area of the object without texture: smooth, or never in focus. Position and size in px on the canvas, which is
/// the pixel grid of the reference slice, before a crop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct UnfocusedArea {
    /// Its share of the object.
    pub fraction: f64,
    /// Left column of the bounding box.
    pub x: u32,
    /// Top row of the bounding box.
    pub y: u32,
    /// Width of the bounding box.
    pub width: u32,
    /// Height of the bounding box.
    pub height: u32,
}

/// Metrics of one slice.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SliceMetrics {
    /// 0-based index of the slice.
    pub index: u32,
    /// File name in the archive.
    pub name: String,
    /// Share of the textured pixels that are taken from this slice.
    pub contribution: Option<f64>,
    /// Mean squared Sobel gradient of the warped slice.
    pub sharpness: Option<f64>,
    /// Brightness relative to the reference slice, before the gain.
    pub exposure_ratio: Option<f64>,
    /// Red over green and blue over green, each relative to the reference slice. Not 1: the colour of the light drifts.
    #[serde(default)]
    pub balance_ratio: Option<[f64; 2]>,
    /// Brightness after the gain relative to the surrounding slices. Not 1: the light flickers. Null in stacks of fewer
    /// than six slices.
    #[serde(default)]
    pub flicker_ratio: Option<f64>,
    /// 0-based index of an earlier slice that is the same image; else null.
    #[serde(default)]
    pub duplicate_of: Option<u32>,
    /// Share of pixels at full scale (grey level 254 or more) or at zero (below 0.5).
    pub clipped_fraction: Option<f64>,
    /// Share of the canvas that the warped slice covers.
    pub valid_fraction: Option<f64>,
    /// Median length of the residual shifts relative to the previous slice, px. Null for slice 0.
    pub residual_px: Option<f64>,
}

/// Residual shifts between neighbouring warped slices, which show whether the profile fits the stack.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AlignmentMetrics {
    /// Median length of all shifts, px.
    pub residual_p50_px: Option<f64>,
    /// 95th percentile of the length of all shifts, px. Above 0.5: see `similarity`, which decides whether the profile
    /// fits.
    pub residual_p95_px: Option<f64>,
    /// Residual scale from a slice to the next. Not 1: the profile belongs to another lens or rail position.
    pub residual_scale: Option<f64>,
    /// The similarity that all steps from slice to slice have in common.
    #[serde(default)]
    pub similarity: Option<ResidualSimilarity>,
    /// Share of the canvas that every slice covers.
    #[serde(default)]
    pub common_fraction: Option<f64>,
}

/// Metrics of a further light.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LightMetrics {
    /// The name of its folder.
    pub name: String,
    /// Whether its own slices fit the profile.
    pub alignment: AlignmentMetrics,
}

/// Residual shift, scale and rotation per step from slice to slice: none, if the profile fits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ResidualSimilarity {
    /// Scale per step; 1 if the profile fits.
    pub scale: f64,
    /// Rotation per step, degrees, clockwise on the screen.
    pub rotation_deg: f64,
    /// Shift of the centre of the image per step (x, y), px.
    pub shift_px: [f64; 2],
    /// Total displacement from the first slice to the last of the corner of the image that moves most, px.
    pub corner_drift_px: f64,
    /// Standard deviation of `corner_drift_px`, px.
    pub corner_drift_sigma_px: f64,
    /// Number of measured shifts, with outliers; the fit does not use those.
    pub shifts: u32,
}

/// Metrics of the mask.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaskMetrics {
    /// Share of the canvas that is the object.
    pub foreground_fraction: f64,
    /// Threshold used, as a share of full scale.
    pub threshold: f64,
    /// Otsu's between-class variance over the total variance: above 0.9 good, below 0.75 doubtful. With
    /// `mask_threshold` the classes are those of that threshold, in the unchanged picture.
    pub separability: Option<f64>,
    /// Share of the border pixels of the canvas that belong to the object. Above 0: the object is cut off.
    pub border_contact_fraction: f64,
    /// Number of connected parts of the object.
    pub components: u32,
    /// Number of holes in the object.
    pub holes: u32,
    /// Fall of the back light from the brightest to the dimmest part of the background, 0 to 1. Null if a threshold was
    /// given or too little background is visible.
    #[serde(default)]
    pub light_falloff: Option<f64>,
    /// Share of the object that the back light shines through. It belongs to the mask.
    #[serde(default)]
    pub translucent_fraction: f64,
}

/// Processing time, milliseconds of wall clock.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Timing {
    /// From the start of the job to its last artifact.
    pub total: u64,
    /// Time per stage, in the order of execution.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageTime>,
}

/// Processing time of one stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
    /// Milliseconds.
    pub ms: u64,
}
