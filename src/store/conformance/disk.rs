//! A blob store on a disk whose free space the test sets.

use std::{
    ops::Range,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

use async_trait::async_trait;
use futures::stream::BoxStream;

use crate::store::{
    BlobStore, SpoolFile, StoreError, StoreResult, Workspace,
    blobs::{BlobMeta, ByteStream, Capacity, LocalBlob, OpenBlob},
};

/// Size of the disk, bytes.
pub const TOTAL: u64 = 1000;

/// Passes everything but its capacity on to `blobs`.
pub struct SmallDisk {
    /// The blobs.
    pub blobs: Arc<dyn BlobStore>,
    /// Free bytes.
    pub free: AtomicU64,
    /// Number of fetches that fail (too many open files) before the first that succeeds.
    pub failures: AtomicU64,
    /// Number of fetches, before these, that find the store away.
    pub absences: AtomicU64,
}

impl SmallDisk {
    /// A disk with `free` bytes.
    pub fn over(blobs: Arc<dyn BlobStore>, free: u64) -> Self {
        Self { blobs, free: AtomicU64::new(free), failures: AtomicU64::default(), absences: AtomicU64::default() }
    }
}

#[async_trait]
impl BlobStore for SmallDisk {
    fn is_local(&self) -> bool {
        true
    }

    /// Lets others write between the measurement and the answer.
    async fn capacity(&self) -> StoreResult<Option<Capacity>> {
        tokio::task::yield_now().await;
        let free = self.free.load(Ordering::SeqCst);
        tokio::task::yield_now().await;
        Ok(Some(Capacity { free, total: TOTAL }))
    }

    async fn fetch(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<LocalBlob>> {
        let takes = |from: &AtomicU64| {
            from.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1)).is_ok()
        };
        if takes(&self.absences) {
            return Err(StoreError::Unavailable(anyhow::anyhow!("it restarts")));
        }
        if takes(&self.failures) {
            return Err(StoreError::of_io(std::io::Error::from_raw_os_error(24), "cannot open a blob".into()));
        }
        self.blobs.fetch(key, workspace).await
    }

    async fn open(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<OpenBlob>> {
        self.blobs.open(key, workspace).await
    }

    async fn put(&self, key: &str, file: SpoolFile) -> StoreResult<()> {
        self.blobs.put(key, file).await
    }

    async fn share(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<SpoolFile>> {
        self.blobs.share(key, workspace).await
    }

    async fn head(&self, key: &str) -> StoreResult<Option<BlobMeta>> {
        self.blobs.head(key).await
    }

    async fn read(&self, key: &str, range: Range<u64>) -> StoreResult<Option<ByteStream>> {
        self.blobs.read(key, range).await
    }

    async fn delete(&self, key: &str) -> StoreResult<()> {
        self.blobs.delete(key).await
    }

    async fn delete_prefix(&self, prefix: &str) -> StoreResult<()> {
        self.blobs.delete_prefix(prefix).await
    }

    fn list(&self, prefix: &str) -> BoxStream<'static, StoreResult<BlobMeta>> {
        self.blobs.list(prefix)
    }

    async fn remove_leftovers(&self) -> StoreResult<()> {
        self.blobs.remove_leftovers().await
    }

    async fn probe(&self) -> StoreResult<()> {
        self.blobs.probe().await
    }
}
