//! A store on which workers act, and what a test needs to watch them.

use std::{
    sync::{Arc, Mutex, mpsc},
    time::Duration,
};

use tempfile::TempDir;
use tokio::sync::mpsc as async_mpsc;
use uuid::Uuid;

use super::puppet::{Order, Puppet};
use crate::{
    contract::request::JobRequest,
    disk_budget::DiskBudget,
    store::{
        Job, ManualClock, NewJob,
        blobs::{local::LocalBlobs, result_key, upload_key},
        conformance::{self, LEASE, accept},
        sqlite::SqliteMetadata,
    },
    worker::{Config, Deps},
};

/// A store, its clock, and the strings of the puppets.
pub(super) struct Stage {
    pub folder: TempDir,
    pub clock: Arc<ManualClock>,
    pub deps: Deps,
    pub began: async_mpsc::UnboundedReceiver<Uuid>,
    pub orders: mpsc::Sender<Order>,
}

/// Beats often, so that what a beat must see is seen soon.
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
    let rows = SqliteMetadata::open_with_clock(folder.path().join("rows.db"), clock.clone()).await.unwrap();
    let blobs = LocalBlobs::open(folder.path()).unwrap();
    let (began_here, began) = async_mpsc::unbounded_channel();
    let (orders, to_puppet) = mpsc::channel();
    let runner = Puppet { began: began_here, orders: Mutex::new(to_puppet), need, disk_need };
    let blobs = Arc::new(blobs);
    let disk = DiskBudget::new(blobs.clone(), 0);
    let deps = Deps { rows: Arc::new(rows), blobs, disk, runner: Arc::new(runner) };
    conformance::put(&*deps.rows, "rig", "lens", 1.5).await;
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
        let spooled = self.deps.blobs.spool_dir().join(job.id.to_string());
        std::fs::write(&spooled, "the archive").unwrap();
        self.deps.blobs.publish(&spooled, &key).await.unwrap();
        accept(&*self.deps.rows, &job).await.id
    }

    pub(super) fn order(&self, order: Order) {
        self.orders.send(order).expect("the puppets listen");
    }

    /// Waits for the row to be as it should.
    pub(super) async fn until(&self, id: Uuid, holds: impl Fn(&Job) -> bool) -> Job {
        let mut changes = self.deps.rows.changes();
        loop {
            let job = conformance::job(&*self.deps.rows, id).await;
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
        self.deps.blobs.local_path(&key).await.unwrap().map(|path| std::fs::read(path).unwrap())
    }

    /// The folders that running jobs have in the spool.
    pub(super) fn benches(&self) -> usize {
        std::fs::read_dir(self.deps.blobs.spool_dir()).unwrap().count()
    }
}
