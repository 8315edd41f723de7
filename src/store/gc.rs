//! Garbage collection: removes every blob that no row refers to, and nothing else.
//!
//! | job | its upload | its results |
//! |---|---|---|
//! | queued, failed, cancelled | kept | removed |
//! | running | kept | kept from the current lease on; those of older leases are removed |
//! | succeeded | kept until its retention time expires | kept (those of the lease that published) |
//! | no row | removed after [`GRACE`] | removed after [`GRACE`] |
//!
//! | resumable upload | its parts |
//! |---|---|
//! | open: waits for bytes or for its job | kept until it expires |
//! | complete, refused, expired or deleted | removed |
//!
//! Safe beside running servers and other collections: the rows are read before each removal, a row is written after its
//! blob and removed before it.

use std::time::Duration;

use uuid::Uuid;

use super::{BlobOwner, MetadataStore, Retention, StoreResult, blobs::Blobs};
use crate::contract::JobState;

/// Minimum age of blobs without a row before they are removed: an upload is stored before its row is written.
pub const GRACE: Duration = Duration::from_secs(60 * 60);

/// What a collection removed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Collected {
    /// Expired jobs.
    pub expired: usize,
    /// Jobs without a row that had blobs.
    pub orphans: usize,
    /// Resumable uploads that expired before they were complete.
    pub given_up: usize,
    /// Expired zips of jobs whose results are kept.
    pub uploads: usize,
}

/// Removes expired jobs and uploads, the blobs of jobs without a row that are older than `grace`, and results that were
/// never published.
///
/// # Errors
/// When rows or blobs cannot be read or removed. What was removed until then stays removed; the next collection continues.
pub async fn collect(
    rows: &dyn MetadataStore,
    blobs: &dyn Blobs,
    grace: Duration,
    keep: &Retention,
) -> StoreResult<Collected> {
    let mut collected = Collected::default();
    for id in rows.delete_expired_jobs(keep).await? {
        blobs.delete_job(id).await?;
        collected.expired += 1;
    }
    for id in rows.expire_job_uploads(keep).await? {
        blobs.delete_upload(id).await?;
        collected.uploads += 1;
    }
    for id in rows.delete_expired_uploads().await? {
        gc_upload(rows, blobs, id).await?;
        collected.given_up += 1;
    }
    for id in blobs.partials().await? {
        gc_upload(rows, blobs, id).await?;
    }
    for job in blobs.jobs_with_blobs().await? {
        if rows.upload_is_open(job.id).await? {
            // complete, and its job is about to be created
            continue;
        }
        if rows.blob_owner(job.id).await?.is_some() {
            gc_job(rows, blobs, job.id).await?;
        } else if job.untouched_for >= grace {
            blobs.delete_job(job.id).await?;
            collected.orphans += 1;
        }
    }
    Ok(collected)
}

/// Removes the bytes of a resumable upload that is not open any more. No grace is needed, because its row is written
/// before its bytes. The blobs of the job that it became are kept.
///
/// # Errors
/// When rows or blobs cannot be read or removed.
pub async fn gc_upload(rows: &dyn MetadataStore, blobs: &dyn Blobs, id: Uuid) -> StoreResult<()> {
    if rows.upload_is_open(id).await? {
        return Ok(());
    }
    blobs.remove_partial(id).await?;
    if rows.blob_owner(id).await?.is_none() {
        blobs.delete_job(id).await?;
    }
    Ok(())
}

/// Removes the blobs of one job that its row does not refer to: after the job ended, and after it was deleted. Not for a
/// job whose row is still to be written.
///
/// # Errors
/// When rows or blobs cannot be read or removed.
pub async fn gc_job(rows: &dyn MetadataStore, blobs: &dyn Blobs, id: Uuid) -> StoreResult<()> {
    let Some(BlobOwner { state, lease_token, upload_removed }) = rows.blob_owner(id).await? else {
        return blobs.delete_job(id).await;
    };
    if upload_removed {
        blobs.delete_upload(id).await?;
    }
    let first_kept = match state {
        // the results of this lease are published, or may still be
        JobState::Succeeded | JobState::Running => lease_token,
        JobState::Queued | JobState::Failed | JobState::Cancelled => lease_token.saturating_add(1),
    };
    blobs.delete_stale_results(id, first_kept).await
}
