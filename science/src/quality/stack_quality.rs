//! All metrics of a stack, as [`finish`](super::finish) combines them.

use crate::types::metrics::{AlignmentMetrics, Finding, FocusMetrics, FusionMetrics, SliceMetrics};

/// The metrics of one light of a stack.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StackQuality {
    /// How well the fused image preserves the detail of the sharpest slices.
    pub fusion: FusionMetrics,
    /// Whether the slices cover the object in depth.
    pub focus: FocusMetrics,
    /// Whether the profile fits this stack.
    pub alignment: AlignmentMetrics,
    /// One entry per slice, in order.
    pub slices: Vec<SliceMetrics>,
    /// Faults and remarks, warnings first.
    pub findings: Vec<Finding>,
}
