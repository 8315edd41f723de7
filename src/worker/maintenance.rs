//! The clean-up that runs beside the workers.

use std::{sync::Arc, time::Duration};

use tokio::task::JoinHandle;

use crate::{
    store::{
        Rows,
        blobs::Blobs,
        sweep::{GRACE, Retention, sweep},
    },
    telemetry::events,
};

/// Time between two sweeps.
pub const EVERY: Duration = Duration::from_secs(60 * 60);

/// A running clean-up; it ends when this is dropped.
pub struct Maintenance(JoinHandle<()>);

impl Drop for Maintenance {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Sweeps now and then again after each `every`.
pub fn start(rows: Arc<dyn Rows>, blobs: Arc<dyn Blobs>, every: Duration, keep: Retention) -> Maintenance {
    Maintenance(tokio::spawn(async move {
        let mut clock = tokio::time::interval(every);
        clock.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            clock.tick().await;
            match sweep(&*rows, &*blobs, GRACE, &keep).await {
                Ok(swept) => {
                    events::sweep_ended(true);
                    events::swept(swept.expired, swept.uploads, swept.given_up, swept.orphans);
                    tracing::info!(
                        expired = swept.expired,
                        uploads = swept.uploads,
                        orphans = swept.orphans,
                        given_up = swept.given_up,
                        "swept"
                    );
                }
                Err(error) => {
                    events::sweep_ended(false);
                    tracing::error!(?error, "the sweep failed; the next one goes on");
                }
            }
        }
    }))
}
