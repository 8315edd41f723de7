//! The outcome of a succeeded job, as its row keeps it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::reconstruction::ReconstructionResult;
use pinstack_science::types::{
    height::{HeightDirection, HeightUnit},
    intrinsics::Intrinsics,
    metrics::Metrics,
    profile::ProfileSlice,
    report::Grade,
};

/// A result file of a job. It becomes visible with the row that names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Artifact {
    /// The name of a `StackArtifact`, `lights/{name}`, `overlay-{slice}`, `report`, or a file of a reconstruction.
    pub name: String,
    /// Key in the blob store; not shown to clients.
    #[serde(skip_serializing_if = "String::is_empty", default)]
    pub key: String,
    /// `image/png`, `image/tiff` or `image/jpeg`; `application/json` of a report; others of a reconstruction.
    pub media_type: String,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex; also its `ETag`.
    pub sha256: String,
    /// CRC-32, for zips that contain the file; `None` in rows older than this member.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crc32: Option<u32>,
}

/// Properties of the fused image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImageInfo {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bits per sample, 8 or 16.
    pub bit_depth: u8,
    /// Position of its top-left pixel in the reference slice, `[x, y]` px. Subtract it from the principal point.
    pub crop_offset_px: [u32; 2],
    /// Pinhole camera of the image; null when the profile lacks `principal_distance_mm` or `pixel_pitch_mm`.
    #[serde(default)]
    pub intrinsics: Option<Intrinsics>,
}

/// How to read a height map. A pixel with the value `v` above 0 has the height `offset + (v - 1) scale`, with the
/// standard deviation `s scale`, where `s` is the value of the same pixel of `height-sigma`. The plane in focus in the
/// reference slice has the height 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HeightInfo {
    /// Unit of `offset`, `scale` and `median_sigma`: `mm` in the object, `rail_mm` (travel of the rail), or `steps`
    /// from slice to slice.
    pub unit: HeightUnit,
    /// `towards_camera`: larger is nearer to the camera. `with_slice_number`: larger is focused in a later slice; which
    /// end of the stack is near is unknown.
    pub direction: HeightDirection,
    /// Height of the value 1.
    pub offset: f64,
    /// Difference of the heights of neighbouring values.
    pub scale: f64,
    /// Value of pixels without a height, in both files: 0.
    pub invalid: u16,
    /// Median standard deviation of all heights; null if no pixel has a height.
    pub median_sigma: Option<f64>,
    /// Fraction of the object (without a mask, of the canvas) that has a height.
    pub valid_fraction: f64,
}

/// The outcome of a stack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StackOutcome {
    /// The files.
    pub artifacts: Vec<Artifact>,
    /// Properties of the fused image.
    pub image: ImageInfo,
    /// How to read the height map; null without one.
    #[serde(default)]
    pub height: Option<HeightInfo>,
    /// Quality metrics.
    pub metrics: Metrics,
    /// Program and version that made it, as in the EXIF tag `Software`; null for results older than this member.
    #[serde(default)]
    pub software: Option<String>,
}

/// The outcome of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationOutcome {
    /// The files: one overlay per slice, and the report.
    pub artifacts: Vec<Artifact>,
    /// Number of the profile revision that was stored; `None` when the option `keep` excluded it.
    #[serde(default)]
    pub profile_revision: Option<u32>,
    /// SHA-256 of its geometry and gains, hex.
    #[serde(default)]
    pub profile_digest: Option<String>,
    /// SHA-256 of its camera data, hex; `None` in rows older than this member.
    #[serde(default)]
    pub profile_optics_digest: Option<String>,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// What was measured in each slice.
    pub slices: Vec<ProfileSlice>,
    /// Distance between neighbouring dots in the reference slice, px.
    pub dot_pitch_px: Option<f64>,
    /// Magnification (image size / object size), if `target_pitch_mm` and `pixel_pitch_mm` were given.
    pub magnification: Option<f64>,
    /// A one-sentence summary for the operator of the rig.
    pub verdict: String,
    /// The verdict in one word; `None` in rows older than this member.
    #[serde(default)]
    pub grade: Option<Grade>,
}

/// What a reconstruction found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ReconstructionOutcome {
    /// The files.
    pub artifacts: Vec<Artifact>,
    /// The numbers.
    #[serde(flatten)]
    pub result: ReconstructionResult,
}

/// The outcome of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
// one per job, never in bulk: a box would save nothing
#[allow(clippy::large_enum_variant)]
pub enum JobOutcome {
    /// A fused stack.
    Stack(StackOutcome),
    /// A calibrated profile.
    Calibration(CalibrationOutcome),
    /// A reconstruction.
    Reconstruction(ReconstructionOutcome),
}

impl JobOutcome {
    /// Total size of all files, bytes.
    pub fn bytes(&self) -> u64 {
        self.artifacts().iter().map(|artifact| artifact.bytes).sum()
    }

    /// The files.
    pub fn artifacts(&self) -> &[Artifact] {
        match self {
            Self::Stack(outcome) => &outcome.artifacts,
            Self::Calibration(outcome) => &outcome.artifacts,
            Self::Reconstruction(outcome) => &outcome.artifacts,
        }
    }
}
