//! Blobs: uploads and results, by key. A key is `uploads/{job}.zip` or `results/{job}/{lease}/{file}`, made by us,
//! never from a client's name.

use std::path::{Path, PathBuf};

use async_trait::async_trait;
use uuid::Uuid;

use super::StoreResult;

/// Where blobs live. One narrow seam with one conformance suite that runs on every engine.
#[async_trait]
pub trait Blobs: Send + Sync + 'static {
    /// A folder for files in the making: uploads that arrive, scratch of the workers, artifacts before they are published.
    /// Emptied when the server starts. On the same file system as the blobs when they are local.
    fn spool_dir(&self) -> &Path;
    /// Makes the file at `path` (in the spool folder) the blob `key`: fsync file, rename, fsync folder.
    /// On return it survives a crash; the file at `path` is gone.
    async fn publish(&self, path: &Path, key: &str) -> StoreResult<()>;
    /// A readable, seekable local file with the blob's bytes; `None` when there is no such blob.
    async fn local_path(&self, key: &str) -> StoreResult<Option<PathBuf>>;
    /// Removes every blob of a job (`uploads/{id}.zip`, `results/{id}/`).
    async fn delete_job(&self, id: Uuid) -> StoreResult<()>;
    /// Removes the results that leases other than `keep` left behind.
    async fn delete_stale_results(&self, id: Uuid, keep: i64) -> StoreResult<()>;
    /// The jobs that have blobs.
    async fn jobs_with_blobs(&self) -> StoreResult<Vec<Uuid>>;
    /// Bytes that can still be written.
    async fn room(&self) -> StoreResult<u64>;
}

/// Key of the upload of a job.
pub fn upload_key(job: Uuid) -> String {
    format!("uploads/{job}.zip")
}

/// Key of a result of a job, made under one lease.
pub fn result_key(job: Uuid, lease_token: i64, file: &str) -> String {
    format!("results/{job}/{lease_token}/{file}")
}
