//! One job from its claim to its end.

use std::{path::PathBuf, sync::Arc, time::Duration, time::Instant};

use tokio::sync::{OwnedMutexGuard, Semaphore};
use tokio_util::sync::CancellationToken;
use tracing::field;

use super::{
    Config, Deps,
    lifeline::{Lifeline, Why},
};
use crate::contract::JobError;
use crate::{
    contract::{Code, Fault, one_line, profile::Profile, request::JobRequest},
    jobs::{JobContext, JobOutput},
    store::{Attempt, Finish, Job, StoreError, StoreResult, failpoint::step, gc::gc_job},
    telemetry::events,
};

/// Unit of the memory budget.
pub(super) const MB: u64 = 1 << 20;
/// Tries to write the end of a job; when all fail, the lease runs out and the job is done again.
const END_TRIES: u32 = 5;

/// What all workers of a pool share.
pub(super) struct Shared {
    pub(super) deps: Deps,
    pub(super) config: Config,
    /// In megabytes.
    pub(super) memory: Arc<Semaphore>,
    /// Tells running jobs to go back to the queue.
    pub(super) abandon: CancellationToken,
}

impl Shared {
    /// Permits that make up the whole memory budget.
    pub(super) fn whole_budget(&self) -> u32 {
        u32::try_from(self.config.memory_budget.div_ceil(MB))
            .unwrap_or(u32::MAX)
            .clamp(1, Semaphore::MAX_PERMITS as u32)
    }

    /// Does a claimed job. `gate` keeps other workers from claiming: it opens once this job has its memory, or, when a
    /// worker died on this job before, not until it has ended. So a job that takes the process down takes no
    /// innocent ones with it that would pay with their attempts.
    pub(super) async fn attend(&self, job: Job, gate: OwnedMutexGuard<()>) {
        let started = Instant::now();
        let _busy = events::busy();
        let line = Arc::new(Lifeline::starting_at(job.progress.clone()));
        // if this worker is dropped, the thread of the job shall see it
        let _stop = line.stop_on_drop();
        let result = tokio::select! {
            result = self.work(&job, &line, gate) => result,
            () = line.beat(&self.deps, &self.config, &job, &self.abandon) => Err(JobError::Cancelled(pinstack_science::types::Cancelled)),
        };
        let kind = job.request.kind();
        let may_try_again = job.attempt < self.config.max_attempts;
        let ending = Ending::of(result, line.why(), may_try_again, |code| self.pause(code, job.attempt));
        let (code, detail) = ending.fault().map(|fault| (fault.code.name(), one_line(&fault.detail))).unzip();
        let (rig, lens) = (&job.rig, &job.lens);
        tracing::info!(
            job = %job.id, ?kind, %rig, %lens, attempt = job.attempt, ending = ending.name(),
            code = code.map(field::display), detail, "job leaves its worker"
        );
        events::left(kind, ending.event(), started.elapsed());
        for (stage, time) in line.stage_times() {
            events::stage_done(kind, stage, time);
        }
        match self.write_end(&job, &ending).await {
            Ok(true) => {
                if let Ending::Finished(Finish::Failed(fault)) = &ending {
                    events::failed(kind, fault.code);
                }
            }
            Ok(false) => events::lease_lost(kind),
            Err(error) => {
                tracing::error!(job = %job.id, ?error, "the end of a job cannot be written; it will be done again");
            }
        }
        if let Err(error) = gc_job(&*self.deps.rows, &*self.deps.blobs, job.id).await {
            tracing::warn!(job = %job.id, ?error, "what a job left cannot be removed now; the next sweep will");
        }
    }

