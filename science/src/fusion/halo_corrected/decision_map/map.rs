//! What a decision map is.

use std::sync::Arc;

use crate::imaging::Plane;

#[cfg(doc)]
use crate::fusion::UNCOVERED;

/// Per pixel, the slice it is taken from.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct DecisionMap {
    /// 0-based index of the slice; [`UNCOVERED`] where no slice covers the canvas. Shared with the result of the first
    /// pass, whose index it replaces.
    pub slice: Arc<Plane<u16>>,
    /// Whether the pixel has detail of its own in that slice.
    pub textured: Plane<bool>,
}
