//! What a rail moves.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What moves between slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CaptureMode {
    /// The lens is fixed and the sensor moves: one centre of projection (Li and Nguyen, DICTA 2019).
    FixedLens,
    /// Camera and lens move together, and with them the centre of projection.
    MovingLens,
    /// The lens moves alone, and the camera body is fixed.
    LensAlone,
}
