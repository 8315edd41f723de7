//! Resumable uploads: their metadata. Their bytes are in [`super::parts`].
//!
//! The offset of a row counts bytes on stable storage only: bytes are written and synced before the row is updated. One
//! request at a time holds the lock on the bytes of an upload. A newer request increments the generation of the row;
//! the request that holds the lock observes this and releases it.

use std::time::Duration;

use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

use super::{Enqueue, EnqueueAll, NewJob, OverQuota, Page, PageRequest, StoreResult};
use crate::contract::{Fault, UploadPurpose};

/// An upload that is to be created.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewUpload {
    /// UUIDv7; the job that it becomes has the same id.
    pub id: Uuid,
    /// Total length, bytes.
    pub length: u64,
    /// State of the hash of zero bytes.
    pub digest: Vec<u8>,
    /// `Upload-Metadata` of the client, unchanged.
    pub metadata: String,
    /// Time from the last byte until the upload expires.
    pub keep: Duration,
    /// The token that sends it, `None` when no token was required. The job has the same owner.
    pub owner: Option<Uuid>,
}

/// Bytes of an upload that have reached stable storage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advance {
    /// Offset before.
    pub from: u64,
    /// Offset now.
    pub to: u64,
    /// State of the hash at the new offset.
    pub digest: Vec<u8>,
    /// Time from now until the upload expires.
    pub keep: Duration,
    /// The generation that must still be the newest; `None` where the lock of the upload keeps other requests out.
    pub generation: Option<i64>,
}

/// State of an upload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum UploadState {
    /// Bytes are missing, or the job could not be created yet.
    Receiving,
    /// The job was created; it has the id of the upload. Of a scan: its stacks were created, with other ids.
    Complete(UploadPurpose),
    /// The content was refused for good, and is removed.
    Refused(Box<Fault>),
}

/// A stored upload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartialUpload {
    /// UUIDv7.
    pub id: Uuid,
    /// Total length, bytes.
    pub length: u64,
    /// Bytes on stable storage.
    pub offset: u64,
    /// State of the hash at the offset.
    pub digest: Vec<u8>,
    /// `Upload-Metadata` of the client, unchanged.
    pub metadata: String,
    /// State.
    pub state: UploadState,
    /// Incremented by each request that takes the upload over. A request that sees another number than its own must
    /// stop.
    pub generation: i64,
    /// Time of creation.
    pub created_at: Timestamp,
    /// Time at which it expires unless more bytes arrive.
    pub expires_at: Timestamp,
}

/// Limits on the number of open uploads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OpenUploadLimits {
    /// Of all tokens together, and without a token.
    pub all: u64,
    /// Of one token.
    pub of_owner: u64,
}

/// Result of creating an upload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CreateUpload {
    /// It is stored.
    Created(PartialUpload),
    /// Too many uploads are open.
    TooMany {
        /// True: of its token. False: of all tokens together.
        of_owner: bool,
    },
    /// It exceeds the quota of its token.
    OverQuota(OverQuota),
}

/// An open upload as lists show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpenUpload {
    /// The upload.
    pub upload: PartialUpload,
    /// Name of the token that sends it; `None` when no token was required.
    pub token: Option<String>,
    /// Time of the last byte; `None` before the first.
    pub last_byte_at: Option<Timestamp>,
}

/// An upload that expired, and was removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ExpiredUpload {
    /// Its id.
    pub id: Uuid,
    /// True when it waited for bytes or for its job; false when it was complete or refused.
    pub was_open: bool,
}

/// Stores the metadata of resumable uploads. An upload is open until it is complete, refused, deleted or expired.
#[async_trait]
pub trait UploadRecords: Send + Sync + 'static {
    /// Creates an upload within the limits and the quota of its owner.
    async fn create_upload(&self, upload: &NewUpload, limits: OpenUploadLimits) -> StoreResult<CreateUpload>;
    /// The open uploads with their tokens, newest first.
    async fn list_open_uploads(&self, page: &PageRequest) -> StoreResult<Page<OpenUpload>>;
    /// One upload; `None` when it does not exist or has expired.
    async fn upload(&self, id: Uuid) -> StoreResult<Option<PartialUpload>>;
    /// Increments the generation of an upload and returns the new one. Announced like a change of a job. `None` when
    /// there is no such upload.
    async fn take_over_upload(&self, id: Uuid) -> StoreResult<Option<i64>>;
    /// Records bytes that are on stable storage. False when the offset is not `from`, the upload is not open, or
    /// another generation than [`Advance::generation`] is the newest.
    async fn advance_upload(&self, id: Uuid, advance: &Advance) -> StoreResult<bool>;
    /// Creates the job of an upload whose bytes are complete, and records it in the upload, in one transaction. An
    /// upload that has its job returns [`Enqueue::Repeated`] with it. `None` when the upload is not complete, does not
    /// exist or was refused, or its job was deleted.
    async fn complete_upload(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Option<Enqueue>>;
    /// Creates the stacks of an upload that holds a whole scan, all or none, and records it in the upload, in one
    /// transaction. An upload that has its stacks returns [`EnqueueAll::Accepted`] without jobs. `None` when the upload
    /// is not complete, does not exist or was refused.
    async fn complete_scan_upload(
        &self,
        id: Uuid,
        jobs: &[NewJob],
        queue_limit: u64,
    ) -> StoreResult<Option<EnqueueAll>>;
    /// Records that the content was refused. False when there is no such upload, or it has its job.
    async fn refuse_upload(&self, id: Uuid, fault: &Fault) -> StoreResult<bool>;
    /// Removes an upload, but not the job that it became; false when there is no such upload.
    async fn delete_upload(&self, id: Uuid) -> StoreResult<bool>;
    /// Removes the expired uploads, open or not, and returns them.
    async fn delete_expired_uploads(&self) -> StoreResult<Vec<ExpiredUpload>>;
    /// True while the parts of this upload are needed: it waits for bytes or for its job.
    async fn upload_is_open(&self, id: Uuid) -> StoreResult<bool>;
    /// The time since which blobs of an upload may be stored whose jobs do not exist yet: the earliest last byte of an
    /// open upload that is whole. `None` without such an upload.
    async fn storing_since(&self) -> StoreResult<Option<Timestamp>>;
    /// The uploads whose parts are needed.
    async fn open_uploads(&self) -> StoreResult<Vec<Uuid>>;
    /// Bytes that open uploads have announced and not sent yet.
    async fn reserved_bytes(&self) -> StoreResult<u64>;
}
