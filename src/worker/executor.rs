//! Runs one claimed job: admission to memory and disk, the work itself on a blocking thread, publication of the
//! results, and the transition that ends the job.

use std::{
    fs::File,
    sync::Arc,
    time::{Duration, Instant},
};

use tokio::sync::{OwnedMutexGuard, OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::CancellationToken;
use tracing::{Instrument, Span, field};

use super::{
    Config, Deps,
    ending::{Ending, Stopped, internal},
    lease_keeper::LeaseKeeper,
    pictures::place_pictures,
    trace::Trace,
};
use crate::{
    contract::{Code, Fault, JobError, Progress, one_line, profile::Profile, request::JobRequest},
    disk_budget::Reservation,
    jobs::{JobContext, JobOutput, ProgressSink, reconstruction::BUNDLE},
    store::{Finish, Job, SpoolFile, StoreError, StoreResult, blobs::upload_key, failpoint::step, gc::gc_job},
    telemetry::{events, traces},
};
use pinstack_science::types::{Cancelled, ReadAt};

/// What a job reads: its profile, its zip, and the zips of other stacks.
type Input = (Option<Profile>, Arc<dyn ReadAt>, Vec<File>);

/// Unit of the memory budget.
pub(super) const MB: u64 = 1 << 20;
/// Attempts to write the end of a job. When all fail, the lease expires and the job runs again.
const END_ATTEMPTS: u32 = 5;

/// The pause between two of these attempts is at most the lease divided by this. It must be shorter than a fifth of the
/// lease: for that long after the storage was unavailable, no other worker takes the job.
const END_PAUSES_PER_LEASE: u32 = 10;

/// State that all workers of a pool share.
pub(super) struct Executor {
    pub(super) deps: Deps,
    pub(super) config: Config,
    /// The memory budget; one permit per megabyte.
    pub(super) memory: Arc<Semaphore>,
    /// Cancelled at shutdown: running jobs return to the queue.
    pub(super) abandon: CancellationToken,
}

impl Executor {
    /// Number of permits of the whole memory budget.
    pub(super) fn whole_budget(&self) -> u32 {
        u32::try_from(self.config.memory_budget.div_ceil(MB))
            .unwrap_or(u32::MAX)
            .clamp(1, Semaphore::MAX_PERMITS as u32)
    }

    /// Runs a claimed job to its end, within a span of its trace. `gate` prevents other workers from claiming. It is
    /// released when the job has its memory; if a worker died on this job before, when the job has ended. So a job that
    /// kills the process does not cost other jobs an attempt.
    pub(super) async fn run_claimed_job(&self, job: Job, gate: OwnedMutexGuard<()>) {
        let trace = Trace::of(&job);
        let log = trace.log_span();
        traces::within(trace.span(), self.run_in_trace(job, gate, &trace)).instrument(log).await;
    }

    async fn run_in_trace(&self, job: Job, gate: OwnedMutexGuard<()>, trace: &Trace) {
        tracing::info!(kind = ?job.request.kind(), attempt = job.attempt, "job claimed");
        let started = Instant::now();
        let _busy = events::busy();
        let keeper = Arc::new(LeaseKeeper::starting_at(job.progress.clone()));
        // when this future is dropped, the thread of the job must stop
        let _stop = keeper.stop_on_drop();
        let result = tokio::select! {
            result = self.run(&job, &keeper, gate, trace) => result,
            () = keeper.keep(&self.deps, &self.config, &job, &self.abandon) => Err(JobError::Cancelled(Cancelled).into()),
        };
        let kind = job.request.kind();
        let may_retry = job.attempt < self.config.max_attempts;
        let ending = Ending::of(result, keeper.stop_reason(), may_retry, |code| self.pause(code, job.attempt));
        let (code, detail) = ending.fault().map(|fault| (fault.code.name(), one_line(&fault.detail))).unzip();
        let (rig, lens) = (&job.rig, &job.lens);
        tracing::info!(
            ?kind, %rig, %lens, attempt = job.attempt, ending = ending.name(),
            code = code.map(field::display), detail, "job leaves its worker"
        );
        events::left(kind, ending.event(), started.elapsed());
        for (stage, time) in keeper.stage_times() {
            events::stage_done(kind, stage, time);
        }
        trace.ending(ending.event(), ending.fault());
        match traces::section("publish", self.write_end(&job, &ending)).await {
            Ok(true) => {
                if let Ending::Finished(Finish::Failed(fault)) = &ending {
                    events::failed(kind, fault.code);
                }
            }
            Ok(false) => events::lease_lost(kind),
            Err(error) => {
                tracing::error!(?error, "the end of a job cannot be written; it will run again");
            }
        }
        if let Err(error) = gc_job(&self.deps.store, job.id).await {
            tracing::warn!(?error, "the blobs that a job left cannot be removed; the next garbage collection retries");
        }
    }

    async fn run(
        &self,
        job: &Job,
        keeper: &Arc<LeaseKeeper>,
        gate: OwnedMutexGuard<()>,
        trace: &Trace,
    ) -> Result<Finish, Stopped> {
        let started = Instant::now();
        let _admitted = traces::section("admit", self.admit(job, keeper, gate)).await?;
        let (profile, archive, others) = traces::section("fetch input", self.input_of(job, keeper)).await?;
        step("scratch.make")
            .map_err(|error| internal(StoreError::of_io(error, "cannot create a scratch folder".into())))?;
        let scratch = tempfile::Builder::new()
            .prefix("job-")
            .tempdir_in(self.deps.store.workspace.path())
            .map_err(|error| internal(StoreError::of_io(error, "cannot create a scratch folder".into())))?;
        if let JobRequest::Reconstruction(request) = &job.request {
            let folder = scratch.path().join(BUNDLE);
            let placing = traces::section("place pictures", place_pictures(&self.deps.store, request, &folder));
            tokio::select! {
                placed = placing => placed?,
                () = keeper.stopped() => return Err(JobError::Cancelled(Cancelled).into()),
            }
        }
        let context = JobContext {
            job: job.clone(),
            profile,
            archive,
            others: others.into_iter().map(|file| Arc::new(file) as _).collect(),
            scratch: scratch.path().to_owned(),
            started,
        };
        let output = self.on_a_thread(context, Arc::clone(keeper)).await;
        trace.add_stages(keeper);
        let output = output?;
        traces::section("store results", self.store_files(&output)).await?;
        let mut warnings = job.warnings.clone();
        warnings.extend(output.warnings.into_iter().filter(|warning| !job.warnings.contains(warning)));
        Ok(Finish::Succeeded { outcome: Box::new(output.outcome), warnings, profile: output.profile })
    }

    /// Waits for memory and disk space.
    async fn admit(&self, job: &Job, keeper: &LeaseKeeper, gate: OwnedMutexGuard<()>) -> Result<Admitted, Stopped> {
        let suspect = job.attempt > 1;
        let whole = self.whole_budget();
        let need = self.deps.runner.memory_need(&job.request);
        if let Some(limit) = self.config.memory_limit.filter(|limit| need > *limit) {
            return Err(Stopped::TooLarge(needs_more_memory(need, limit)));
        }
        let need = u32::try_from(need.div_ceil(MB)).unwrap_or(u32::MAX);
        let permits = if suspect { whole } else { need.min(whole) };
        let memory = tokio::select! {
            permit = Arc::clone(&self.memory).acquire_many_owned(permits) => permit.map_err(|_| Fault::new(Code::Unavailable, "the service is shutting down"))?,
            () = keeper.stopped() => return Err(JobError::Cancelled(Cancelled).into()),
        };
        let reserved = events::memory_reserved(u64::from(permits) * MB);
        let gate = suspect.then_some(gate);
        let disk = self.reserve_disk(job, keeper).await?;
        Ok(Admitted { _disk: disk, _gate: gate, _reserved: reserved, _memory: memory })
    }

    async fn store_files(&self, output: &JobOutput) -> Result<(), Stopped> {
        for file in &output.files {
            let written = SpoolFile::persistent(file.path.clone());
            self.deps.store.blobs.put(&file.key, written).await.map_err(internal)?;
        }
        Ok(())
    }

    /// Runs the job on a blocking thread, and converts a panic into a fault: a bug in one job must not kill the worker.
    async fn on_a_thread(&self, context: JobContext, keeper: Arc<LeaseKeeper>) -> Result<JobOutput, JobError> {
        let (runner, log) = (Arc::clone(&self.deps.runner), Span::current());
        match tokio::task::spawn_blocking(move || log.in_scope(|| runner.run(&context, &*keeper))).await {
            Ok(result) => result,
            Err(error) => {
                tracing::error!(%error, "a job panicked");
                let detail = "this job hit a bug of the service; its log has the details under the id of the job";
                Err(Fault::new(Code::Internal, detail).into())
            }
        }
    }

    /// The profile and the zips. A copy of a large zip takes long: a job that must stop does not wait for its end.
    async fn input_of(&self, job: &Job, keeper: &LeaseKeeper) -> Result<Input, Stopped> {
        if !self.deps.store.blobs.is_local() {
            keeper.report(Progress { stage: "reading".into(), ..Progress::default() });
        }
        let input = async {
            let own = (self.profile_of(job).await?, self.archive_of(job).await?);
            Ok::<_, Stopped>((own.0, own.1, self.others_of(job).await?))
        };
        tokio::select! {
            input = input => input,
            () = keeper.stopped() => Err(JobError::Cancelled(Cancelled).into()),
        }
    }

    async fn profile_of(&self, job: &Job) -> Result<Option<Profile>, Stopped> {
        let revision = match &job.request {
            JobRequest::Stack(request) => Some(request.profile_revision),
            JobRequest::Calibration(request) => request.options.from,
            JobRequest::Reconstruction(_) => None,
        };
        let Some(revision) = revision else { return Ok(None) };
        let (rig, lens) = (&job.rig, &job.lens);
        let found = self.deps.store.metadata.profile_of_job(rig, lens, revision).await.map_err(internal)?;
        let missing = || {
            Fault::new(
                Code::ProfileNotFound,
                format!(
                    "revision {revision} of the profile of rig '{rig}' and lens '{lens}' does not exist any more; store or \
                     calibrate the profile again, then send the stack again"
                ),
            )
        };
        Ok(Some(found.ok_or_else(missing)?))
    }

    /// The zip, of which an object store sends a copy. It can be read until it is closed, even if it is removed. Empty
    /// for a job that has none.
    async fn archive_of(&self, job: &Job) -> Result<Arc<dyn ReadAt>, Stopped> {
        let store = &self.deps.store;
        let Some(upload) = job.request.own_upload() else { return Ok(Arc::new(Vec::<u8>::new())) };
        let found = store.blobs.fetch(&upload.key, &store.workspace).await.map_err(internal)?;
        let missing = || Fault::new(Code::Internal, "the uploaded archive does not exist any more; send it again");
        Ok(Arc::new(found.ok_or_else(missing)?.open().await.map_err(internal)?))
    }

    /// The zips of the other stored stacks of a calibration.
    async fn others_of(&self, job: &Job) -> Result<Vec<File>, Stopped> {
        let store = &self.deps.store;
        let mut files = Vec::new();
        for stack in job.request.other_stacks() {
            let found = store.blobs.fetch(&upload_key(stack.id), &store.workspace).await.map_err(internal)?;
            let missing = || {
                let detail = format!(
                    "the pictures of the stack {} are not stored any more: since the calibration was accepted, the stack was \
                     deleted, or its zip removed at the end of its retention period; calibrate again without this stack",
                    stack.id
                );
                Fault::new(Code::UploadRemoved, detail)
            };
            files.push(found.ok_or_else(missing)?.open().await.map_err(internal)?);
        }
        Ok(files)
    }

    /// Time until the next claim of a job that failed with an error of the machine: 6 times longer after each attempt,
    /// and short when the disk became full, because the next attempt waits for disk space anyway.
    fn pause(&self, code: Code, attempt: u32) -> Duration {
        let pause = self.config.retry_pause.saturating_mul(6_u32.saturating_pow(attempt.saturating_sub(1)));
        if code == Code::InsufficientStorage { pause / 10 } else { pause }
    }

    /// Writes the end of the job, with retries: as long as the storage is away or full, and a few times after other
    /// errors. False when the lease was lost.
    async fn write_end(&self, job: &Job, ending: &Ending) -> StoreResult<bool> {
        let mut pause = Duration::from_millis(100);
        let mut attempts = 1;
        loop {
            match self.write_end_once(job, ending).await {
                Ok(true) => return Ok(true),
                Ok(false) => {
                    tracing::warn!(
                        "the job is not held any more: it ended already, was deleted, or another worker has it"
                    );
                    return Ok(false);
                }
                Err(error) if attempts >= END_ATTEMPTS && !is_away(&error) => return Err(error),
                // at shutdown, the lease expires
                Err(error) if self.abandon.is_cancelled() => return Err(error),
                Err(error) => {
                    tracing::warn!(?error, attempts, "cannot write the end of a job; trying again")
                }
            }
            tokio::time::sleep(pause).await;
            pause = (2 * pause).min(self.config.lease / END_PAUSES_PER_LEASE);
            attempts += 1;
        }
    }

    /// False when the lease was lost.
    async fn write_end_once(&self, job: &Job, ending: &Ending) -> StoreResult<bool> {
        step("worker.end").map_err(|error| StoreError::of_io(error, "cannot write the end of a job".into()))?;
        match ending {
            Ending::Finished(finish) => self.deps.store.metadata.finish(job.id, job.lease_token, finish).await,
            Ending::Released(attempt) => self.deps.store.metadata.release(job.id, job.lease_token, *attempt).await,
            Ending::Lost => Ok(false),
        }
    }
}

/// What a job holds while it runs, in the order in which it is released.
struct Admitted {
    _disk: Reservation,
    _gate: Option<OwnedMutexGuard<()>>,
    _reserved: events::Held,
    _memory: OwnedSemaphorePermit,
}

fn needs_more_memory(need: u64, limit: u64) -> Fault {
    let (need, limit) = (need.div_ceil(MB), limit / MB);
    let detail = format!(
        "the job needs {need} MiB of memory with one thread, but the machine or container of the worker has {limit} MiB for \
         jobs; give it more memory, or send slices with fewer pixels"
    );
    Fault::new(Code::InsufficientStorage, detail)
}

/// Whether the storage will take the end of a job later: it does not answer, or its disk is full.
fn is_away(error: &StoreError) -> bool {
    matches!(error, StoreError::Unavailable(_) | StoreError::DiskFull(_))
}
