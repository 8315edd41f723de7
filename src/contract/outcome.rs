//! What a job made, as its row keeps it once it succeeded.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use pinstack_science::types::{intrinsics::Intrinsics, metrics::Metrics, profile::ProfileSlice};

/// One file that a job made. It becomes visible only with the row that names it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Artifact {
    /// `image`, `mask`, `backlight`, `depth`, `preview`, `overlay-{slice}`, or `report`.
    pub name: String,
    /// Key in the blob store; not shown.
    #[serde(skip_serializing_if = "String::is_empty", default)]
    pub key: String,
    /// `image/png`, `image/tiff` or `image/jpeg`; `application/json` of a report.
    pub media_type: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256, hex: its `ETag`.
    pub sha256: String,
}

/// The image that came out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImageInfo {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bits per sample, 8 or 16.
    pub bit_depth: u8,
    /// Where its top-left pixel lies in the reference slice, `[x, y]` px: subtract it from the principal point.
    pub crop_offset_px: [u32; 2],
    /// The pinhole that it was taken with; null when the profile lacks `principal_distance_mm` or `pixel_pitch_mm`.
    #[serde(default)]
    pub intrinsics: Option<Intrinsics>,
}

/// What fusing a stack made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StackOutcome {
    /// The files.
    pub artifacts: Vec<Artifact>,
    /// The image that came out.
    pub image: ImageInfo,
    /// Its quality.
    pub metrics: Metrics,
    /// Program and version that made it, as in the EXIF tag `Software`; null of results that are older than this member.
    #[serde(default)]
    pub software: Option<String>,
}

/// What a calibration made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationOutcome {
    /// The files: one overlay per slice, and the report.
    pub artifacts: Vec<Artifact>,
    /// The revision that was stored.
    pub profile_revision: u32,
    /// Its digest.
    pub profile_digest: String,
    /// The digest of its optics; `None` in rows of before there was one.
    #[serde(default)]
    pub profile_optics_digest: Option<String>,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// One entry per slice.
    pub slices: Vec<ProfileSlice>,
    /// Distance between neighbouring dots in the reference slice, px.
    pub dot_pitch_px: Option<f64>,
    /// Image size over object size, when pitch and pixel size were told.
    pub magnification: Option<f64>,
    /// One sentence for the technician.
    pub verdict: String,
}

/// What a job made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
// One per job, never in bulk: a box would only make it harder to read.
#[allow(clippy::large_enum_variant)]
pub enum JobOutcome {
    /// A fused stack.
    Stack(StackOutcome),
    /// A profile.
    Calibration(CalibrationOutcome),
}

impl JobOutcome {
    /// Bytes of all files together.
    pub fn bytes(&self) -> u64 {
        self.artifacts().iter().map(|artifact| artifact.bytes).sum()
    }

    /// The files.
    pub fn artifacts(&self) -> &[Artifact] {
        match self {
            Self::Stack(outcome) => &outcome.artifacts,
            Self::Calibration(outcome) => &outcome.artifacts,
        }
    }
}
