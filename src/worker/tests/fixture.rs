//! A store, scripted jobs, and what a test needs to observe workers.

use std::{
    sync::{Arc, Mutex, mpsc},
    time::Duration,
};

use tempfile::TempDir;
use tokio::sync::mpsc as async_mpsc;
use uuid::Uuid;

use super::scripted::{Order, ScriptedRunner};
use crate::{
    contract::request::JobRequest,
    disk_budget::DiskBudget,
    store::{
        Job, ManualClock, NewJob,
        blobs::{result_key, upload_key},
        conformance::{self, LEASE, accept, blobs::put_blob},
        open_with_clock,
    },
    worker::{Config, Deps},
};

/// A store, its clock, and the channels to the scripted jobs.
pub(super) struct Stage {
    pub folder: TempDir,
    pub clock: Arc<ManualClock>,
    pub deps: Deps,
    pub began: async_mpsc::UnboundedReceiver<Uuid>,
    pub orders: mpsc::Sender<Order>,
}

/// Frequent heartbeats, so that tests need not wait for them.
pub(super) fn config(workers: usize) -> Config {
    let often = Duration::from_millis(5);
    Config {
        workers,
        lease: LEASE,
        beat: often,
        progress_gap: often,
        poll: often,
        retry_pause: Duration::ZERO,
        ..Config::default()
    }
}

pub(super) async fn stage_with_need(need: u64) -> Stage {
    stage_with_needs(need, 0).await
}

pub(super) async fn stage_with_needs(need: u64, disk_need: u64) -> Stage {
    let folder = tempfile::tempdir().unwrap();
    let clock = Arc::new(ManualClock::default());
    let store = open_with_clock(folder.path(), clock.clone()).await.unwrap();
    let (began_here, began) = async_mpsc::unbounded_channel();
    let (orders, received) = mpsc::channel();
    let runner = ScriptedRunner { began: began_here, orders: Mutex::new(received), need, disk_need };
    let disk = DiskBudget::new(&store, 0);
    let deps = Deps { store, disk, runner: Arc::new(runner) };
    conformance::put(&*deps.store.metadata, "rig", "lens", 1.5).await;
    Stage { folder, clock, deps, began, orders }
}

pub(super) async fn stage() -> Stage {
    stage_with_need(1).await
}

impl Stage {
    pub(super) async fn accept(&self) -> Uuid {
        let mut job: NewJob = conformance::stack();
        let key = upload_key(job.id);
        if let JobRequest::Stack(request) = &mut job.request {
            request.upload.key = key.clone();
        }
        put_blob(&self.deps.store, &key, b"the archive").await;
        accept(&*self.deps.store.metadata, &job).await.id
    }

    pub(super) fn order(&self, order: Order) {
        self.orders.send(order).expect("the jobs listen");
    }

    /// Waits until the condition holds for the row.
    pub(super) async fn until(&self, id: Uuid, holds: impl Fn(&Job) -> bool) -> Job {
        let mut changes = self.deps.store.metadata.changes();
        loop {
            let job = conformance::job(&*self.deps.store.metadata, id).await;
            if holds(&job) {
                return job;
            }
            let _ = tokio::time::timeout(Duration::from_secs(1), changes.recv()).await;
        }
    }

    pub(super) async fn ended(&self, id: Uuid) -> Job {
        self.until(id, |job| job.state.is_final()).await
    }

    pub(super) async fn results_of(&self, job: &Job) -> Option<Vec<u8>> {
        let key = result_key(job.id, job.lease_token, "image.png");
        conformance::blobs::bytes_of_blob(&self.deps.store, &key).await
    }

    /// Number of scratch folders in the workspace.
    pub(super) fn scratch_folders(&self) -> usize {
        std::fs::read_dir(self.deps.store.workspace.path()).unwrap().count()
    }
}
