//! Values behind a mutex, of a call that ends with the first panic; and buffers that threads take in turn.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// The guarded value. A panic elsewhere is ignored: it ends the call, and the value is discarded with it.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The value of a mutex that is no longer shared.
pub(super) fn unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}

/// Buffers that no thread uses at the moment: at most one per thread. rayon's `map_init` would make new ones for each
/// piece of work that a thread takes, which for tiles is each tile.
pub(super) struct Spare<T>(Mutex<Vec<T>>);

impl<T> Spare<T> {
    /// None yet.
    pub(super) fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Does `work` with buffers that `make` makes if none are spare.
    pub(super) fn with<R>(&self, make: impl FnOnce() -> T, work: impl FnOnce(&mut T) -> R) -> R {
        let spare = locked(&self.0).pop();
        let mut buffers = spare.unwrap_or_else(make);
        let result = work(&mut buffers);
        locked(&self.0).push(buffers);
        result
    }
}
