//! The bytes of resumable uploads while they arrive.

use async_trait::async_trait;
use bytes::Bytes;
use uuid::Uuid;

use super::{SpoolFile, StoreResult, Workspace};

/// Stores the bytes of resumable uploads. One request at a time writes to an upload.
#[async_trait]
pub trait UploadParts: Send + Sync + 'static {
    /// Locks an upload for this caller until the result is dropped, however the process ends. `None` when another
    /// caller holds the lock: in this process, or in any, if [`LockedUpload::is_exclusive`].
    async fn lock(&self, id: Uuid) -> StoreResult<Option<Box<dyn LockedUpload>>>;
    /// Removes the bytes of an upload, if there are any.
    async fn remove(&self, id: Uuid) -> StoreResult<()>;
    /// The uploads that have bytes; perhaps also some that have been locked.
    async fn list(&self) -> StoreResult<Vec<Uuid>>;
}

/// An upload that this caller has locked.
#[async_trait]
pub trait LockedUpload: Send {
    /// True: no other process can lock the upload meanwhile. False: another can, and then only the caller whose
    /// generation of the upload is the newest may record an offset (`Advance::generation`).
    fn is_exclusive(&self) -> bool;
    /// Number of bytes that are stored.
    async fn length(&self) -> StoreResult<u64>;
    /// Continues after the first `offset` bytes and discards those after them. False when fewer are stored.
    /// `generation` is that of the caller: bytes of a later one replace those of an earlier one.
    async fn resume_at(&mut self, offset: u64, generation: i64) -> StoreResult<bool>;
    /// Appends bytes. Fails before the first [`Self::resume_at`].
    async fn append(&mut self, bytes: Bytes) -> StoreResult<()>;
    /// On return, the appended bytes are durable.
    async fn sync(&mut self) -> StoreResult<()>;
    /// Makes the first `length` bytes the blob `key` within the store, where the engine can, so that they need not pass
    /// this machine. False when it cannot, or fewer are stored. The parts stay.
    async fn become_blob(&mut self, length: u64, key: &str) -> StoreResult<bool> {
        let _ = (length, key);
        Ok(false)
    }
    /// The first `length` bytes as one file, which can be checked and then stored as a blob. `None` when fewer are
    /// stored.
    async fn assemble(&mut self, length: u64, workspace: &Workspace) -> StoreResult<Option<SpoolFile>>;
}
