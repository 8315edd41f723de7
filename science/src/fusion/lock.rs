//! Values behind a mutex, of a call that ends with the first panic.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// The guarded value. A panic elsewhere is ignored: it ends the call, and the value is discarded with it.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The value of a mutex that is no longer shared.
pub(super) fn unlocked<T>(mutex: Mutex<T>) -> T {
    mutex.into_inner().unwrap_or_else(PoisonError::into_inner)
}
