//! Garbage collection: removes every blob that no row refers to, and nothing else.
//!
//! | job | its upload | its results |
//! |---|---|---|
//! | queued, failed, cancelled | kept | removed |
//! | running | kept | kept from the current lease on; those of older leases are removed |
//! | succeeded | kept until its retention time expires | kept (those of the lease that published) |
//! | no row | removed after [`GRACE`], but not while a scan may be stored | removed after [`GRACE`] |
//!
//! | resumable upload | its parts |
//! |---|---|
//! | open: waits for bytes or for its job | kept until it expires |
//! | complete, refused, expired or deleted | removed |
//!
//! Safe beside running servers and other collections: a row is written after its blobs, within [`MOST_STORING`] or
//! while the row of its upload is open; it is removed before them, and read directly before they are removed.

use std::{
    collections::{BTreeMap, BTreeSet},
    time::{Duration, SystemTime},
};

use futures::TryStreamExt;
use uuid::Uuid;

use super::{
    BlobOwner, BlobStore, Retention, Store, StoreResult,
    blobs::{RESULTS, UPLOADS, job_of_key, results_prefix, upload_key},
    uploads::ExpiredUpload,
};
use crate::contract::JobState;

/// Minimum age of blobs without a row before they are removed: an upload is stored before its row is written.
pub const GRACE: Duration = Duration::from_secs(60 * 60);
/// Longest time from the first blob that a request stores to the row of its job: [`GRACE`], less what clocks may
/// differ. A resumable upload may take longer, because its own row protects its blobs.
pub const MOST_STORING: Duration = Duration::from_secs(50 * 60);
/// How much the clocks of the database and of the bucket or file server may differ.
const CLOCKS_DIFFER: Duration = Duration::from_secs(10 * 60);

/// What a collection removed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Removed {
    /// Expired jobs.
    pub expired: usize,
    /// Jobs without a row that had blobs.
    pub orphans: usize,
    /// Resumable uploads that expired while they waited for bytes or for their job.
    pub given_up: usize,
    /// Expired zips of jobs whose results are kept.
    pub uploads: usize,
}

/// Removes expired jobs and uploads, the blobs of jobs without a row that are older than `grace`, and results that were
/// never published.
///
/// # Errors
/// When metadata or blobs cannot be read or removed. What was removed until then stays removed; the next collection
/// continues.
pub async fn collect(store: &Store, grace: Duration, keep: &Retention) -> StoreResult<Removed> {
    let Store { metadata, blobs, parts, .. } = store;
    let mut removed = Removed::default();
    // some rows at a time, so that a full disk has their space before the next rows are written
    loop {
        let expired = metadata.delete_expired_jobs(keep).await?;
        if expired.is_empty() {
            break;
        }
        for id in expired {
            delete_blobs(&**blobs, id).await?;
            removed.expired += 1;
        }
    }
    loop {
        let expired = metadata.expire_job_uploads(keep).await?;
        if expired.is_empty() {
            break;
        }
        for id in expired {
            blobs.delete(&upload_key(id)).await?;
            removed.uploads += 1;
        }
    }
    for ExpiredUpload { id, was_open } in metadata.delete_expired_uploads().await? {
        gc_upload(store, id).await?;
        removed.given_up += usize::from(was_open);
    }
    for id in parts.list().await? {
        gc_upload(store, id).await?;
    }
    let now = SystemTime::now();
    let with_blobs = jobs_with_blobs(&**blobs).await?;
    // the zips of a scan are stored one after the other, and the rows of its stacks are written together at the end,
    // which may be much later; read after the list, so that what is not being stored any more has its rows
    let storing_since = metadata.storing_since().await?.map(SystemTime::from);
    let may_be_of_a_scan = |at: SystemTime| storing_since.is_some_and(|since| at + CLOCKS_DIFFER >= since);
    for (id, last_modified) in with_blobs {
        if metadata.upload_is_open(id).await? {
            // complete, and its job is about to be created
            continue;
        }
        if metadata.blob_owner(id).await?.is_some() {
            gc_job(store, id).await?;
        } else if now.duration_since(last_modified).unwrap_or_default() >= grace && !may_be_of_a_scan(last_modified) {
            delete_blobs(&**blobs, id).await?;
            removed.orphans += 1;
        }
    }
    blobs.remove_leftovers().await?;
    Ok(removed)
}

/// The jobs that have blobs, each with the time at which the latest of them was stored.
///
/// # Errors
/// When the blobs cannot be listed.
pub async fn jobs_with_blobs(blobs: &dyn BlobStore) -> StoreResult<BTreeMap<Uuid, SystemTime>> {
    let mut jobs = BTreeMap::new();
    for prefix in [UPLOADS, RESULTS] {
        let mut listed = blobs.list(prefix);
        while let Some(blob) = listed.try_next().await? {
            let Some(id) = job_of_key(&blob.key) else { continue };
            let latest = jobs.entry(id).or_insert(blob.last_modified);
            *latest = blob.last_modified.max(*latest);
        }
    }
    Ok(jobs)
}

/// Removes every blob of a job.
///
/// # Errors
/// When a blob cannot be removed.
pub async fn delete_blobs(blobs: &dyn BlobStore, id: Uuid) -> StoreResult<()> {
    blobs.delete_prefix(&results_prefix(id)).await?;
    blobs.delete(&upload_key(id)).await
}

/// Removes the bytes of a resumable upload that is not open any more. No grace is needed, because its row is written
/// before its bytes. The blobs of the job that it became are kept.
///
/// # Errors
/// When metadata or blobs cannot be read or removed.
pub async fn gc_upload(store: &Store, id: Uuid) -> StoreResult<()> {
    if store.metadata.upload_is_open(id).await? {
        return Ok(());
    }
    store.parts.remove(id).await?;
    if store.metadata.blob_owner(id).await?.is_none() {
        delete_blobs(&*store.blobs, id).await?;
    }
    Ok(())
}

/// Removes the blobs of one job that its row does not refer to: after the job ended, and after it was deleted. Not for
/// a job whose row is still to be written.
///
/// # Errors
/// When metadata or blobs cannot be read or removed.
pub async fn gc_job(store: &Store, id: Uuid) -> StoreResult<()> {
    let blobs = &*store.blobs;
    let Some(BlobOwner { state, lease_token, upload_removed }) = store.metadata.blob_owner(id).await? else {
        return delete_blobs(blobs, id).await;
    };
    if upload_removed {
        blobs.delete(&upload_key(id)).await?;
    }
    let first_kept = match state {
        // the results of this lease are published, or may still be
        JobState::Succeeded | JobState::Running => lease_token,
        JobState::Queued | JobState::Failed | JobState::Cancelled => lease_token.saturating_add(1),
    };
    delete_stale_results(blobs, id, first_kept).await
}

/// Removes the results of leases before `first_kept`. Those of later leases stay: a worker may have claimed the job
/// since the caller read its row.
pub(crate) async fn delete_stale_results(blobs: &dyn BlobStore, id: Uuid, first_kept: i64) -> StoreResult<()> {
    let prefix = results_prefix(id);
    let mut stale = BTreeSet::new();
    let mut listed = blobs.list(&prefix);
    while let Some(blob) = listed.try_next().await? {
        let lease = blob.key.strip_prefix(&prefix).and_then(|rest| rest.split('/').next()).unwrap_or_default();
        if lease.parse::<i64>().is_ok_and(|lease| lease < first_kept) {
            stale.insert(lease.to_owned());
        }
    }
    for lease in stale {
        blobs.delete_prefix(&format!("{prefix}{lease}/")).await?;
    }
    Ok(())
}
