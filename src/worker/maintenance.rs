//! Periodic garbage collection.

use std::time::Duration;

use tokio::{task::JoinHandle, time::timeout};

use crate::{
    store::{
        Retention, Store, StoreError,
        gc::{GRACE, Removed, collect},
    },
    supervision::supervised,
    telemetry::events,
};

/// Time between two collections.
pub const EVERY: Duration = Duration::from_secs(60 * 60);

/// Time until the next collection after one that failed: what was in its way is over then, or is not.
const AFTER_FAILURE: Duration = Duration::from_secs(30);

/// The running task; it ends when this is dropped.
pub struct Maintenance(JoinHandle<()>);

impl Drop for Maintenance {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Collects garbage now, and again after each `every`; sooner after a collection that failed.
pub fn start(store: Store, every: Duration, keep: Retention) -> Maintenance {
    Maintenance(tokio::spawn(supervised("garbage collection", move || {
        let store = store.clone();
        async move {
            loop {
                let pause = if collect_once(&store, &keep).await { every } else { every.min(AFTER_FAILURE) };
                tokio::time::sleep(pause).await;
            }
        }
    })))
}

/// False when the collection failed.
async fn collect_once(store: &Store, keep: &Retention) -> bool {
    // a database on another machine may never answer
    let collected = timeout(EVERY, collect(store, GRACE, keep)).await.unwrap_or_else(|elapsed| {
        Err(StoreError::Unavailable(anyhow::Error::new(elapsed).context("the garbage collection did not end")))
    });
    events::gc_ended(collected.is_ok());
    match &collected {
        Ok(Removed { expired, uploads, given_up, orphans }) => {
            events::swept(*expired, *uploads, *given_up, *orphans);
            tracing::info!(expired, uploads, orphans, given_up, "garbage collected");
        }
        Err(error) => tracing::error!(?error, "garbage collection failed; the next one continues"),
    }
    collected.is_ok()
}