    async fn work(&self, job: &Job, line: &Arc<Lifeline>, gate: OwnedMutexGuard<()>) -> Result<Finish, JobError> {
        let started = Instant::now();
        let suspect = job.attempt > 1;
        let whole = self.whole_budget();
        let need = u32::try_from(self.deps.runner.memory_need(&job.request).div_ceil(MB)).unwrap_or(u32::MAX);
        let permits = if suspect { whole } else { need.min(whole) };
        let _memory = tokio::select! {
            permit = Arc::clone(&self.memory).acquire_many_owned(permits) => permit.map_err(|_| Fault::new(Code::Unavailable, "the service is going down"))?,
            () = line.stopped() => return Err(JobError::Cancelled(pinstack_science::types::Cancelled)),
        };
        let _reserved = events::memory_reserved(u64::from(permits) * MB);
        let _gate = suspect.then_some(gate);
        let _room = match self.room_for(job, line).await? {
            Ok(reservation) => reservation,
            Err(fault) => return Ok(Finish::Failed(fault)),
        };

        let profile = self.profile_of(job).await.map_err(internal)??;
        let archive = self.archive_of(job).await.map_err(internal)??;
        step("scratch.make")
            .map_err(|error| internal(StoreError::of_io(error, "cannot make a scratch folder".into())))?;
        let scratch = tempfile::Builder::new()
            .prefix("job-")
            .tempdir_in(self.deps.blobs.spool_dir())
            .map_err(|error| internal(StoreError::of_io(error, "cannot make a scratch folder".into())))?;
        let context = JobContext { job: job.clone(), profile, archive, scratch: scratch.path().to_owned(), started };
        let output = self.on_a_thread(context, Arc::clone(line)).await?;
        for file in &output.files {
            self.deps.blobs.publish(&file.path, &file.key).await.map_err(internal)?;
        }
        let mut warnings = job.warnings.clone();
        warnings.extend(output.warnings.into_iter().filter(|warning| !job.warnings.contains(warning)));
        Ok(Finish::Succeeded { outcome: Box::new(output.outcome), warnings, profile: output.profile })
    }

    /// Runs the job where it may block, and turns a panic into a fault: a bug in one job is no reason for a worker to die.
    async fn on_a_thread(&self, context: JobContext, line: Arc<Lifeline>) -> Result<JobOutput, JobError> {
        let (runner, id) = (Arc::clone(&self.deps.runner), context.job.id);
        match tokio::task::spawn_blocking(move || runner.run(&context, &*line)).await {
            Ok(result) => result,
            Err(error) => {
                tracing::error!(job = %id, %error, "a job panicked");
                let detail = "the service hit a bug of its own on this job; its log has the details under the job's id";
                Err(Fault::new(Code::Internal, detail).into())
            }
        }
    }

    async fn profile_of(&self, job: &Job) -> StoreResult<Result<Option<Profile>, Fault>> {
        let JobRequest::Stack(request) = &job.request else { return Ok(Ok(None)) };
        let found = self.deps.rows.profile_of_job(&job.rig, &job.lens, request.profile_revision).await?;
        let missing = || {
            let (rig, lens, revision) = (&job.rig, &job.lens, request.profile_revision);
            Fault::new(
                Code::ProfileNotFound,
                format!("revision {revision} of profile {rig}/{lens} is not there any more"),
            )
        };
        Ok(found.map(Some).ok_or_else(missing))
    }

    async fn archive_of(&self, job: &Job) -> StoreResult<Result<PathBuf, Fault>> {
        let found = self.deps.blobs.local_path(&job.request.upload().key).await?;
        Ok(found.ok_or_else(|| Fault::new(Code::Internal, "the uploaded archive is not there any more; send it again")))
    }

    /// Time before the next claim of a job that met an error of the machine: 6 times longer after each attempt. Short
    /// when the disk became full: the next attempt waits for its room anyway.
    fn pause(&self, code: Code, attempt: u32) -> Duration {
        let pause = self.config.retry_pause.saturating_mul(6_u32.saturating_pow(attempt.saturating_sub(1)));
        if code == Code::InsufficientStorage { pause / 10 } else { pause }
    }

