//! The life of a job.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What a job does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobKind {
    /// Fuse a stack.
    Stack,
    /// Measure a profile from a dot-target stack.
    Calibration,
}

impl JobKind {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Stack, Self::Calibration];

    /// As the contract spells it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Stack => "stack",
            Self::Calibration => "calibration",
        }
    }
}

/// Where a job is in its life. `queued -> running -> one of the other three`, and back from `running` to
/// `queued` only when its worker died.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waits for a worker.
    Queued,
    /// A worker has it.
    Running,
    /// Ended with results.
    Succeeded,
    /// Ended with an error.
    Failed,
    /// Ended because it was cancelled.
    Cancelled,
}

impl JobState {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// True once nothing changes any more.
    pub fn is_final(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Cancelled)
    }

    /// As the contract spells it.
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

/// How far a job is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// What is being done: `waiting`, `reading`, `aligning`, `fusing`, `masking`, `writing`, `detecting`, ...;
    /// `waiting for room on the disk` when a worker has it and the disk is too full to begin.
    pub stage: String,
    /// Steps of this stage that are done.
    pub completed: u32,
    /// Steps of this stage in all.
    pub total: u32,
    /// Share of the whole job that is done, 0 to 1; never goes back within one attempt.
    pub fraction: f64,
}
