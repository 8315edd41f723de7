//! The checks of `/readyz`: database, blob store, free disk space, workers. They write a row and a file, so their
//! result is cached: clients must not determine how often they run.

use std::{
    sync::{
        Arc, OnceLock,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use super::recent::Recent;
use crate::{disk_budget::DiskBudget, store::Store};

/// How long the result of the checks is cached.
const MAX_AGE: Duration = Duration::from_secs(1);

/// The checks of one process, with their last result.
pub struct HealthChecks {
    store: Store,
    disk: Arc<DiskBudget>,
    last: Recent<Health>,
    /// The number of workers that are alive, in a process that has workers.
    workers: OnceLock<Arc<AtomicUsize>>,
}

/// The result of the checks.
#[derive(Debug, Clone, Copy)]
pub struct Health {
    /// The database answers, and rows can be written.
    pub database: bool,
    /// Files can be written and renamed.
    pub blobs: bool,
    /// A worker is alive, or this process has none.
    pub workers: bool,
    /// More disk space is free than must stay free.
    pub has_room: bool,
    /// Free bytes; `None` when unknown.
    pub free_bytes: Option<u64>,
}

impl HealthChecks {
    /// Checks that have not run yet.
    pub fn new(store: &Store, disk: &Arc<DiskBudget>) -> Arc<Self> {
        let workers = OnceLock::new();
        Arc::new(Self { store: store.clone(), disk: Arc::clone(disk), last: Recent::new(MAX_AGE), workers })
    }

    /// From now on the number of workers that are alive is checked too.
    pub fn watch_workers(&self, alive: Arc<AtomicUsize>) {
        let _ = self.workers.set(alive);
    }

    /// The last result, at most [`MAX_AGE`] old.
    pub async fn last(&self) -> Health {
        self.last.get(async || self.run().await).await
    }

    async fn run(&self) -> Health {
        let disk = self.disk.state().await.ok();
        let database = self.store.metadata.healthy().await;
        let written = self.store.blobs.probe().await;
        Health {
            database,
            workers: self.workers.get().is_none_or(|alive| alive.load(Ordering::Relaxed) > 0),
            blobs: written.inspect_err(|error| tracing::error!(?error, "cannot store files")).is_ok(),
            has_room: disk.is_some_and(|disk| disk.available() > 0),
            free_bytes: disk.map(|disk| disk.free),
        }
    }
}
