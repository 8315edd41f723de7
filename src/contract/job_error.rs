//! Why a job ended without results.

use pinstack_science::types::{Cancelled, Error, Interrupted};

use super::Fault;

/// Why a job ended without results.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum JobError {
    /// It was stopped: a client cancelled it, its lease was lost, or the process is shutting down.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// It failed, for a reason that is shown to the client.
    #[error(transparent)]
    Failed(#[from] Fault),
}

impl From<Error> for JobError {
    fn from(error: Error) -> Self {
        Self::Failed(error.into())
    }
}

impl From<Interrupted> for JobError {
    fn from(interrupted: Interrupted) -> Self {
        match interrupted {
            Interrupted::Cancelled(cancelled) => Self::Cancelled(cancelled),
            Interrupted::Failed(error) => error.into(),
        }
    }
}
