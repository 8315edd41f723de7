//! Workers: claim a job, keep its lease alive, have it done, make its end visible. They know jobs, not images.

mod attend;
mod lifeline;
pub mod maintenance;
mod pool;
mod room;
mod stages;

pub use pool::Pool;

use std::{sync::Arc, time::Duration};

use crate::{
    disk_budget::DiskBudget,
    jobs::JobRunner,
    store::{MetadataStore, blobs::Blobs},
};

/// Beats in the length of a lease: a few may be late before anybody takes a worker for dead.
pub const BEATS_PER_LEASE: u32 = 15;

/// What workers work with.
#[derive(Clone)]
pub struct Deps {
    /// Jobs and profiles.
    pub rows: Arc<dyn MetadataStore>,
    /// Uploads and results.
    pub blobs: Arc<dyn Blobs>,
    /// The room that jobs share with uploads.
    pub disk: Arc<DiskBudget>,
    /// What is done with a job.
    pub runner: Arc<dyn JobRunner>,
}

/// How workers work.
#[derive(Debug, Clone)]
pub struct Config {
    /// Jobs at a time.
    pub workers: usize,
    /// How long a job belongs to a worker that is not heard of. Short, so that a restart goes on soon.
    pub lease: Duration,
    /// Time between heartbeats when there is no news; a cancel by another process is seen within it.
    pub beat: Duration,
    /// Least time between heartbeats that bring progress.
    pub progress_gap: Duration,
    /// How often the queue is looked at without being told: other processes accept jobs and lose leases too.
    pub poll: Duration,
    /// Claims of a job whose worker dies each time.
    pub max_attempts: u32,
    /// Time before a job is claimed again that met an error of the machine at its first attempt; longer after each.
    pub retry_pause: Duration,
    /// Memory for all running jobs together, bytes. A job that needs more than all of it runs alone.
    pub memory_budget: u64,
}

impl Default for Config {
    /// One worker, 15 s lease, a beat a second, five times a second with news, 3 attempts, 10 s
    /// before the second, 2 GiB of memory.
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
        }
    }
}

#[cfg(test)]
mod tests;
