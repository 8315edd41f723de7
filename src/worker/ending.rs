//! How the run of a job ended: what stopped it early, and what is written of its end.

use std::time::Duration;

use super::lease_keeper::StopReason;
use crate::{
    contract::{Code, Fault, JobError},
    store::{Attempt, Finish, StoreError},
    telemetry::events,
};

/// Why the run of a job ended early.
pub(super) enum Stopped {
    /// The job failed or was stopped.
    Job(JobError),
    /// The job would not fit on the empty disk or into the memory: another attempt would fail too.
    TooLarge(Fault),
    /// The storage is not available.
    Unavailable,
}

impl From<JobError> for Stopped {
    fn from(error: JobError) -> Self {
        Self::Job(error)
    }
}

impl From<Fault> for Stopped {
    fn from(fault: Fault) -> Self {
        Self::Job(fault.into())
    }
}

/// How the run of a job ended.
pub(super) enum Ending {
    /// The job ends.
    Finished(Finish),
    /// The job returns to the queue.
    Released(Attempt),
    /// Another worker has the job.
    Lost,
}

impl Ending {
    /// A job that succeeded or failed keeps that result even if it was stopped meanwhile: the store decides which was
    /// first.
    pub(super) fn of(
        result: Result<Finish, Stopped>,
        reason: Option<StopReason>,
        may_retry: bool,
        pause: impl FnOnce(Code) -> Duration,
    ) -> Self {
        use Stopped::{Job, TooLarge, Unavailable};
        match (result, reason) {
            (Ok(finish), _) => Self::Finished(finish),
            (Err(TooLarge(fault)), _) => Self::Finished(Finish::Failed(fault)),
            // the job is not the reason: every job needs the storage
            (Err(Unavailable), _) => Self::Released(Attempt::Postponed { pause: pause(Code::Unavailable) }),
            // not caused by the upload: another attempt may succeed
            (Err(Job(JobError::Failed(fault))), _) if fault.code.is_of_the_machine() && may_retry => {
                tracing::warn!(?fault, "a job failed with an error of the machine; it returns to the queue");
                Self::Released(Attempt::Counted { pause: pause(fault.code) })
            }
            (Err(Job(JobError::Failed(fault))), _) => Self::Finished(Finish::Failed(fault)),
            (Err(Job(JobError::Cancelled(_))), Some(StopReason::Lost)) => Self::Lost,
            (Err(Job(JobError::Cancelled(_))), Some(StopReason::ShuttingDown)) => Self::Released(Attempt::NotCounted),
            (Err(Job(JobError::Cancelled(_))), Some(StopReason::Cancelled)) => Self::Finished(Finish::Cancelled),
            (Err(Job(JobError::Cancelled(_))), None) => {
                let detail = "the job stopped without being asked to; this is a bug of the service";
                Self::Finished(Finish::Failed(Fault::new(Code::Internal, detail)))
            }
        }
    }

    /// Why a job failed.
    pub(super) fn fault(&self) -> Option<&Fault> {
        match self {
            Self::Finished(Finish::Failed(fault)) => Some(fault),
            _ => None,
        }
    }

    pub(super) fn event(&self) -> events::Ending {
        match self {
            Self::Finished(Finish::Succeeded { .. }) => events::Ending::Succeeded,
            Self::Finished(Finish::Failed(_)) => events::Ending::Failed,
            Self::Finished(Finish::Cancelled) => events::Ending::Cancelled,
            Self::Released(_) => events::Ending::Released,
            Self::Lost => events::Ending::Lost,
        }
    }

    pub(super) fn name(&self) -> &'static str {
        self.event().as_str()
    }
}

/// What an error of the store during a job means, and the error that clients see if it ends the job.
pub(super) fn internal(error: StoreError) -> Stopped {
    tracing::error!(?error, "the store failed during a job");
    let fault = match error {
        StoreError::Unavailable(_) => return Stopped::Unavailable,
        StoreError::DiskFull(_) => Fault::new(
            Code::InsufficientStorage,
            "the disk of the service is full, so the job could not go on; free disk space and send the zip again",
        ),
        StoreError::InvalidCursor | StoreError::Other(_) => {
            Fault::new(Code::Unavailable, "the service could not reach its own storage; its log has the details")
        }
    };
    fault.into()
}
