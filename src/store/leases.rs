//! Leases: how workers hold jobs.
//!
//! A claim takes a queued job, or a running one whose lease expired, and increments its `lease_token`. Each later write
//! of the worker is conditional on that token (`WHERE id = ? AND lease_token = ?`). A worker that lost its lease can
//! therefore write blobs, but it can never publish them.

use std::time::Duration;

use async_trait::async_trait;
use uuid::Uuid;

use super::{Job, ProfileDraft, StoreResult};
use crate::contract::{Fault, JobKind, Progress, outcome::JobOutcome};
use pinstack_science::types::Warning;

/// Answer to the heartbeat of a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heartbeat {
    /// The lease is renewed.
    Alive,
    /// A client requested the cancellation: stop, then `finish` with [`Finish::Cancelled`].
    CancelRequested,
    /// Another worker holds the job, or it was removed: stop and publish nothing.
    Lost,
}

/// How a job ends.
#[derive(Debug, Clone, PartialEq)]
pub enum Finish {
    /// With results. The profile of a calibration becomes a revision in the same transaction; the store fills in
    /// `profile_revision` and `profile_digest` of the outcome.
    Succeeded {
        /// What was produced.
        outcome: Box<JobOutcome>,
        /// All warnings of the job.
        warnings: Vec<Warning>,
        /// The profile that a calibration measured.
        profile: Option<Box<ProfileDraft>>,
    },
    /// With an error.
    Failed(Fault),
    /// On request.
    Cancelled,
}

/// Whether an attempt that is given up counts towards the limit of attempts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attempt {
    /// It counts: the job may be the reason. The job is not claimed again before `pause` has passed.
    Counted {
        /// Time until the next claim.
        pause: Duration,
    },
    /// It does not count, because the storage was not available: the job is not the reason. It is not claimed again
    /// before `pause` has passed.
    Postponed {
        /// Time until the next claim.
        pause: Duration,
    },
    /// It does not count: the server shuts down.
    NotCounted,
}

/// Claims jobs and ends them. Every write is fenced by the lease token.
#[async_trait]
pub trait Leases: Send + Sync + 'static {
    /// Claims a job for the time `lease`: one whose lease expired, or else the next of the queue, in which rigs take
    /// turns. Jobs of the kind `except` are left to other workers. A job whose worker was lost in attempt
    /// `max_attempts` fails with `worker_lost` instead.
    async fn claim(&self, lease: Duration, max_attempts: u32, except: Option<JobKind>) -> StoreResult<Option<Job>>;
    /// Renews the lease and stores the progress.
    async fn heartbeat(
        &self,
        id: Uuid,
        lease_token: i64,
        lease: Duration,
        progress: &Progress,
    ) -> StoreResult<Heartbeat>;
    /// Ends the job. False: the lease was lost and nothing was published. A cancellation that was requested before wins
    /// over success and failure: the result is still true, the job is `cancelled`, and what it produced is garbage
    /// ([`super::gc::gc_job`]).
    async fn finish(&self, id: Uuid, lease_token: i64, finish: &Finish) -> StoreResult<bool>;
    /// Gives an unfinished job back to the queue, or cancels or removes it if a client requested that. False: the lease
    /// was lost.
    async fn release(&self, id: Uuid, lease_token: i64, attempt: Attempt) -> StoreResult<bool>;
}
