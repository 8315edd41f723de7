//! What the steps of the height map hand on.

use crate::imaging::Plane;

/// Estimates of the height, of pixels or cells.
pub(super) struct Estimates {
    /// Position in steps.
    pub position: Plane<f32>,
    /// Confidence: 1 / variance of the position, per squared step; 0 where nothing is known.
    pub confidence: Plane<f32>,
}
