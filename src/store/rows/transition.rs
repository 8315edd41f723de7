//! How a job ends: the values that its row gets.

use uuid::Uuid;

use super::signed;
use crate::{
    contract::{Code, Fault, JobKind, JobState, outcome::JobOutcome, profile::Profile},
    store::{Finish, StoreError, StoreResult, json, search},
};
use pinstack_science::types::Warning;

/// The final values of the row of a job.
#[derive(Default)]
pub(in crate::store) struct Transition<'a> {
    pub(in crate::store) state: &'static str,
    pub(in crate::store) error: Option<&'a Fault>,
    pub(in crate::store) warnings: Option<&'a [Warning]>,
    pub(in crate::store) outcome: Option<JobOutcome>,
}

impl<'a> Transition<'a> {
    /// The end of a job that was cancelled.
    pub(in crate::store) fn cancelled() -> Self {
        Self { state: "cancelled", ..Self::default() }
    }

    /// The end that a worker reports. A cancellation that was requested before wins. `profile` is the revision that was
    /// stored for a calibration.
    pub(in crate::store) fn of(finish: &'a Finish, cancel_requested: bool, profile: Option<&Profile>) -> Self {
        match finish {
            _ if cancel_requested => Self::cancelled(),
            Finish::Cancelled => Self::cancelled(),
            Finish::Failed(fault) => Self { state: "failed", error: Some(fault), ..Self::default() },
            Finish::Succeeded { outcome, warnings, .. } => {
                let mut outcome = (**outcome).clone();
                if let (Some(stored), JobOutcome::Calibration(calibration)) = (profile, &mut outcome) {
                    calibration.profile_revision = Some(stored.revision);
                    calibration.profile_digest = Some(stored.digest.clone());
                    calibration.profile_optics_digest = Some(stored.optics_digest.clone());
                }
                Self { state: "succeeded", warnings: Some(warnings), outcome: Some(outcome), ..Self::default() }
            }
        }
    }

    pub(in crate::store) fn error_json(&self) -> StoreResult<Option<String>> {
        self.error.map(|fault| json::stored::<Fault>("the error of a job", fault)).transpose()
    }

    pub(in crate::store) fn warnings_json(&self) -> StoreResult<Option<String>> {
        self.warnings.map(|all| json::stored::<Vec<Warning>>("the warnings of a job", all)).transpose()
    }

    pub(in crate::store) fn outcome_json(&self) -> StoreResult<Option<String>> {
        self.outcome.as_ref().map(|made| json::stored::<JobOutcome>("the result of a job", made)).transpose()
    }

    /// What the job is found by from now on; see [`search::ended`].
    pub(in crate::store) fn term(&self) -> Option<String> {
        match &self.outcome {
            Some(JobOutcome::Stack(_)) => {
                search::ended(JobKind::Stack, JobState::Succeeded, self.warnings.unwrap_or_default())
            }
            Some(JobOutcome::Calibration(_) | JobOutcome::Reconstruction(_)) => None,
            None => self.error.map(|_| search::FAILED.to_owned()),
        }
    }

    /// Bytes of the results.
    pub(in crate::store) fn result_bytes(&self) -> i64 {
        signed(self.outcome.as_ref().map_or(0, JobOutcome::bytes))
    }
}

/// The end of a job whose result cannot be stored (a number that is not finite).
pub(in crate::store) fn not_storable(id: Uuid, error: &StoreError) -> Finish {
    tracing::error!(job = %id, ?error, "the result of a job cannot be stored");
    let detail = "the result of this job contains a number that cannot be stored; this is a bug of the service; its \
                  log has the details under the id of the job";
    Finish::Failed(Fault::new(Code::Internal, detail))
}

/// The end of a job whose row cannot be read: no worker could ever do it.
pub(in crate::store) fn unreadable(id: Uuid, error: &StoreError) -> Finish {
    tracing::error!(job = %id, ?error, "the row of a job cannot be read");
    let detail = "the stored request of this job cannot be read any more; send the stack or target again; the log of the service \
                  has the details under the id of the job, and 'pinstack verify' finds other damage";
    Finish::Failed(Fault::new(Code::Internal, detail))
}

/// The error of a job that lost its worker `attempts` times, as JSON.
pub(in crate::store) fn worker_lost(attempts: u32) -> StoreResult<String> {
    let detail = format!(
        "the worker died during attempt {attempts}, the last one, so the job is not retried; the usual reason is a stack \
         that needs too much memory: send fewer or smaller slices, or add memory; the log of the service has more"
    );
    json::stored::<Fault>("the error of a job", &Fault::new(Code::WorkerLost, detail))
}
