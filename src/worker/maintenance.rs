//! The clean-up that runs beside the workers.

use std::{sync::Arc, time::Duration};

use tokio::task::JoinHandle;

use crate::{
    store::{
        MetadataStore, Retention,
        blobs::Blobs,
        gc::{GRACE, collect},
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
pub fn start(rows: Arc<dyn MetadataStore>, blobs: Arc<dyn Blobs>, every: Duration, keep: Retention) -> Maintenance {
    Maintenance(tokio::spawn(async move {
        let mut clock = tokio::time::interval(every);
        clock.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            clock.tick().await;
            match collect(&*rows, &*blobs, GRACE, &keep).await {
                Ok(collected) => {
                    events::sweep_ended(true);
                    events::swept(collected.expired, collected.uploads, collected.given_up, collected.orphans);
                    tracing::info!(
                        expired = collected.expired,
                        uploads = collected.uploads,
                        orphans = collected.orphans,
                        given_up = collected.given_up,
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
