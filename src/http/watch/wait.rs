//! Waiting for the end of a job.

use std::time::Duration;

use tokio::{
    sync::broadcast::{Receiver, error::RecvError},
    time::{Instant, sleep_until},
};
use uuid::Uuid;

use crate::{
    http::{state::App, waiting},
    store::{Job, StoreResult},
    telemetry::events::WaitsOn,
};

/// Waits until the job has ended, at most `patience`, less when the server goes down; then its last row.
/// `None` when it was deleted meanwhile.
///
/// # Errors
/// When the rows cannot be read.
pub async fn until_final(app: &App, id: Uuid, patience: Duration) -> StoreResult<Option<Job>> {
    let started = Instant::now();
    let job = final_row(app, id, started + patience).await;
    waiting::add(WaitsOn::Job, started.elapsed());
    job
}

async fn final_row(app: &App, id: Uuid, deadline: Instant) -> StoreResult<Option<Job>> {
    let mut changes = app.rows.changes();
    loop {
        let job = app.rows.job(id).await?;
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

/// Returns when the job may have changed: this process said so, or it is time to look.
pub async fn changed(changes: &mut Receiver<Uuid>, id: Uuid, poll_interval: Duration) {
    let next_look = Instant::now() + poll_interval;
    loop {
        tokio::select! {
            change = changes.recv() => match change {
                Ok(changed) if changed == id => return,
                Ok(_) => {}
                // some were missed, this one perhaps
                Err(RecvError::Lagged(_)) => return,
                Err(RecvError::Closed) => return sleep_until(next_look).await,
            },
            () = sleep_until(next_look) => return,
        }
    }
}
