//! Admission of jobs to the disk: a job starts when everything that it may write is reserved. Until then it waits; its
//! upload is kept.

use tokio::time::sleep;

use super::{
    ending::{Stopped, internal},
    executor::Executor,
    lease_keeper::LeaseKeeper,
};
use crate::{
    contract::{Code, Fault, JobError, Progress},
    disk_budget::{DiskState, Reservation, Reserved},
    jobs::ProgressSink,
    store::Job,
};
use pinstack_science::types::Cancelled;

/// Stage of a job that waits for disk space, as clients see it.
const STAGE: &str = "waiting for disk space";

impl Executor {
    /// Waits until what the job may write fits into the disk budget. The job holds the whole reservation until it ends:
    /// what it has written is counted twice, so that another job or an upload waits rather than that this job fails.
    ///
    /// # Errors
    /// When the job must stop meanwhile, or would not fit if the disk were empty.
    pub(super) async fn reserve_disk(&self, job: &Job, keeper: &LeaseKeeper) -> Result<Reservation, Stopped> {
        let store = &self.deps.store;
        // zips that are not on this machine are copied to it
        let others = job.request.other_stacks().iter().map(|stack| stack.bytes);
        let copy =
            if store.blobs.is_local() { 0 } else { others.fold(job.request.upload().bytes, u64::saturating_add) };
        let bytes = self.deps.runner.disk_need(&job.request).saturating_add(copy);
        let mut waits = false;
        loop {
            let state = match self.deps.disk.reserve(bytes).await.map_err(internal)? {
                Reserved::Granted(reservation) => return Ok(reservation),
                Reserved::Full(state) => state,
            };
            if bytes.saturating_add(state.min_free) > state.total {
                return Err(Stopped::TooLarge(never_fits(bytes, &state)));
            }
            if !waits {
                tracing::warn!(needs = bytes, ?state, "a job waits for disk space");
                keeper.report(Progress { stage: STAGE.into(), ..Progress::default() });
                waits = true;
            }
            tokio::select! {
                () = sleep(self.config.poll) => {}
                () = keeper.stopped() => return Err(JobError::Cancelled(Cancelled).into()),
            }
        }
    }
}

fn never_fits(bytes: u64, state: &DiskState) -> Fault {
    let DiskState { total, min_free, .. } = state;
    let detail = format!(
        "the job may write {bytes} bytes and {min_free} must stay free, but the size of the disk is {total}; move the data \
         folder to a larger disk, or send fewer or smaller slices"
    );
    Fault::new(Code::InsufficientStorage, detail)
}
