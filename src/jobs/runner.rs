//! What a job gets and returns, and the trait of what runs it.

use std::{path::PathBuf, sync::Arc, time::Instant};

use crate::{
    contract::{JobError, JobKind, Progress, outcome::JobOutcome, profile::Profile, request::JobRequest},
    store::{Job, ProfileDraft},
};
use pinstack_science::types::{Cancelled, ReadAt, Warning};

/// Program and version, as results record them.
pub const SOFTWARE: &str = concat!("pinstack ", env!("CARGO_PKG_VERSION"));

/// The input of a job.
#[derive(Debug)]
pub struct JobContext {
    /// The job as it was claimed.
    pub job: Job,
    /// The profile that the request names; `None` for a calibration.
    pub profile: Option<Profile>,
    /// The uploaded zip. It may still be on its way to this machine: reading waits. Empty for a reconstruction, whose
    /// pictures are in the folder [`BUNDLE`](super::reconstruction::BUNDLE) of `scratch`.
    pub archive: Arc<dyn ReadAt>,
    /// The zips of the [other stored stacks](JobRequest::other_stacks) of a calibration.
    pub others: Vec<Arc<dyn ReadAt>>,
    /// An empty folder for this job alone, on the file system of the blobs. It is removed after the job.
    pub scratch: PathBuf,
    /// When the job was claimed.
    pub started: Instant,
}

/// A file that a job wrote, and the key to publish it under.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputFile {
    /// Path in the scratch folder.
    pub path: PathBuf,
    /// Blob key, the same as in the artifact of the outcome.
    pub key: String,
}

/// The output of a job.
#[derive(Debug)]
pub struct JobOutput {
    /// The outcome that is stored with the job.
    pub outcome: JobOutcome,
    /// Warnings beyond those of the request.
    pub warnings: Vec<Warning>,
    /// The profile that a calibration measured.
    pub profile: Option<Box<ProfileDraft>>,
    /// The files of the outcome's artifacts.
    pub files: Vec<OutputFile>,
}

/// Where a job reports its progress and learns that it was cancelled.
pub trait ProgressSink: Sync {
    /// Reports the current progress. Called often, so it must be cheap.
    fn report(&self, progress: Progress);

    /// Checks for cancellation.
    ///
    /// # Errors
    /// [`Cancelled`] when the job must stop without any result.
    fn check(&self) -> Result<(), Cancelled>;
}

/// Runs jobs. [`ScienceRunner`](super::ScienceRunner) is the service's own; tests supply others.
pub trait JobRunner: Send + Sync + 'static {
    /// Whether it can run jobs of this kind on this machine.
    fn runs(&self, kind: JobKind) -> bool {
        let _ = kind;
        true
    }

    /// Peak memory of the job, bytes.
    fn memory_need(&self, request: &JobRequest) -> u64;

    /// Upper bound of what the job writes to disk, without its upload, bytes.
    fn disk_need(&self, request: &JobRequest) -> u64;

    /// Runs the job on a thread that may block.
    ///
    /// # Errors
    /// [`JobError::Cancelled`] when the sink reported a cancellation; [`JobError::Failed`] when the job cannot be done.
    fn run(&self, context: &JobContext, sink: &dyn ProgressSink) -> Result<JobOutput, JobError>;
}
