//! Quality of one fused stack, as the contract shows it. Definitions: `docs/METRICS.md`.
//! A number that could not be computed is null, never made up.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Everything that is measured about a stack.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Metrics {
    /// How well the fused image keeps what the sharpest slice shows.
    pub fusion: FusionMetrics,
    /// Whether the slices cover the object in depth.
    pub focus: FocusMetrics,
    /// One entry per front-light slice.
    pub slices: Vec<SliceMetrics>,
    /// Whether the profile fits this stack.
    pub alignment: AlignmentMetrics,
    /// Null without a back-light stack.
    pub mask: Option<MaskMetrics>,
    /// What is wrong with the stack, or could be better, in sentences; the worst first.
    #[serde(default)]
    pub findings: Vec<Finding>,
    /// How the numbers were computed, `name:version`: only numbers of equal versions can be compared.
    #[serde(default)]
    pub versions: Vec<String>,
    /// Time spent.
    pub timing_ms: Timing,
}

/// Something that a technician should know about a stack.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Finding {
    /// Stable machine-readable code, `snake_case`.
    pub code: String,
    /// `warning`: the result suffers; `note`: it does not, but the next stack can be better or smaller.
    pub severity: Severity,
    /// What, which slices, what to do.
    pub detail: String,
    /// 0-based slices that it is about; empty when it is about all.
    #[serde(default)]
    pub slices: Vec<u32>,
}

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// The result suffers.
    Warning,
    /// The result does not suffer.
    Note,
}

/// Quality of the fused image, on 8-bit grey (16-bit slices are scaled to 0..255), on valid pixels and on
/// the object alone when there is a mask.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FusionMetrics {
    /// Xydeas & Petrovic 2000 against the slice with the strongest gradient per pixel; upper bound 0.9748.
    pub q_g_top: Option<f64>,
    /// Piella & Heijmans 2003 against the slice with the largest variance per 8x8 window; upper bound 1.
    pub q_w_top: Option<f64>,
    /// Gradient energy of the image over that of the sharpest slice per pixel; above 1.02 is ringing, below 0.9 lost detail.
    pub sharpness_retention: Option<f64>,
    /// Root of the mean squared differences to the right and lower neighbours.
    pub spatial_frequency: Option<f64>,
    /// Mean squared Sobel gradient.
    pub tenengrad: Option<f64>,
    /// Variance of the 4-neighbour Laplacian.
    pub laplacian_variance: Option<f64>,
    /// Share of pixels over one grey level outside the range that the slices span there.
    pub overshoot_fraction: Option<f64>,
    /// Mean over all pixels of how far they lie outside that range, grey levels of 255: the strength of halos.
    #[serde(default)]
    pub overshoot_levels: Option<f64>,
    /// Share of pixels at full scale or at zero.
    #[serde(default)]
    pub clipped_fraction: Option<f64>,
}

/// Coverage in depth.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FocusMetrics {
    /// Share of pixels (of the object, when there is a mask) whose saliency rises above the noise floor in any slice.
    pub textured_fraction: Option<f64>,
    /// Share of pixels of the object without: texture-less, or never in focus. Null without a mask.
    pub unfocused_fraction: Option<f64>,
    /// The object goes on in front of (before) the first slice.
    pub range_too_short_near: Option<bool>,
    /// The object goes on behind (after) the last slice.
    pub range_too_short_far: Option<bool>,
    /// 0-based slices in the middle that hardly any pixel needs.
    pub redundant_slices: Vec<u32>,
    /// `n` means: between slices n and n + 1 the step is too large for the depth of field.
    pub coverage_gaps: Vec<u32>,
    /// `n` means: from slice n to n + 1 focus moves much farther than between the others.
    #[serde(default)]
    pub uneven_steps: Vec<u32>,
    /// Share of the textured pixels that are sharpest in the first slice and get less sharp from there on.
    #[serde(default)]
    pub peak_at_first_fraction: Option<f64>,
    /// The same of the last slice.
    #[serde(default)]
    pub peak_at_last_fraction: Option<f64>,
    /// Share of the textured pixels whose slice is not that of most of their 5x5 neighbours.
    #[serde(default)]
    pub label_noise: Option<f64>,
    /// Median over the textured pixels of how far the second sharpest slice is below the sharpest, 0 (not at all) to 1.
    #[serde(default)]
    pub ambiguity: Option<f64>,
    /// The largest connected part of the object that no slice shows in focus. Null without a mask.
    #[serde(default)]
    pub unfocused_area: Option<UnfocusedArea>,
    /// The slices in the order of focus (or its reverse), when they do not come in that order; else null.
    #[serde(default)]
    pub order: Option<Vec<u32>>,
}

