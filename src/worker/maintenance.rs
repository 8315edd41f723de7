//! Periodic garbage collection.

use std::time::Duration;

use tokio::task::JoinHandle;

use crate::{
    store::{
        Retention, Store,
        gc::{GRACE, collect},
    },
    telemetry::events,
};

/// Time between two collections.
pub const EVERY: Duration = Duration::from_secs(60 * 60);

/// The running task; it ends when this is dropped.
pub struct Maintenance(JoinHandle<()>);

impl Drop for Maintenance {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Collects garbage now, and again after each `every`.
pub fn start(store: Store, every: Duration, keep: Retention) -> Maintenance {
    Maintenance(tokio::spawn(async move {
        let mut clock = tokio::time::interval(every);
        clock.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        loop {
            clock.tick().await;
            match collect(&store, GRACE, &keep).await {
                Ok(collected) => {
                    events::gc_ended(true);
                    events::swept(collected.expired, collected.uploads, collected.given_up, collected.orphans);
                    tracing::info!(
                        expired = collected.expired,
                        uploads = collected.uploads,
                        orphans = collected.orphans,
                        given_up = collected.given_up,
                        "garbage collected"
                    );
                }
                Err(error) => {
                    events::gc_ended(false);
                    tracing::error!(?error, "garbage collection failed; the next one continues");
                }
            }
        }
    }))
}
