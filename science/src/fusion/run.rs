//! The inputs of one call of [`fuse`](super::fuse), for all of its steps.

use std::{
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
};

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

/// The guarded value. A panic elsewhere is ignored: it ends the call, and the value is discarded with it.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The value of a mutex that is no longer shared.
pub(super) fn unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
