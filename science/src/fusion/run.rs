//! The inputs of one call of [`fuse`](super::fuse), for all of its steps.

use std::path::Path;

use super::{
    plan::{FusionRequest, Plan},
    sample_format::FormattedSlices,
};
use crate::{imaging::Plane, types::Control};

/// One call of [`fuse`](super::fuse).
pub(super) struct Run<'a> {
    pub slices: FormattedSlices<'a>,
    pub plan: &'a Plan,
    pub request: &'a FusionRequest<'a>,
    pub scratch_dir: &'a Path,
    pub control: &'a dyn Control,
    /// The slice of each pixel, where [`fuse_by_decision_map`](super::fuse_by_decision_map) gives it.
    pub decision_map: Option<&'a Plane<u16>>,
    /// Largest side of a tile of the second pass, px. It does not affect the result.
    pub tile: usize,
}