/// A part of the object without texture, or never in focus. Place and size on the canvas, px.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct UnfocusedArea {
    /// Share of the object.
    pub fraction: f64,
    /// Left column of its bounding box.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// One slice.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SliceMetrics {
    /// 0-based.
    pub index: u32,
    /// Name in the archive.
    pub name: String,
    /// Share of the textured pixels that come from this slice.
    pub contribution: Option<f64>,
    /// Tenengrad of the warped slice.
    pub sharpness: Option<f64>,
    /// Brightness over that of the reference slice, before any gain.
    pub exposure_ratio: Option<f64>,
    /// Red over green and blue over green, each over that of the reference slice: away from 1 the colour of the light drifts.
    #[serde(default)]
    pub balance_ratio: Option<[f64; 2]>,
    /// Brightness after the gain over that of the slices around it: away from 1 the light flickers.
    #[serde(default)]
    pub flicker_ratio: Option<f64>,
    /// 0-based slice before it that is the very same picture.
    #[serde(default)]
    pub duplicate_of: Option<u32>,
    /// Share of pixels at full scale or at zero.
    pub clipped_fraction: Option<f64>,
    /// Share of the canvas that the warped slice covers.
    pub valid_fraction: Option<f64>,
    /// Median residual shift against the slice before it (slice 0: null), px.
    pub residual_px: Option<f64>,
}

/// Residual shifts between warped neighbours: whether the profile fits the stack.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AlignmentMetrics {
    /// Median length, px.
    pub residual_p50_px: Option<f64>,
    /// 95th percentile, px; over 0.5 is worth a look, over 1 the profile does not fit.
    pub residual_p95_px: Option<f64>,
    /// Relative scale from a slice to the next that is left; away from 1 the profile is another lens's.
    pub residual_scale: Option<f64>,
    /// What all steps from slice to slice have in common.
    #[serde(default)]
    pub similarity: Option<ResidualSimilarity>,
    /// Share of the canvas that every slice covers.
    #[serde(default)]
    pub common_fraction: Option<f64>,
}

/// Shift, scale and rotation per step from slice to slice that the profile leaves: nothing, when it fits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ResidualSimilarity {
    /// Scale per step.
    pub scale: f64,
    /// Rotation per step, degrees, clockwise on the screen.
    pub rotation_deg: f64,
    /// Shift of the middle of the picture per step (x, y), px.
    pub shift_px: [f64; 2],
    /// What that adds up to from the first slice to the last in the corner of the picture that moves most, px.
    pub corner_drift_px: f64,
    /// Standard deviation of that, px.
    pub corner_drift_sigma_px: f64,
    /// Number of windows' shifts that it was fitted to.
    pub shifts: u32,
}

/// The cut-out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MaskMetrics {
    /// Share of the canvas that is object.
    pub foreground_fraction: f64,
    /// Threshold used, share of full scale.
    pub threshold: f64,
    /// Otsu's between-class over total variance: above 0.9 good, below 0.75 doubtful.
    pub separability: Option<f64>,
    /// Share of the canvas's border pixels that are object: above 0 the object is cut off.
    pub border_contact_fraction: f64,
    /// Connected parts of the object.
    pub components: u32,
    /// Holes in it.
    pub holes: u32,
    /// How much the back light loses from the brightest to the dimmest place of the background, 0 to 1; null when it was
    /// not asked (a threshold was given) or too little background is seen.
    #[serde(default)]
    pub light_falloff: Option<f64>,
    /// Share of the object that the back light shines through, and that counts as object all the same.
    #[serde(default)]
    pub translucent_fraction: f64,
}

/// Time spent, milliseconds of wall clock.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Timing {
    /// From the claim to the last artifact.
    pub total: u64,
    /// Per stage, in the order they ran.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageTime>,
}

/// Time of one stage.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
    /// Milliseconds.
    pub ms: u64,
}
