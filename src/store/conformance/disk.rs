//! Blobs on a disk that has as much room as a test says.

use std::{
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use uuid::Uuid;

use crate::store::{
    StoreError, StoreResult,
    blobs::{Blobs, JobBlobs, Partial, Room},
};

/// Size of the disk, bytes.
pub(crate) const TOTAL: u64 = 1000;

/// Everything but the measured room is that of `blobs`.
pub(crate) struct SmallDisk {
    pub(crate) blobs: Arc<dyn Blobs>,
    pub(crate) free: AtomicU64,
    /// So many times a blob cannot be opened: too many open files.
    pub(crate) failures: AtomicU64,
}

impl SmallDisk {
    pub(crate) fn over(blobs: Arc<dyn Blobs>, free: u64) -> Self {
        Self { blobs, free: AtomicU64::new(free), failures: AtomicU64::default() }
    }
}

#[async_trait::async_trait]
impl Blobs for SmallDisk {
    /// Lets others write between the measurement and the answer.
    async fn room(&self) -> StoreResult<Room> {
        tokio::task::yield_now().await;
        let free = self.free.load(Ordering::SeqCst);
        tokio::task::yield_now().await;
        Ok(Room { free, total: TOTAL })
    }
    async fn probe(&self) -> StoreResult<()> {
        self.blobs.probe().await
    }

    fn spool_dir(&self) -> &Path {
        self.blobs.spool_dir()
    }
    async fn publish(&self, path: &Path, key: &str) -> StoreResult<()> {
        self.blobs.publish(path, key).await
    }
    async fn share(&self, key: &str, path: &Path) -> StoreResult<bool> {
        self.blobs.share(key, path).await
    }
    async fn local_path(&self, key: &str) -> StoreResult<Option<PathBuf>> {
        let fails = self.failures.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
        if fails.is_ok() {
            return Err(StoreError::of_io(std::io::Error::from_raw_os_error(24), "cannot open a blob".into()));
        }
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
