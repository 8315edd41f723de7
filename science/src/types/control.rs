//! How long work reports its progress and learns that it is no longer wanted.

/// The work was cancelled; whoever sees this stops and publishes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// A line to the outside for long work. Called often (per slice, per tile), so it must be cheap.
pub trait Control: Sync {
    /// `completed` of `total` steps of `stage` are done. Stages follow one another; `completed` grows.
    fn progress(&self, stage: &'static str, completed: usize, total: usize);

    /// `Err` once the work is no longer wanted. Ask it at least every 100 ms of work.
    ///
    /// # Errors
    /// [`Cancelled`] when the caller should stop.
    fn check(&self) -> Result<(), Cancelled>;
}

/// Work that nobody watches and nobody cancels: tests, benches, library callers.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoControl;

impl Control for NoControl {
    fn progress(&self, _stage: &'static str, _completed: usize, _total: usize) {}
    fn check(&self) -> Result<(), Cancelled> {
        Ok(())
    }
}

/// Why work ended early.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Interrupted {
    /// Nobody wants it any more.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// It cannot be done, and a person can be told why.
    #[error(transparent)]
    Failed(#[from] super::Error),
}
