//! The blob store: uploads and results by key.
//!
//! | key | blob |
//! |---|---|
//! | `uploads/{job}.zip` | the upload of a job |
//! | `results/{job}/{lease}/{file}` | a result, written under one lease |
//!
//! The interface is that of an object store, not of a file system: a blob is written as a whole, is never changed, and
//! is read by range. Code that seeks, such as the zip reader, asks for [`BlobStore::fetch`], or, if it reads little of
//! the blob, for [`BlobStore::open`]. Both keep the returned guard as long as they read.

use std::{
    io,
    ops::Range,
    time::{Duration, SystemTime},
};

use anyhow::anyhow;
use async_trait::async_trait;
use bytes::Bytes;
use futures::stream::BoxStream;
use uuid::Uuid;

use super::{SpoolFile, StoreError, StoreResult, Workspace};
pub use super::{
    blob_files::{LocalBlob, OpenBlob},
    workspace::Capacity,
};

/// The bytes of a blob, in chunks.
pub type ByteStream = BoxStream<'static, io::Result<Bytes>>;

/// Stores blobs. Keys are made by the service, never taken from a client.
#[async_trait]
pub trait BlobStore: Send + Sync + 'static {
    /// True when [`BlobStore::fetch`] gives the blob itself. False when it gives a copy, which needs disk space.
    fn is_local(&self) -> bool;
    /// Stores a file as the blob `key`. On return the blob is durable and the file at its path is gone. On an error the
    /// file is still there, or is removed with its guard.
    async fn put(&self, key: &str, file: SpoolFile) -> StoreResult<()>;
    /// A new spool file with the bytes of a blob, which can be stored under another key. The bytes are shared, not
    /// copied, where the engine supports it. `None` when there is no such blob.
    async fn share(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<SpoolFile>>;
    /// Size and age of a blob; `None` when there is no such blob.
    async fn head(&self, key: &str) -> StoreResult<Option<BlobMeta>>;
    /// Bytes of a blob. The stream can be read to its end even if the blob is removed meanwhile. `None` when there is
    /// no such blob.
    async fn read(&self, key: &str, range: Range<u64>) -> StoreResult<Option<ByteStream>>;
    /// A URL at which a client can get a blob without the service, until `valid` has passed. `None` when the engine has
    /// no such URLs. Says nothing about whether the blob exists.
    async fn signed_url(&self, key: &str, valid: Duration, answer: &SignedAnswer) -> StoreResult<Option<String>> {
        let _ = (key, valid, answer);
        Ok(None)
    }
    /// A local file with the bytes of a blob, for code that seeks: the blob itself if it is local, otherwise a copy in
    /// `workspace`. `None` when there is no such blob.
    async fn fetch(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<LocalBlob>>;
    /// The bytes of a blob by offset, for code that reads parts of it: nothing else is fetched. `None` when there is no
    /// such blob.
    async fn open(&self, key: &str, workspace: &Workspace) -> StoreResult<Option<OpenBlob>>;
    /// Removes a blob, if it exists.
    async fn delete(&self, key: &str) -> StoreResult<()>;
    /// Removes every blob whose key begins with `prefix`, which ends with `/`.
    async fn delete_prefix(&self, prefix: &str) -> StoreResult<()>;
    /// All blobs whose key begins with `prefix`, which is empty or ends with `/`, in any order.
    fn list(&self, prefix: &str) -> BoxStream<'static, StoreResult<BlobMeta>>;
    /// Removes what the engine itself may have left behind: empty folders, uploads that were not finished.
    async fn remove_leftovers(&self) -> StoreResult<()>;
    /// Free and total bytes; `None` when the store is not bounded by a disk.
    async fn capacity(&self) -> StoreResult<Option<Capacity>>;
    /// Checks that a blob could be stored.
    ///
    /// # Errors
    /// When it could not.
    async fn probe(&self) -> StoreResult<()>;
}

/// What the answer at a signed URL says of the bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SignedAnswer {
    /// `Content-Type`.
    pub media_type: String,
    /// `Content-Disposition`.
    pub disposition: String,
}

/// A blob as lists show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlobMeta {
    /// Its key.
    pub key: String,
    /// Its size, bytes.
    pub size: u64,
    /// When it was stored.
    pub last_modified: SystemTime,
}

/// Requires that a key is valid: parts of `A-Z a-z 0-9 . _ -` that do not begin with `.`, separated by `/`. Keys are
/// made by the service; one that could leave the store is refused all the same.
///
/// # Errors
/// When it is not valid.
pub fn require_key(key: &str) -> StoreResult<()> {
    let is_safe = |part: &str| {
        !part.is_empty()
            && !part.starts_with('.')
            && part.bytes().all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
    };
    if key.split('/').all(is_safe) { Ok(()) } else { Err(StoreError::Other(anyhow!("invalid blob key '{key}'"))) }
}

/// Requires that a prefix is a valid key followed by `/`.
///
/// # Errors
/// When it is not.
pub fn require_prefix(prefix: &str) -> StoreResult<()> {
    match prefix.strip_suffix('/') {
        Some(key) => require_key(key),
        None => Err(StoreError::Other(anyhow!("the prefix '{prefix}' does not end with '/'"))),
    }
}

/// Prefix of the keys of uploads.
pub const UPLOADS: &str = "uploads/";
/// Prefix of the keys of results.
pub const RESULTS: &str = "results/";

/// Key of the upload of a job.
pub fn upload_key(job: Uuid) -> String {
    format!("{UPLOADS}{job}.zip")
}

/// Prefix of the keys of all results of a job.
pub fn results_prefix(job: Uuid) -> String {
    format!("{RESULTS}{job}/")
}

/// Key of a result of a job, written under one lease.
pub fn result_key(job: Uuid, lease_token: i64, file: &str) -> String {
    format!("{RESULTS}{job}/{lease_token}/{file}")
}

/// The job that the key of a blob belongs to.
pub fn job_of_key(key: &str) -> Option<Uuid> {
    let id = match key.strip_prefix(UPLOADS) {
        Some(file) => file.strip_suffix(".zip")?,
        None => key.strip_prefix(RESULTS)?.split('/').next()?,
    };
    Uuid::try_parse(id).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_job_of_a_key_is_found() {
        let id = Uuid::now_v7();
        assert_eq!(job_of_key(&upload_key(id)), Some(id));
        assert_eq!(job_of_key(&result_key(id, 3, "image.png")), Some(id));
        assert_eq!(job_of_key(&results_prefix(id)), Some(id));
        for other in ["uploads/probe", "results/probe", "x", ""] {
            assert_eq!(job_of_key(other), None, "{other}");
        }
    }
}
