//! The priority of a job.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Which jobs of a rig are fused first. Rigs take turns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Priority {
    /// Before the other jobs of its rig. Calibrations have it: somebody waits beside the rig.
    High,
    /// As stacks are, unless they ask for another.
    #[default]
    Normal,
    /// Only when no other job of any rig waits. For a collection that is fused again.
    Low,
}
