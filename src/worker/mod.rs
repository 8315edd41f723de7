//! Workers: claim a job, keep its lease, run it, publish its results. They know jobs, not images.
//!
//! | module | task |
//! |---|---|
//! | [`pool`] | the workers of one process; each claims one job at a time |
//! | `executor` | one claimed job: admission, run, publication, end |
//! | `ending` | how the run of a job ended |
//! | `lease_keeper` | heartbeats, progress and cancellation of a running job |
//! | [`pictures`] | places the pictures of a reconstruction in its scratch folder |
//! | `disk_admission` | reserves disk space before a job starts |
//! | `trace` | the span of a job in the traces of OpenTelemetry |
//! | [`maintenance`] | hourly garbage collection |

mod disk_admission;
mod ending;
mod executor;
mod lease_keeper;
pub mod maintenance;
pub mod pictures;
pub mod pool;
mod stages;
mod trace;

pub use pool::Pool;

use std::{sync::Arc, time::Duration};

use crate::{disk_budget::DiskBudget, jobs::JobRunner, store::Store};

/// Heartbeats per lease: several may be late before the lease expires.
pub const BEATS_PER_LEASE: u32 = 15;

/// What workers need.
#[derive(Clone)]
pub struct Deps {
    /// Jobs, profiles, uploads and results.
    pub store: Store,
    /// The disk budget that jobs share with uploads.
    pub disk: Arc<DiskBudget>,
    /// Runs the jobs.
    pub runner: Arc<dyn JobRunner>,
}

/// Settings of the workers.
#[derive(Debug, Clone)]
pub struct Config {
    /// Number of jobs that run at a time.
    pub workers: usize,
    /// Time without a heartbeat until another worker may claim the job. Short, so that a restart continues soon.
    pub lease: Duration,
    /// Time between heartbeats without progress; a cancellation by another process is observed within it.
    pub beat: Duration,
    /// Minimum time between heartbeats with progress.
    pub progress_gap: Duration,
    /// How often the queue is polled: other processes accept jobs and lose leases too.
    pub poll: Duration,
    /// Largest number of attempts that count: those whose worker died, and those that ended with an error of the
    /// machine.
    pub max_attempts: u32,
    /// Time until the next claim of a job whose first attempt failed with an error of the machine; longer after each
    /// attempt.
    pub retry_pause: Duration,
    /// Memory for all running jobs together, bytes. A job that needs more than that runs alone.
    pub memory_budget: u64,
    /// What the machine or container has for jobs, bytes. A job that needs more than that fails, because the system
    /// would kill the process.
    pub memory_limit: Option<u64>,
}

impl Default for Config {
    /// One worker, a lease of 15 s, a heartbeat per second, five per second with progress, 3 attempts, 10 s until the
    /// second, 2 GiB of memory, of a machine that has more.
    fn default() -> Self {
        Self {
            workers: 1,
            lease: Duration::from_secs(15),
            beat: Duration::from_secs(1),
            progress_gap: Duration::from_millis(200),
            poll: Duration::from_secs(1),
            max_attempts: 3,
            retry_pause: Duration::from_secs(10),
            memory_budget: 2 << 30,
            memory_limit: None,
        }
    }
}

#[cfg(test)]
mod tests;
