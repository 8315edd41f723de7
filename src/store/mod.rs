//! Durable state of the service: metadata (rows of a database) and blobs (uploads and results).
//!
//! | part | trait | engine |
//! |---|---|---|
//! | profiles, jobs, leases, expiry, resumable uploads, tokens | [`MetadataStore`] | [`sqlite`] |
//! | uploads and results by key | [`blobs::Blobs`] | [`blobs::local`] |
//!
//! Whatever is acknowledged to a client has been made durable in this order: write bytes, fsync the file, rename it,
//! fsync the folder, commit the row.

pub mod backup;
pub mod blobs;
pub mod clock;
pub mod digest;
pub mod error;
pub mod expiry;
pub mod failpoint;
pub mod folder;
pub mod gc;
pub mod jobs;
pub mod json;
pub mod leases;
pub mod metadata;
pub mod page;
pub mod profiles;
pub mod sqlite;
pub mod tokens;
pub mod totals;
pub mod uploads;
pub mod verify;

#[cfg(test)]
pub(crate) mod conformance;

pub use clock::{Clock, ManualClock, SystemClock};
pub use error::{StoreError, StoreResult, is_full};
pub use expiry::{Expiry, Retention};
pub use jobs::{BlobOwner, CancelRequest, Enqueue, Job, JobCounts, JobFilter, JobQueue, NewJob, OverQuota};
pub use leases::{Attempt, Finish, Heartbeat, Leases};
pub use metadata::MetadataStore;
pub use page::{Page, PageRequest, Skipped};
pub use profiles::{Precondition, ProfileDraft, ProfileStore, PutProfile};
pub use tokens::Tokens;
pub use totals::Totals;
pub use uploads::UploadRecords;
