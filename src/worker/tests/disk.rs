//! Workers when the disk is full, or was.

use std::{
    path::{Path, PathBuf},
    sync::atomic::{AtomicU64, Ordering},
};

use uuid::Uuid;

use super::*;
use crate::store::{
    StoreResult,
    blobs::{JobBlobs, Partial, Room},
};

/// Blobs on a disk that has as much room as a test says.
struct FullDisk {
    blobs: Arc<dyn Blobs>,
    free: AtomicU64,
}

#[async_trait::async_trait]
impl Blobs for FullDisk {
    async fn room(&self) -> StoreResult<Room> {
        Ok(Room { free: self.free.load(Ordering::SeqCst), total: 1000 })
    }
    fn spool_dir(&self) -> &Path {
        self.blobs.spool_dir()
    }
    async fn publish(&self, path: &Path, key: &str) -> StoreResult<()> {
        self.blobs.publish(path, key).await
    }
    async fn local_path(&self, key: &str) -> StoreResult<Option<PathBuf>> {
        self.blobs.local_path(key).await
    }
    async fn delete_job(&self, id: Uuid) -> StoreResult<()> {
        self.blobs.delete_job(id).await
    }
    async fn delete_upload(&self, id: Uuid) -> StoreResult<()> {
        self.blobs.delete_upload(id).await
    }
    async fn delete_stale_results(&self, id: Uuid, first_kept: i64) -> StoreResult<()> {
        self.blobs.delete_stale_results(id, first_kept).await
    }
    async fn jobs_with_blobs(&self) -> StoreResult<Vec<JobBlobs>> {
        self.blobs.jobs_with_blobs().await
    }
    async fn hold_partial(&self, id: Uuid) -> StoreResult<Option<Box<dyn Partial>>> {
        self.blobs.hold_partial(id).await
    }
    async fn remove_partial(&self, id: Uuid) -> StoreResult<()> {
        self.blobs.remove_partial(id).await
    }
    async fn partials(&self) -> StoreResult<Vec<Uuid>> {
        self.blobs.partials().await
    }
}

worker_test! {
    async fn a_job_under_which_the_disk_becomes_full_is_tried_again_and_not_for_ever() {
        let stage = stage().await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let id = stage.accept().await;
        stage.order(Order::Full);
        stage.order(Order::Succeed);
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 2));
        let id = stage.accept().await;
        for _ in 0..3 {
            stage.order(Order::Full);
        }
        let job = stage.ended(id).await;
        assert_eq!((job.state, job.attempt), (JobState::Failed, 3));
        assert_eq!(job.error.unwrap().code, Code::InsufficientStorage);
    }
}

worker_test! {
    async fn a_job_that_could_never_fit_on_the_disk_fails_with_figures() {
        let stage = stage_with_needs(1, u64::MAX).await;
        let _pool = Pool::start(stage.deps.clone(), config(1));
        let job = stage.ended(stage.accept().await).await;
        let error = job.error.expect("it failed");
        assert_eq!(error.code, Code::InsufficientStorage);
        assert!(error.detail.contains(&u64::MAX.to_string()), "{}", error.detail);
    }
}

worker_test! {
    async fn a_job_waits_for_room_on_the_disk_and_can_be_cancelled_meanwhile() {
        let stage = stage_with_needs(1, 1).await;
        let full = Arc::new(FullDisk { blobs: Arc::clone(&stage.deps.blobs), free: AtomicU64::new(0) });
        let deps = Deps { blobs: full.clone(), ..stage.deps.clone() };
        let _pool = Pool::start(deps, config(1));
        let (cancelled, waiting) = (stage.accept().await, stage.accept().await);
        let waits = |job: &Job| job.state == JobState::Running && job.progress.stage.contains("room on the disk");
        stage.until(cancelled, waits).await;
        stage.deps.rows.cancel(cancelled).await.unwrap();
        assert_eq!(stage.ended(cancelled).await.state, JobState::Cancelled);
        stage.until(waiting, waits).await;
        full.free.store(1, Ordering::SeqCst);
        stage.order(Order::Succeed);
        let job = stage.ended(waiting).await;
        assert_eq!((job.state, job.attempt), (JobState::Succeeded, 1));
    }
}
