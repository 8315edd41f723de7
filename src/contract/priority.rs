//! The priority of a job.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Which jobs are fused first. Within a priority, rigs take turns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Priority {
    /// Before all others. Calibrations have it: somebody waits beside the rig.
    High,
    /// As stacks are, unless they ask for another.
    #[default]
    Normal,
    /// Only when no other job waits, such as a whole collection that is fused again.
    Low,
}
