//! What a job was asked to do, as its row keeps it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::{Name, options::StackOptions, profile::CaptureMode};

/// A stored upload.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Upload {
    /// Key in the blob store.
    #[serde(skip_serializing_if = "String::is_empty", default)]
    pub key: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
    /// Name that the client gave, when it gave one.
    pub filename: Option<String>,
}

/// The slices of an archive in the order in which they are used, and the size of all of them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StackLayout {
    /// Names of the front-light slices, in order.
    pub front: Vec<String>,
    /// Names of the back-light slices, in order; empty without a back light.
    pub back: Vec<String>,
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// Bits per sample: 8 or 16 (the larger, when slices differ).
    pub bit_depth: u8,
    /// 1 grey or 3 RGB (the larger, when slices differ).
    pub channels: u8,
    /// EXIF orientation of the slices, 1 to 8, which was applied before width and height were taken; 1 without one.
    #[serde(default = "upright")]
    pub orientation: u8,
    /// Size of the largest file of a slice, unpacked; 0 when it was not recorded.
    #[serde(default)]
    pub largest_file_bytes: u64,
}

fn upright() -> u8 {
    1
}

impl StackLayout {
    /// The same slices in the opposite order.
    #[must_use]
    pub fn reversed(mut self) -> Self {
        self.front.reverse();
        self.back.reverse();
        self
    }
}

/// What `POST /v1/stacks` asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StackRequest {
    /// Every option, defaults filled in.
    pub options: StackOptions,
    /// Revision of the profile that is used, fixed at the POST.
    pub profile_revision: u32,
    /// Its digest.
    pub profile_digest: String,
    /// The digest of its optics; `None` in rows of before there was one.
    #[serde(default)]
    pub profile_optics_digest: Option<String>,
    /// The zip.
    pub upload: Upload,
    /// What is in it.
    pub layout: StackLayout,
    /// The stack whose zip is used again; `None` when the zip was sent for this stack.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rerun_of: Option<Uuid>,
}

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

/// What `POST /v1/profiles/{rig}/{lens}/calibrations` asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationRequest {
    /// Every option.
    pub options: CalibrationOptions,
    /// The zip.
    pub upload: Upload,
    /// What is in it (`back` is empty).
    pub layout: StackLayout,
}

/// What a job was asked to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum JobRequest {
    /// Fuse a stack.
    Stack(StackRequest),
    /// Measure a profile.
    Calibration(CalibrationRequest),
}

impl JobRequest {
    /// The kind, as the row's column has it.
    pub fn kind(&self) -> super::JobKind {
        match self {
            Self::Stack(_) => super::JobKind::Stack,
            Self::Calibration(_) => super::JobKind::Calibration,
        }
    }

    /// The zip.
    pub fn upload(&self) -> &Upload {
        match self {
            Self::Stack(request) => &request.upload,
            Self::Calibration(request) => &request.upload,
        }
    }

    /// What is in the zip.
    pub fn layout(&self) -> &StackLayout {
        match self {
            Self::Stack(request) => &request.layout,
            Self::Calibration(request) => &request.layout,
        }
    }

    /// The scan that the stack belongs to.
    pub fn scan(&self) -> Option<&Name> {
        match self {
            Self::Stack(request) => request.options.scan.as_ref(),
            Self::Calibration(_) => None,
        }
    }
}
