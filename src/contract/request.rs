//! What a job was asked to do, as its row keeps it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use pinstack_science::types::{calibration_options::CalibrationOptions, stack_layout::StackLayout};

use super::{Name, options::StackOptions};

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
