//! Expiry of jobs and of their zips.
//!
//! Time that no process observed does not count: see [`Expiry::confirm_clock`].

use std::time::Duration;

use async_trait::async_trait;
use uuid::Uuid;

use super::StoreResult;

/// How long jobs are kept after their end, unless the job itself specifies it (`keep_days`). `None`: for ever.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Retention {
    /// Succeeded stacks with their results.
    pub stacks: Option<Duration>,
    /// Failed and cancelled stacks and calibrations.
    pub failed: Option<Duration>,
    /// Zips of succeeded stacks and calibrations; the results stay.
    pub uploads: Option<Duration>,
}

/// Removes what has expired. Blobs are removed afterwards, by [`super::gc`].
#[async_trait]
pub trait Expiry: Send + Sync + 'static {
    /// Removes some of the jobs whose retention time has expired. Returns their ids; none when all are removed.
    async fn delete_expired_jobs(&self, keep: &Retention) -> StoreResult<Vec<Uuid>>;
    /// Marks some of the zips whose retention time has expired as removed. Returns the ids of their jobs; none when all
    /// are marked.
    async fn expire_job_uploads(&self, keep: &Retention) -> StoreResult<Vec<Uuid>>;
    /// Confirms the wall clock after a jump: what has expired by this clock may be removed. Without it, a step of more
    /// than a day that no process observed does not count towards expiry.
    async fn confirm_clock(&self) -> StoreResult<()>;
}
