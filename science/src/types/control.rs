//! Progress reports and cancellation of long computations.

/// The work was cancelled. The callee stops and returns no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Receives progress and requests cancellation. Called often (per slice, per tile), so it must be cheap.
pub trait Control: Sync {
    /// Reports that `completed` of `total` steps of `stage` are done. Stages are sequential; `completed` grows.
    fn progress(&self, stage: &'static str, completed: usize, total: usize);

    /// Returns an error once the work is cancelled. Call it at least every 100 ms.
    ///
    /// # Errors
    /// [`Cancelled`] when the work must stop.
    fn check(&self) -> Result<(), Cancelled>;
}

/// No progress and no cancellation: for tests, benches and library callers.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoControl;

impl Control for NoControl {
    fn progress(&self, _stage: &'static str, _completed: usize, _total: usize) {}
    fn check(&self) -> Result<(), Cancelled> {
        Ok(())
    }
}

/// Why a computation ended early.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Interrupted {
    /// It was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// It failed, with an error for the user.
    #[error(transparent)]
    Failed(#[from] super::Error),
}
