//! The request of a job, as its row keeps it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use pinstack_science::types::{calibration_options::CalibrationOptions, stack_layout::StackLayout};

use super::{Name, Priority, options::StackOptions, reconstruction::ReconstructionRequest};

pub use super::upload::Upload;

/// The request of a stack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StackRequest {
    /// All options, with defaults filled in.
    pub options: StackOptions,
    /// Revision of the profile, fixed when the stack is accepted.
    pub profile_revision: u32,
    /// SHA-256 of its geometry and gains, hex.
    pub profile_digest: String,
    /// SHA-256 of its camera data, hex; `None` in rows older than this member.
    #[serde(default)]
    pub profile_optics_digest: Option<String>,
    /// The zip.
    pub upload: Upload,
    /// The contents of the zip.
    pub layout: StackLayout,
    /// For a rerun: the stack whose zip is used again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rerun_of: Option<Uuid>,
}

/// The request of a calibration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CalibrationRequest {
    /// All options.
    pub options: CalibrationOptions,
    /// The zip; of stored stacks that of the first.
    pub upload: Upload,
    /// The contents of the zip; `back` is empty.
    pub layout: StackLayout,
    /// The stored stacks whose pictures it uses; empty if they were sent.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stacks: Vec<StoredStack>,
}

/// A stored stack whose zip a calibration reads. It is found by the id when the job runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StoredStack {
    /// The stack.
    pub id: Uuid,
    /// Size of its zip, bytes.
    pub bytes: u64,
    /// True if its slices are in the reverse order of those of the profile.
    pub reversed: bool,
}

/// The request of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum JobRequest {
    /// Fuse a stack.
    Stack(StackRequest),
    /// Calibrate a profile.
    Calibration(CalibrationRequest),
    /// Reconstruct the views of a scan.
    Reconstruction(ReconstructionRequest),
}

impl JobRequest {
    /// The kind of the job.
    pub fn kind(&self) -> super::JobKind {
        match self {
            Self::Stack(_) => super::JobKind::Stack,
            Self::Calibration(_) => super::JobKind::Calibration,
            Self::Reconstruction(_) => super::JobKind::Reconstruction,
        }
    }

    /// The zip. Of a reconstruction, size and digest of the pictures that it reads, without a key.
    pub fn upload(&self) -> &Upload {
        match self {
            Self::Stack(request) => &request.upload,
            Self::Calibration(request) => &request.upload,
            Self::Reconstruction(request) => &request.upload,
        }
    }

    /// The zip, if the job has one of its own.
    pub fn own_upload(&self) -> Option<&Upload> {
        Some(self.upload()).filter(|_| self.kind() != super::JobKind::Reconstruction)
    }

    /// The stored stacks whose zips a calibration reads beside its own.
    pub fn other_stacks(&self) -> &[StoredStack] {
        match self {
            Self::Stack(_) | Self::Reconstruction(_) => &[],
            Self::Calibration(request) => request.stacks.get(1..).unwrap_or_default(),
        }
    }

    /// The contents of the zip; `None` for a reconstruction.
    pub fn layout(&self) -> Option<&StackLayout> {
        match self {
            Self::Stack(request) => Some(&request.layout),
            Self::Calibration(request) => Some(&request.layout),
            Self::Reconstruction(_) => None,
        }
    }

    /// Which jobs of its rig it comes before.
    pub fn priority(&self) -> Priority {
        match self {
            Self::Stack(request) => request.options.priority,
            Self::Calibration(_) => Priority::High,
            Self::Reconstruction(_) => Priority::Normal,
        }
    }

    /// The scan that the stack or reconstruction belongs to; `None` for a calibration.
    pub fn scan(&self) -> Option<&Name> {
        match self {
            Self::Stack(request) => request.options.scan.as_ref(),
            Self::Calibration(_) => None,
            Self::Reconstruction(request) => Some(&request.scan),
        }
    }
}
