//! Requests that wait for the end of a job.

use std::time::Duration;

use tokio::time::{Instant, sleep_until};
use uuid::Uuid;

use crate::{
    http::{App, wait_times},
    store::{Job, StoreResult},
    telemetry::events::WaitsOn,
};

/// Waits until the job has ended, for `longest` at most and not beyond the shutdown of the server. Returns the job as
/// it is then; `None` when it was deleted meanwhile.
///
/// # Errors
/// When the store cannot be read.
pub async fn until_final(app: &App, id: Uuid, longest: Duration) -> StoreResult<Option<Job>> {
    let started = Instant::now();
    let job = final_row(app, id, started + longest).await;
    wait_times::add(WaitsOn::Job, started.elapsed());
    job
}

async fn final_row(app: &App, id: Uuid, deadline: Instant) -> StoreResult<Option<Job>> {
    let mut changes = app.store.metadata.changes();
    loop {
        let job = app.store.metadata.job(id).await?;
        let Some(waiting) = job.as_ref().filter(|job| !job.state.is_final()) else { return Ok(job) };
        if Instant::now() >= deadline || app.shutdown.is_cancelled() {
            return Ok(job);
        }
        tokio::select! {
            () = app.watch.changed(&mut changes, id, waiting.version) => {}
            () = sleep_until(deadline) => {}
            () = app.shutdown.cancelled() => {}
        }
    }
}
