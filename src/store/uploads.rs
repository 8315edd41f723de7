//! Uploads that arrive in pieces, as their rows have them.
//!
//! What a row says was received is on stable storage: the bytes are written and synced before the row is. The file
//! of an upload is held by one request at a time ([`super::blobs::Blobs::hold_partial`]); a newer request says in the
//! row that it wants to go on, and the one before lets go.

use std::time::Duration;

use async_trait::async_trait;
use jiff::Timestamp;
use uuid::Uuid;

use super::{Enqueue, NewJob, OverQuota, Page, PageRequest, StoreResult};
use crate::contract::{Fault, JobKind};

/// An upload about to begin.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewUpload {
    /// UUIDv7; the job that it becomes has the same.
    pub id: Uuid,
    /// Bytes in all.
    pub length: u64,
    /// State of the digest of no bytes.
    pub digest: Vec<u8>,
    /// What the client says about it, as it came.
    pub metadata: String,
    /// How long it waits for its next byte.
    pub keep: Duration,
    /// The token that sends it; `None` when nobody was asked. The job is its too.
    pub owner: Option<Uuid>,
}

/// Bytes of an upload that are on stable storage now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advance {
    /// How many there were before.
    pub from: u64,
    /// How many there are now.
    pub to: u64,
    /// State of the digest after them.
    pub digest: Vec<u8>,
    /// How long the upload waits for its next byte.
    pub keep: Duration,
}

/// Where an upload is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum UploadState {
    /// Bytes are missing, or all are here and the job could not be made yet.
    Receiving,
    /// The job was made; it has the upload's id.
    Complete(JobKind),
    /// What arrived can be no job of any use, and is gone.
    Refused(Box<Fault>),
}

/// An upload as its row has it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartialUpload {
    /// UUIDv7.
    pub id: Uuid,
    /// Bytes in all.
    pub length: u64,
    /// Bytes on stable storage.
    pub offset: u64,
    /// State of the digest after them.
    pub digest: Vec<u8>,
    /// What the client says about it, as it came.
    pub metadata: String,
    /// Where it is.
    pub state: UploadState,
    /// Grows with each request that wants to go on with it.
    pub wanted: i64,
    /// When it began.
    pub created_at: Timestamp,
    /// When it goes unless something comes before.
    pub expires_at: Timestamp,
}

/// How many uploads may be open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OpenUploadLimits {
    /// In all.
    pub all: u64,
    /// Of one token. Uploads without a token are counted in all alone.
    pub of_owner: u64,
}

/// How beginning an upload ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CreateUpload {
    /// It is stored.
    Begun(PartialUpload),
    /// As many as may be are open already.
    TooMany {
        /// Of its token; else in all.
        of_owner: bool,
    },
    /// It does not fit into the quota of its token.
    OverQuota(OverQuota),
}

/// An upload that waits for bytes or for its job, as the list of them shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OpenUpload {
    /// The upload.
    pub upload: PartialUpload,
    /// Name of the token that sends it; `None` when nobody was asked.
    pub token: Option<String>,
    /// When bytes came last; `None` when none did.
    pub last_byte_at: Option<Timestamp>,
}

/// The rows of uploads.
#[async_trait]
pub trait UploadRows: Send + Sync + 'static {
    /// Begins an upload, if that many may be open and it fits into the quota of its owner.
    async fn create_upload(&self, upload: &NewUpload, limits: OpenUploadLimits) -> StoreResult<CreateUpload>;
    /// The open uploads with their tokens, newest first.
    async fn list_open_uploads(&self, page: &PageRequest) -> StoreResult<Page<OpenUpload>>;
    /// One upload; `None` when there is none or its time is over.
    async fn upload(&self, id: Uuid) -> StoreResult<Option<PartialUpload>>;
    /// Says that another request wants to go on with it: the number by which that request knows whether a still newer
    /// one came. Announced like a change of a job. `None` when there is no such upload.
    async fn want_upload(&self, id: Uuid) -> StoreResult<Option<i64>>;
    /// More bytes are on stable storage. False when the row does not have `from` of them, or waits for none any more.
    async fn advance_upload(&self, id: Uuid, advance: &Advance) -> StoreResult<bool>;
    /// Makes the job of an upload whose bytes are all here, and says so in its row, in one step. An upload that has its
    /// job answers [`Enqueue::Repeated`] with it. `None` when the upload is not there any more or was refused.
    async fn complete_upload(&self, job: &NewJob, queue_limit: u64) -> StoreResult<Option<Enqueue>>;
    /// What arrived was refused. False when there is no such upload, or it has its job.
    async fn refuse_upload(&self, id: Uuid, fault: &Fault) -> StoreResult<bool>;
    /// Removes an upload (not the job that it became); false when there was none.
    async fn delete_upload(&self, id: Uuid) -> StoreResult<bool>;
    /// Removes the uploads whose time is over: their ids.
    async fn delete_expired_uploads(&self) -> StoreResult<Vec<Uuid>>;
    /// True when the bytes of this upload are still needed as such: it is there, and waits for bytes or for its job.
    async fn upload_is_open(&self, id: Uuid) -> StoreResult<bool>;
    /// The uploads whose bytes are still needed as such.
    async fn open_uploads(&self) -> StoreResult<Vec<Uuid>>;
    /// Bytes that open uploads have still to bring.
    async fn awaited_bytes(&self) -> StoreResult<u64>;
}