    /// Writes the end, again when the database cannot be reached for a moment. False when the lease was lost.
    async fn write_end(&self, job: &Job, ending: &Ending) -> StoreResult<bool> {
        let mut pause = Duration::from_millis(100);
        let mut tries = 1;
        loop {
            match self.write_end_once(job, ending).await {
                Ok(true) => return Ok(true),
                Ok(false) => {
                    tracing::warn!(job = %job.id, "the lease was lost before the end; nothing was published");
                    return Ok(false);
                }
                Err(error) if tries == END_TRIES => return Err(error),
                Err(error) => tracing::warn!(job = %job.id, ?error, tries, "cannot write the end of a job yet"),
            }
            tokio::time::sleep(pause).await;
            pause *= 2;
            tries += 1;
        }
    }

    /// True when it was this worker's to write.
    async fn write_end_once(&self, job: &Job, ending: &Ending) -> StoreResult<bool> {
        step("worker.end").map_err(|error| StoreError::of_io(error, "cannot write the end of a job".into()))?;
        match ending {
            Ending::Finished(finish) => self.deps.rows.finish(job.id, job.lease_token, finish).await,
            Ending::Released(attempt) => self.deps.rows.release(job.id, job.lease_token, *attempt).await,
            Ending::Lost => Ok(false),
        }
    }
}

/// What becomes of a job that left its worker.
enum Ending {
    Finished(Finish),
    Released(Attempt),
    Lost,
}

impl Ending {
    /// A job that was done or failed by itself ends so, even if it was told to stop meanwhile: the store decides who
    /// was first.
    fn of(
        result: Result<Finish, JobError>,
        why: Option<Why>,
        may_try_again: bool,
        pause: impl FnOnce(Code) -> Duration,
    ) -> Self {
        match (result, why) {
            (Ok(finish), _) => Self::Finished(finish),
            // not the fault of the upload: another attempt may succeed
            (Err(JobError::Failed(fault)), _) if fault.code.is_of_the_machine() && may_try_again => {
                tracing::warn!(?fault, "an error of the machine under a job; it goes back to the queue");
                Self::Released(Attempt::Counted { pause: pause(fault.code) })
            }
            (Err(JobError::Failed(fault)), _) => Self::Finished(Finish::Failed(fault)),
            (Err(JobError::Cancelled(_)), Some(Why::Lost)) => Self::Lost,
            (Err(JobError::Cancelled(_)), Some(Why::ShuttingDown)) => Self::Released(Attempt::NotCounted),
            (Err(JobError::Cancelled(_)), Some(Why::Cancelled)) => Self::Finished(Finish::Cancelled),
            (Err(JobError::Cancelled(_)), None) => {
                let detail = "the job stopped although nobody asked it to; this is a bug of the service";
                Self::Finished(Finish::Failed(Fault::new(Code::Internal, detail)))
            }
        }
    }

    /// Why a job failed.
    fn fault(&self) -> Option<&Fault> {
        match self {
            Self::Finished(Finish::Failed(fault)) => Some(fault),
            _ => None,
        }
    }

    fn event(&self) -> events::Ending {
        match self {
            Self::Finished(Finish::Succeeded { .. }) => events::Ending::Succeeded,
            Self::Finished(Finish::Failed(_)) => events::Ending::Failed,
            Self::Finished(Finish::Cancelled) => events::Ending::Cancelled,
            Self::Released(_) => events::Ending::Released,
            Self::Lost => events::Ending::Lost,
        }
    }

    fn name(&self) -> &'static str {
        self.event().as_str()
    }
}

/// What a client is told when rows or blobs fail under a job.
pub(super) fn internal(error: StoreError) -> JobError {
    tracing::error!(?error, "the store failed under a job");
    let fault = match error {
        StoreError::DiskFull(_) => Fault::new(
            Code::InsufficientStorage,
            "the disk of the service is full, so the results could not be stored; make room and send the stack again",
        ),
        StoreError::InvalidCursor | StoreError::Other(_) => {
            Fault::new(Code::Unavailable, "the service could not reach its own storage; its log has the details")
        }
    };
    fault.into()
}
