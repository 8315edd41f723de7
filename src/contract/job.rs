//! Kind, state and progress of a job.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Kind of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobKind {
    /// Fuse a stack.
    Stack,
    /// Calibrate a profile from a dot-target stack.
    Calibration,
    /// Reconstruct the views of a scan.
    Reconstruction,
}

impl JobKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Stack, Self::Calibration, Self::Reconstruction];

    /// Its name in the API.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stack => "stack",
            Self::Calibration => "calibration",
            Self::Reconstruction => "reconstruction",
        }
    }
}

/// State of a job: `queued`, then `running`, then one of `succeeded`, `failed` and `cancelled`. A running job returns
/// to `queued` only when its worker died or was shut down, or when the machine or the storage failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waiting for a worker.
    Queued,
    /// A worker is executing it.
    Running,
    /// Ended with results.
    Succeeded,
    /// Ended with an error.
    Failed,
    /// Cancelled by a client.
    Cancelled,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 5] = [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// True for the states in which a job has ended.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// Its name in the API.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }
}

/// Progress of a job.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// Current stage: `waiting`, `reading`, `aligning`, `fusing`, `correcting halos`, `masking`, `writing`,
    /// `detecting`, `matching` and others. `waiting for disk space`: a worker has claimed the job, and there is not
    /// enough free disk space to begin.
    pub stage: String,
    /// Completed steps of this stage.
    pub completed: u32,
    /// Steps of this stage in all.
    pub total: u32,
    /// Completed fraction of the whole job, 0 to 1. It never decreases within one attempt.
    pub fraction: f64,
}
