//! Verification: whether every blob that a row refers to exists and is unchanged. For operators, after a crash, a
//! restored backup, or a disk error.

use anyhow::Context;
use uuid::Uuid;

use super::{
    Job, JobFilter, PageRequest, Store, StoreResult,
    blobs::upload_key,
    digest::{optics_digest, profile_digest, sha256_of_file},
    gc::jobs_with_blobs,
};
use crate::contract::{JobState, profile::Profile};

/// Rows that are read at a time.
const PAGE: u32 = 200;

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Existence and size of the blobs.
    Sizes,
    /// Their digests too: every byte is read.
    Digests,
}

/// Result of a verification.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Number of jobs.
    pub jobs: usize,
    /// Number of blobs that rows refer to.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Number of profile revisions.
    pub revisions: usize,
    /// Number of open uploads.
    pub open_uploads: usize,
    /// Number of jobs without a row that have blobs. Garbage collection removes these.
    pub orphans: usize,
    /// What is missing or changed, one sentence each.
    pub faults: Vec<String>,
    /// Rows that this version cannot read, one sentence each. Everything else of the store is unaffected; they can be
    /// deleted.
    pub unreadable: Vec<String>,
}

/// Compares all rows with the blobs that they refer to. A change during the verification, such as a deleted job, is not
/// a fault.
///
/// # Errors
/// When the metadata, or the list of blobs, cannot be read at all.
pub async fn verify(store: &Store, depth: Depth) -> StoreResult<Report> {
    let metadata = &store.metadata;
    let mut report = Report { faults: metadata.integrity_errors().await?, ..Report::default() };
    verify_revisions(store, &mut report).await?;
    let mut cursor = None;
    loop {
        let page = metadata.jobs(&JobFilter::default(), &PageRequest { limit: PAGE, cursor }).await?;
        for job in &page.items {
            verify_job(store, job, depth, &mut report).await?;
        }
        report.jobs += page.skipped.len();
        report.unreadable.extend(page.skipped.iter().map(|row| format!("job {} cannot be read", row.id)));
        cursor = page.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    for id in metadata.open_uploads().await? {
        verify_open_upload(store, id, &mut report).await?;
    }
    for (id, _) in jobs_with_blobs(&*store.blobs).await? {
        if metadata.blob_owner(id).await?.is_none() && !metadata.upload_is_open(id).await? {
            report.orphans += 1;
        }
    }
    Ok(report)
}

/// Verifies every revision, including those of deleted profiles: results refer to them.
async fn verify_revisions(store: &Store, report: &mut Report) -> StoreResult<()> {
    let mut cursor = None;
    loop {
        let page = store.metadata.all_revisions(&PageRequest { limit: PAGE, cursor }).await?;
        for Profile { rig, lens, revision, digest, optics_digest: optics, input, .. } in &page.items {
            report.revisions += 1;
            if profile_digest(input) != *digest || optics_digest(input) != *optics {
                report.faults.push(format!("revision {revision} of profile {rig}/{lens} does not match its digest"));
            }
        }
        report.revisions += page.skipped.len();
        report.unreadable.extend(page.skipped.iter().map(|row| format!("profile {} cannot be read", row.id)));
        cursor = page.next_cursor;
        if cursor.is_none() {
            return Ok(());
        }
    }
}

/// A blob that a row refers to.
struct Expected<'a> {
    what: &'a str,
    key: &'a str,
    bytes: u64,
    sha256: &'a str,
}

async fn verify_job(store: &Store, job: &Job, depth: Depth, report: &mut Report) -> StoreResult<()> {
    report.jobs += 1;
    let upload = job.request.own_upload().filter(|_| !job.upload_removed).map(|upload| Expected {
        what: "the upload",
        key: &upload.key,
        bytes: upload.bytes,
        sha256: &upload.sha256,
    });
    let results = job.outcome.as_ref().map(|outcome| outcome.artifacts()).unwrap_or_default();
    let results = results.iter().map(|a| Expected { what: &a.name, key: &a.key, bytes: a.bytes, sha256: &a.sha256 });
    if job.state == JobState::Succeeded && job.outcome.is_none() {
        report.faults.push(format!("job {} succeeded and has no result", job.id));
    }
    for expected in upload.into_iter().chain(results) {
        report.files += 1;
        report.bytes += expected.bytes;
        let Some(fault) = fault_of(store, &expected, depth).await? else { continue };
        // not a fault if it was deleted since its row was read
        if store.metadata.job(job.id).await?.is_some_and(|now| now.upload_removed == job.upload_removed) {
            report.faults.push(format!("job {}: {} ({}) {fault}", job.id, expected.what, expected.key));
        }
    }
    Ok(())
}

/// What is wrong with a blob, if anything.
async fn fault_of(store: &Store, expected: &Expected<'_>, depth: Depth) -> StoreResult<Option<String>> {
    let Some(found) = store.blobs.head(expected.key).await? else { return Ok(Some("is missing".to_owned())) };
    if found.size != expected.bytes {
        return Ok(Some(format!("has {} bytes instead of {}", found.size, expected.bytes)));
    }
    if depth == Depth::Sizes {
        return Ok(None);
    }
    let Some(blob) = store.blobs.fetch(expected.key, &store.workspace).await? else {
        return Ok(Some("is missing".to_owned()));
    };
    let hashed = tokio::task::spawn_blocking(move || sha256_of_file(blob.path()));
    Ok(match hashed.await.context("the task that hashes a file panicked")? {
        Err(error) => Some(format!("cannot be read: {error}")),
        Ok((_, sha256)) if sha256 == expected.sha256 => None,
        Ok((_, sha256)) => Some(format!("has digest {sha256} instead of {}: its bytes have changed", expected.sha256)),
    })
}

/// Verifies that the bytes of an open upload that were acknowledged to its client are stored.
async fn verify_open_upload(store: &Store, id: Uuid, report: &mut Report) -> StoreResult<()> {
    report.open_uploads += 1;
    // locked: a request is changing it
    let Some(parts) = store.parts.lock(id).await? else { return Ok(()) };
    let Some(upload) = store.metadata.upload(id).await? else { return Ok(()) };
    let stored = parts.length().await?;
    let is_whole = upload.offset == upload.length;
    let is_published = is_whole && store.blobs.head(&upload_key(id)).await?.is_some();
    if stored < upload.offset && !is_published {
        report
            .faults
            .push(format!("upload {id} has {stored} bytes, but {} were acknowledged to its client", upload.offset));
    }
    Ok(())
}
