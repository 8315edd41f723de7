//! What one job does: archive -> science -> artifacts. No rows and no leases here; those are the worker's.

pub mod calibration;
pub mod compose;
mod copies;
mod diagnosis;
pub mod disk;
mod levels;
pub mod memory;
mod pictures;
mod press;
pub mod preview;
pub mod stack;
pub mod stages;
#[cfg(test)]
pub(crate) mod testkit;
mod threads;

use crate::contract::JobError;
use std::{path::PathBuf, time::Instant};

use crate::{
    contract::{Progress, outcome::JobOutcome, profile::Profile, request::JobRequest},
    store::{Job, ProfileDraft},
};
use pinstack_science::{
    archive::ArchiveLimits,
    types::{Cancelled, Warning},
};
use threads::with_own_threads;

/// Program and version, as results name it.
pub const SOFTWARE: &str = concat!("pinstack ", env!("CARGO_PKG_VERSION"));

/// The work of the service: fuses stacks, measures profiles.
#[derive(Debug, Clone)]
pub struct Science {
    /// Threads that each job works with; enters the memory that it is said to need.
    pub threads: usize,
    /// How much an archive may hold: the same as at the POST.
    pub archive_limits: ArchiveLimits,
}

impl Default for Science {
    /// As many threads as there are cores.
    fn default() -> Self {
        Self { threads: rayon::current_num_threads(), archive_limits: ArchiveLimits::default() }
    }
}

impl Work for Science {
    fn memory_need(&self, request: &JobRequest) -> u64 {
        memory::memory_need(request, self.threads)
    }

    fn disk_need(&self, request: &JobRequest) -> u64 {
        disk::disk_need(request)
    }

    fn run(&self, bench: &Bench, watcher: &dyn Watcher) -> Result<Made, JobError> {
        with_own_threads(self.threads, || match &bench.job.request {
            JobRequest::Stack(request) => stack::run(bench, request, &self.archive_limits, watcher),
            JobRequest::Calibration(request) => calibration::run(bench, request, &self.archive_limits, watcher),
        })
    }
}

/// Everything that a job finds on its bench.
#[derive(Debug)]
pub struct Bench {
    /// The job as it was claimed.
    pub job: Job,
    /// The profile that the request names; `None` for a calibration.
    pub profile: Option<Profile>,
    /// The uploaded zip.
    pub archive: PathBuf,
    /// An empty folder of its own, on the file system of the blobs; removed after the job.
    pub scratch: PathBuf,
    /// When it was claimed.
    pub started: Instant,
}

/// A file that a job made, and the key under which it shall be published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MadeFile {
    /// In the scratch folder.
    pub path: PathBuf,
    /// As the outcome's artifact names it.
    pub key: String,
}

/// What a job made.
#[derive(Debug)]
pub struct Made {
    /// What the row will show.
    pub outcome: JobOutcome,
    /// What the user should know, beyond what was known at the POST.
    pub warnings: Vec<Warning>,
    /// The profile that a calibration measured.
    pub profile: Option<Box<ProfileDraft>>,
    /// The files of the outcome's artifacts.
    pub files: Vec<MadeFile>,
}

/// How a job tells where it is, and learns that it is no longer wanted.
pub trait Watcher: Sync {
    /// The job is here now. Called often, so it must be cheap.
    fn report(&self, progress: Progress);

    /// `Err` once the job is no longer wanted.
    ///
    /// # Errors
    /// [`Cancelled`] when the job should stop and leave everything as it is.
    fn check(&self) -> Result<(), Cancelled>;
}

/// What workers do with jobs. The service's own is in this module; tests bring others.
pub trait Work: Send + Sync + 'static {
    /// Bytes of memory that the job will need at its peak.
    fn memory_need(&self, request: &JobRequest) -> u64;

    /// Bytes that it may write at most, beyond its upload.
    fn disk_need(&self, request: &JobRequest) -> u64;

    /// Does the job, on a thread that may block.
    ///
    /// # Errors
    /// [`JobError::Cancelled`] when the watcher said so; [`JobError::Failed`] when it cannot be done.
    fn run(&self, bench: &Bench, watcher: &dyn Watcher) -> Result<Made, JobError>;
}
