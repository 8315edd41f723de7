//! Durable state of the service: metadata (rows of a database) and blobs (uploads and results).
//!
//! | part of [`Store`] | trait | engine |
//! |---|---|---|
//! | profiles, scans, notes, jobs, leases, expiry, resumable uploads, tokens | [`MetadataStore`] | [`sqlite`], or [`postgres`] for several machines |
//! | uploads and results by key | [`BlobStore`] | [`local`], or [`s3`] for several machines |
//! | bytes of resumable uploads while they arrive | [`UploadParts`] | the same |
//! | scratch of this process | [`Workspace`], not a trait | |
//!
//! [`open`] is the only place that names an engine. Each trait has a conformance suite in `store::conformance` that
//! runs on every engine.
//!
//! Whatever is acknowledged to a client has been made durable in this order: write bytes, fsync the file, rename it,
//! fsync the folder, commit the row. With a bucket: store the object, compare its size, commit the row.

pub mod backup;
mod blob_files;
pub mod blobs;
pub mod clock;
pub mod data_folder;
pub mod digest;
pub mod error;
pub mod expiry;
pub mod failpoint;
pub mod folder;
pub mod gc;
pub mod inspection;
pub mod jobs;
pub mod json;
pub mod leases;
pub mod local;
pub mod metadata;
pub mod notes;
pub mod page;
pub mod parts;
pub mod postgres;
pub mod profiles;
mod ranges;
mod rows;
pub mod s3;
pub mod scans;
pub mod search;
pub mod sqlite;
pub mod tokens;
pub mod totals;
pub mod uploads;
pub mod verify;
pub mod workspace;

#[cfg(any(test, feature = "testing"))]
pub mod conformance;

pub use blob_files::SpoolFile;
pub use blobs::BlobStore;
pub use clock::{Clock, SystemClock};
#[cfg(any(test, feature = "testing"))]
pub use conformance::clock::ManualClock;
pub use data_folder::{Shared, open, open_metadata, open_shared, open_shared_metadata, open_with_clock};
pub use error::{StoreError, StoreResult, is_full};
pub use expiry::{Expiry, Retention};
pub use jobs::{BlobOwner, CancelRequest, Enqueue, EnqueueAll, Job, JobCounts, JobFilter, JobQueue, NewJob, OverQuota};
pub use leases::{Attempt, Finish, Heartbeat, Leases};
pub use metadata::MetadataStore;
pub use notes::NoteStore;
pub use page::{Page, PageRequest, Skipped};
pub use parts::UploadParts;
pub use postgres::DatabaseUrl;
pub use profiles::{DeleteProfile, Precondition, ProfileDraft, ProfileStore, PutProfile};
pub use s3::S3Location;
pub use scans::ScanStore;
pub use tokens::Tokens;
pub use totals::Totals;
pub use uploads::UploadRecords;
pub use workspace::Workspace;

use std::sync::Arc;

/// The store of the service: one handle per part. Cheap to clone.
#[derive(Clone)]
pub struct Store {
    /// Profiles, scans, notes, jobs, uploads, tokens.
    pub metadata: Arc<dyn MetadataStore>,
    /// Uploads and results.
    pub blobs: Arc<dyn BlobStore>,
    /// Bytes of resumable uploads while they arrive.
    pub parts: Arc<dyn UploadParts>,
    /// Scratch of this process.
    pub workspace: Arc<Workspace>,
}
