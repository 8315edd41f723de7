//! What one job does: archive -> science -> artifacts.
//!
//! In: a [`JobContext`] (the claimed job, its profile, the uploaded zip, a scratch folder). Out: a [`JobOutput`] (the
//! outcome, warnings and files). This module runs on a blocking thread and writes only into the scratch folder. Leases,
//! retries and publishing belong to [`crate::worker`].

mod artifact_writer;
mod calibrated_profile;
pub mod calibration;
mod crop;
mod diagnosis;
pub mod disk;
mod input_bits;
mod lights;
pub mod masked_views;
pub mod memory;
mod output_form;
mod pictures;
pub mod reconstruction;
mod requested;
mod runner;
mod slice_view;
pub mod stack;
pub mod stages;
#[cfg(test)]
pub(crate) mod testkit;
mod threads;
mod thumbnails;

use crate::contract::{
    JobError, JobKind,
    request::{CalibrationRequest, JobRequest},
};
use pinstack_science::archive::{ArchiveLimits, StackArchive};
pub use requested::mask_params;
pub use runner::{JobContext, JobOutput, JobRunner, OutputFile, ProgressSink, SOFTWARE};
pub use slice_view::{SliceLight, slice_view};
use threads::with_own_threads;

/// The job runner of the service: fuses stacks, measures profiles, and has scans reconstructed.
#[derive(Debug, Clone)]
pub struct ScienceRunner {
    /// Threads per job. More threads need more memory.
    pub threads: usize,
    /// Memory that one job may take, bytes. A job that would need more gets fewer threads; with one it may need more.
    pub memory: Option<u64>,
    /// Limits of an archive: those that the upload was checked against.
    pub archive_limits: ArchiveLimits,
    /// The program for reconstructions; `None`: this runner runs none.
    pub colmap: Option<reconstruction::Colmap>,
}

impl Default for ScienceRunner {
    /// One thread per core, without a limit of memory.
    fn default() -> Self {
        let threads = rayon::current_num_threads();
        Self { threads, memory: None, archive_limits: ArchiveLimits::default(), colmap: None }
    }
}

impl ScienceRunner {
    /// Runs a calibration on archives that are open: that of a dot target, or those of stacks of one rig.
    ///
    /// # Errors
    /// As [`JobRunner::run`].
    pub fn measure(
        &self,
        context: &JobContext,
        request: &CalibrationRequest,
        stacks: &[StackArchive],
        sink: &dyn ProgressSink,
    ) -> Result<JobOutput, JobError> {
        let threads = self.threads_for(&context.job.request);
        with_own_threads(threads, || calibration::measure(context, request, stacks, sink))
    }

    /// As many threads as fit into the memory; at least one.
    fn threads_for(&self, request: &JobRequest) -> usize {
        let fits = |threads: &usize| self.memory.is_none_or(|most| memory::memory_need(request, *threads) <= most);
        (1..=self.threads).rev().find(fits).unwrap_or(1)
    }
}

impl JobRunner for ScienceRunner {
    fn runs(&self, kind: JobKind) -> bool {
        kind != JobKind::Reconstruction || self.colmap.is_some()
    }

    fn memory_need(&self, request: &JobRequest) -> u64 {
        memory::memory_need(request, self.threads_for(request))
    }

    fn disk_need(&self, request: &JobRequest) -> u64 {
        match (request, &self.colmap) {
            (JobRequest::Reconstruction(request), Some(colmap)) => colmap.disk_need(request),
            _ => disk::disk_need(request),
        }
    }

    fn run(&self, context: &JobContext, sink: &dyn ProgressSink) -> Result<JobOutput, JobError> {
        with_own_threads(self.threads_for(&context.job.request), || match &context.job.request {
            JobRequest::Stack(request) => stack::run(context, request, &self.archive_limits, sink),
            JobRequest::Calibration(request) => calibration::run(context, request, &self.archive_limits, sink),
            JobRequest::Reconstruction(request) => {
                let threads = self.threads_for(&context.job.request);
                reconstruction::run(context, request, self.colmap.as_ref(), threads, sink)
            }
        })
    }
}
