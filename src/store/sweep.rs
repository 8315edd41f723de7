//! Clean-up: what no live row names goes, what one names stays.
//!
//! A job that failed or was cancelled keeps its upload (its row names it, and it tells why it failed) and loses its
//! results; one that succeeded loses its upload when that is over its time; a running job keeps the results of its present lease; a job without a row loses everything. An upload that
//! arrives in pieces keeps its bytes until its time is over.

use std::time::Duration;

use uuid::Uuid;

use super::{BlobOwner, Rows, StoreResult, blobs::Blobs};
use crate::contract::JobState;

/// An upload is published before its row is written: blobs without a row are left alone for so long.
pub const GRACE: Duration = Duration::from_secs(60 * 60);

/// How long what has ended is kept where the job itself does not say so. `None`: for ever.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Retention {
    /// Stacks that went well, with their results.
    pub stacks: Option<Duration>,
    /// Stacks and calibrations that failed or were cancelled.
    pub failed: Option<Duration>,
    /// Zips of stacks and calibrations that went well; the results stay.
    pub uploads: Option<Duration>,
}

/// What a sweep did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Swept {
    /// Jobs removed because their time was over.
    pub expired: usize,
    /// Jobs without a row whose blobs were removed.
    pub orphans: usize,
    /// Uploads that nobody went on with.
    pub given_up: usize,
    /// Jobs whose zip was removed because its time was over.
    pub uploads: usize,
}

/// Removes expired jobs and uploads, the blobs of jobs that have no row, and results that were never published.
///
/// # Errors
/// When rows or blobs cannot be read or removed; what was done until then stays done, and the next sweep goes on.
pub async fn sweep(rows: &dyn Rows, blobs: &dyn Blobs, grace: Duration, keep: &Retention) -> StoreResult<Swept> {
    let mut swept = Swept::default();
    for id in rows.delete_expired(keep).await? {
        blobs.delete_job(id).await?;
        swept.expired += 1;
    }
    for id in rows.expire_job_uploads(keep).await? {
        blobs.delete_upload(id).await?;
        swept.uploads += 1;
    }
    for id in rows.delete_expired_uploads().await? {
        tidy_upload(rows, blobs, id).await?;
        swept.given_up += 1;
    }
    for id in blobs.partials().await? {
        tidy_upload(rows, blobs, id).await?;
    }
    for job in blobs.jobs_with_blobs().await? {
        if rows.upload_is_open(job.id).await? {
            // all its bytes are here, and the job is about to be made
            continue;
        }
        if rows.blob_owner(job.id).await?.is_some() {
            tidy_job(rows, blobs, job.id).await?;
        } else if job.untouched_for >= grace {
            blobs.delete_job(job.id).await?;
            swept.orphans += 1;
        }
    }
    Ok(swept)
}

/// Removes the bytes of an upload that is not open any more: its row comes before its bytes, so there is nothing to wait
/// for. What a job was made of is the job's.
///
/// # Errors
/// When rows or blobs cannot be read or removed.
pub async fn tidy_upload(rows: &dyn Rows, blobs: &dyn Blobs, id: Uuid) -> StoreResult<()> {
    if rows.upload_is_open(id).await? {
        return Ok(());
    }
    blobs.remove_partial(id).await?;
    if rows.blob_owner(id).await?.is_none() {
        blobs.delete_job(id).await?;
    }
    Ok(())
}

/// Removes what the row of one job does not name any more: after its end, and after it was deleted. Not for a job
/// whose row is still to be written.
///
/// # Errors
/// When rows or blobs cannot be read or removed.
pub async fn tidy_job(rows: &dyn Rows, blobs: &dyn Blobs, id: Uuid) -> StoreResult<()> {
    let Some(BlobOwner { state, lease_token, upload_removed }) = rows.blob_owner(id).await? else {
        return blobs.delete_job(id).await;
    };
    if upload_removed {
        blobs.delete_upload(id).await?;
    }
    let first_kept = match state {
        // only the results of this lease were, or may yet be, published
        JobState::Succeeded | JobState::Running => lease_token,
        JobState::Queued | JobState::Failed | JobState::Cancelled => lease_token.saturating_add(1),
    };
    blobs.delete_stale_results(id, first_kept).await
}
