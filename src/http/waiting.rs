//! Requests that wait for a job. A change made by this process wakes them at once, a change made by another process is
//! seen at the next poll.

use std::time::Duration;

use tokio::{
    sync::broadcast::{Receiver, error::RecvError},
    time::{Instant, sleep_until},
};
use uuid::Uuid;

use crate::{
    http::{state::App, wait_times},
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
        let is_over = job.as_ref().is_none_or(|job| job.state.is_final());
        if is_over || Instant::now() >= deadline || app.shutdown.is_cancelled() {
            return Ok(job);
        }
        tokio::select! {
            () = changed(&mut changes, id, app.policy.poll_interval) => {}
            () = sleep_until(deadline) => {}
            () = app.shutdown.cancelled() => {}
        }
    }
}

/// Returns when the job may have changed: this process reported a change of it, or the poll interval has passed.
pub async fn changed(changes: &mut Receiver<Uuid>, id: Uuid, poll_interval: Duration) {
    let next_poll = Instant::now() + poll_interval;
    loop {
        tokio::select! {
            change = changes.recv() => match change {
                Ok(changed) if changed == id => return,
                Ok(_) => {}
                // some reports were missed, perhaps one of this job
                Err(RecvError::Lagged(_)) => return,
                Err(RecvError::Closed) => return sleep_until(next_poll).await,
            },
            () = sleep_until(next_poll) => return,
        }
    }
}
