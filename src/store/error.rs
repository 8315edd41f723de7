//! The error of the storage layer, and what an error of the file system means to it.

use std::io;

/// Why the store could not do what was asked. Clients never see it as it is: `http::problem` maps it to a problem.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The disk, or a quota of the operating system, is full.
    #[error("the disk is full: {0}")]
    DiskFull(String),
    /// The storage is on another machine and does not answer, or asks to try again later: the same may succeed then.
    #[error("the storage is not available: {0:#}")]
    Unavailable(anyhow::Error),
    /// A cursor that no list of this store returned: the client's mistake.
    #[error("invalid cursor")]
    InvalidCursor,
    /// Any other failure; the log has the details.
    #[error(transparent)]
    Other(#[from] anyhow::Error),
}

impl StoreError {
    /// Classifies an error of the file system. `what` says which operation failed.
    pub(crate) fn of_io(error: io::Error, what: String) -> Self {
        if is_full(&error) { Self::DiskFull(what) } else { Self::Other(anyhow::Error::new(error).context(what)) }
    }
}

/// Result of an operation of the store.
pub type StoreResult<T> = Result<T, StoreError>;

/// True when the disk, or a quota of the operating system, is full.
pub fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}
