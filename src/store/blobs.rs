//! Blobs: uploads and results, by key. A key is `uploads/{job}.zip` or `results/{job}/{lease}/{file}`, made by us,
//! never from a client's name.

pub mod local;
mod partial;
mod probe;

use std::{
    path::{Path, PathBuf},
    time::Duration,
};

use async_trait::async_trait;
use bytes::Bytes;
use uuid::Uuid;

use super::StoreResult;

/// Where blobs live. One narrow seam with one conformance suite that runs on every engine.
#[async_trait]
pub trait Blobs: Send + Sync + 'static {
    /// A folder for files in the making: uploads that arrive, scratch of the workers, artifacts before they are published.
    /// It belongs to this process alone; what dead processes left is removed at the start. On the same file system as the blobs when they are local.
    fn spool_dir(&self) -> &Path;
    /// Makes the file at `path` (in the spool folder) the blob `key`: fsync file, rename, fsync folder.
    /// On return it survives a crash; the file at `path` is gone.
    async fn publish(&self, path: &Path, key: &str) -> StoreResult<()>;
    /// Makes the blob `key` a file of the spool folder too, at `path`, where nothing is yet; it can be published under
    /// another key. The bytes are shared, not copied, where the blob store can do that, and they stay until both are
    /// gone. False when there is no such blob.
    async fn share(&self, key: &str, path: &Path) -> StoreResult<bool>;
    /// A readable, seekable local file with the blob's bytes; `None` when there is no such blob.
    async fn local_path(&self, key: &str) -> StoreResult<Option<PathBuf>>;
    /// Removes every blob of a job (`uploads/{id}.zip`, `results/{id}/`).
    async fn delete_job(&self, id: Uuid) -> StoreResult<()>;
    /// Removes the upload of a job, and nothing else of it.
    async fn delete_upload(&self, id: Uuid) -> StoreResult<()>;
    /// Removes the results of leases older than `first_kept`. Newer ones stay: a worker may have claimed the job again
    /// since the caller looked.
    async fn delete_stale_results(&self, id: Uuid, first_kept: i64) -> StoreResult<()>;
    /// The jobs that have blobs.
    async fn jobs_with_blobs(&self) -> StoreResult<Vec<JobBlobs>>;
    /// Writes a file and moves it to where blobs lie, as every upload does: an error when that cannot be done.
    async fn probe(&self) -> StoreResult<()>;
    /// Bytes that can still be written, and how many could be if nothing were stored.
    async fn room(&self) -> StoreResult<Room>;

    /// The file of an upload that arrives in pieces, for this caller alone until it is dropped, however the process ends.
    /// `None` when somebody else has it, in this process or another.
    async fn hold_partial(&self, id: Uuid) -> StoreResult<Option<Box<dyn Partial>>>;
    /// Removes the file of an upload, if there is one.
    async fn remove_partial(&self, id: Uuid) -> StoreResult<()>;
    /// The uploads that have a file, or had one.
    async fn partials(&self) -> StoreResult<Vec<Uuid>>;
}

/// The file of an upload that arrives in pieces.
#[async_trait]
pub trait Partial: Send {
    /// Goes on behind the first `offset` bytes; what lies behind them goes. False when there are not so many.
    async fn start_at(&mut self, offset: u64) -> StoreResult<bool>;
    /// Writes what comes next.
    async fn write(&mut self, bytes: Bytes) -> StoreResult<()>;
    /// On return, what was written survives a crash.
    async fn sync(&mut self) -> StoreResult<()>;
    /// Where it lies: on the same file system as the spool folder, so that it can be published.
    fn path(&self) -> &Path;
}

/// What a disk has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// Bytes that can still be written.
    pub free: u64,
    /// Bytes that it has in all.
    pub total: u64,
}

/// A job that has blobs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JobBlobs {
    /// The job.
    pub id: Uuid,
    /// Time since the youngest of its blobs was published (or a folder of it was changed). An upload is published before
    /// its row is written, so a young blob without a row is no garbage yet.
    pub untouched_for: Duration,
}

/// Key of the upload of a job.
pub fn upload_key(job: Uuid) -> String {
    format!("uploads/{job}.zip")
}

/// Key of a result of a job, made under one lease.
pub fn result_key(job: Uuid, lease_token: i64, file: &str) -> String {
    format!("results/{job}/{lease_token}/{file}")
}
