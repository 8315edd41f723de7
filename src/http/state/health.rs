//! The checks of `/readyz`: database, blob store, free disk space. They write a file, so their result is cached:
//! clients must not determine how often they run.

use std::{sync::Arc, time::Duration};

use super::recent::Recent;
use crate::{disk_budget::DiskBudget, store::Store};

/// How long the result of the checks is cached.
const MAX_AGE: Duration = Duration::from_secs(1);

/// The checks of one process, with their last result.
pub struct HealthChecks {
    store: Store,
    disk: Arc<DiskBudget>,
    last: Recent<Health>,
}

/// The result of the checks.
#[derive(Debug, Clone, Copy)]
pub struct Health {
    /// The database answers.
    pub database: bool,
    /// Files can be written and renamed.
    pub blobs: bool,
    /// More disk space is free than must stay free.
    pub has_room: bool,
    /// Free bytes; `None` when unknown.
    pub free_bytes: Option<u64>,
}

impl HealthChecks {
    /// Checks that have not run yet.
    pub fn new(store: &Store, disk: &Arc<DiskBudget>) -> Arc<Self> {
        Arc::new(Self { store: store.clone(), disk: Arc::clone(disk), last: Recent::new(MAX_AGE) })
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
            blobs: written.inspect_err(|error| tracing::error!(?error, "cannot store files")).is_ok(),
            has_room: disk.is_some_and(|disk| disk.available() > 0),
            free_bytes: disk.map(|disk| disk.free),
        }
    }
}
