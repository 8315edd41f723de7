//! Room on the disk for running jobs: one that would fill it waits, and its upload with it, until somebody made room.

use crate::contract::JobError;
use tokio::time::sleep;

use super::{
    attend::{Shared, internal},
    lifeline::Lifeline,
};
use crate::{
    contract::{Code, Fault, Progress},
    disk_budget::{DiskState, Reservation},
    jobs::ProgressSink,
    store::Job,
};
use pinstack_science::types::Cancelled;

/// What clients see of a job that waits here.
const STAGE: &str = "waiting for room on the disk";

impl Shared {
    /// Waits until what the job may write fits into the disk budget. The job holds the whole reservation until it ends:
    /// what it has written is counted twice, so that another job or an upload waits rather than that this one fails.
    ///
    /// # Errors
    /// When the job is told to stop meanwhile. The inner error: it could not fit if the disk were empty.
    pub(super) async fn room_for(&self, job: &Job, line: &Lifeline) -> Result<Result<Reservation, Fault>, JobError> {
        let bytes = self.deps.runner.disk_need(&job.request);
        let mut waits = false;
        loop {
            let state = match self.deps.disk.reserve(bytes).await.map_err(internal)? {
                Ok(reservation) => return Ok(Ok(reservation)),
                Err(state) => state,
            };
            if bytes.saturating_add(state.min_free) > state.total {
                return Ok(Err(never_fits(bytes, &state)));
            }
            if !waits {
                tracing::warn!(job = %job.id, needs = bytes, ?state, "a job waits for room on the disk");
                line.report(Progress { stage: STAGE.into(), ..Progress::default() });
                waits = true;
            }
            tokio::select! {
                () = sleep(self.config.poll) => {}
                () = line.stopped() => return Err(JobError::Cancelled(Cancelled)),
            }
        }
    }
}

fn never_fits(bytes: u64, state: &DiskState) -> Fault {
    let DiskState { total, min_free, .. } = state;
    let detail = format!(
        "the job may write {bytes} bytes and {min_free} must stay free, but the disk has only {total} in all; move the \
         data folder to a larger disk, or send fewer or smaller slices"
    );
    Fault::new(Code::InsufficientStorage, detail)
}
