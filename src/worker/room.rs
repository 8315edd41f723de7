//! Room on the disk for running jobs: one that would fill it waits, and its upload with it, until somebody made room.

use std::sync::atomic::{AtomicU64, Ordering};

use tokio::time::sleep;

use super::{
    attend::{Shared, internal},
    lifeline::Lifeline,
};
use crate::{
    jobs::Watcher,
    model::{Cancelled, Code, Fault, Progress, Stop},
    store::Job,
};

/// What clients see of a job that waits here.
const STAGE: &str = "waiting for room on the disk";

/// What running jobs of this process may still write, bytes. What they have written already is counted twice, as gone and
/// as promised: a job waits rather than that one fails.
#[derive(Debug, Default)]
pub(super) struct Disk(AtomicU64);

impl Disk {
    /// Promises `bytes` when they fit beside what was promised before.
    fn promise(&self, bytes: u64, free: u64) -> Option<Room<'_>> {
        let fits = |promised: u64| promised.checked_add(bytes).filter(|&all| all <= free);
        self.0.fetch_update(Ordering::AcqRel, Ordering::Acquire, fits).ok().map(|_| Room { disk: self, bytes })
    }
}

/// Room that a job counts on until this is dropped.
pub(super) struct Room<'a> {
    disk: &'a Disk,
    bytes: u64,
}

impl Drop for Room<'_> {
    fn drop(&mut self) {
        self.disk.0.fetch_sub(self.bytes, Ordering::AcqRel);
    }
}

impl Shared {
    /// Waits until what the job may write fits on the disk beside what others may and what must stay free.
    ///
    /// # Errors
    /// When the job is told to stop meanwhile, or could not fit if the disk were empty.
    pub(super) async fn room_for(&self, job: &Job, line: &Lifeline) -> Result<Room<'_>, Stop> {
        let (bytes, reserve) = (self.deps.work.disk_need(&job.request), self.config.min_free_bytes);
        let mut waits = false;
        loop {
            let room = self.deps.blobs.room().await.map_err(internal)?;
            if bytes.saturating_add(reserve) > room.total {
                return Err(never_fits(bytes, reserve, room.total).into());
            }
            if let Some(promise) = self.disk.promise(bytes, room.free.saturating_sub(reserve)) {
                return Ok(promise);
            }
            if !waits {
                tracing::warn!(job = %job.id, needs = bytes, free = room.free, "a job waits for room on the disk");
                line.report(Progress { stage: STAGE.into(), ..Progress::default() });
                waits = true;
            }
            tokio::select! {
                () = sleep(self.config.poll) => {}
                () = line.stopped() => return Err(Stop::Cancelled(Cancelled)),
            }
        }
    }
}

fn never_fits(bytes: u64, reserve: u64, total: u64) -> Fault {
    let detail = format!(
        "the job may write {bytes} bytes and {reserve} must stay free, but the disk has only {total} in all; move the data \
         folder to a larger disk, or send fewer or smaller slices"
    );
    Fault::new(Code::InsufficientStorage, detail)
}
