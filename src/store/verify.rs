//! Whether everything that rows name is there and is what it was: for the operator after a crash, a restored backup or a
//! disk that lied.

use std::{
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
};

use anyhow::Context;
use sha2::{Digest, Sha256};
use uuid::Uuid;

use super::{
    Job, JobFilter, MetadataStore, PageRequest, StoreResult,
    blobs::Blobs,
    digest::{hex, optics_digest, profile_digest},
};
use crate::contract::{JobState, profile::Profile};

/// Rows read at a time.
const PAGE: u32 = 200;

/// How closely to look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Files are there and as long as they should be.
    Sizes,
    /// Every byte is read and its digest compared.
    Digests,
}

/// What was found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Jobs looked at.
    pub jobs: usize,
    /// Files looked at.
    pub files: usize,
    /// Their bytes.
    pub bytes: u64,
    /// Revisions of profiles looked at.
    pub revisions: usize,
    /// Uploads that are still arriving.
    pub open_uploads: usize,
    /// Blobs that no row names: a clean-up removes them.
    pub orphans: usize,
    /// What is missing or not what it was: a sentence each.
    pub faults: Vec<String>,
    /// Rows that this version cannot read: a sentence each. All else is as it should be; they can be deleted.
    pub unreadable: Vec<String>,
}

/// Looks at all rows and all that they name. What changes meanwhile (a job that is deleted, say) is no fault.
///
/// # Errors
/// When rows or the list of blobs cannot be read at all.
pub async fn verify(rows: &dyn MetadataStore, blobs: &dyn Blobs, depth: Depth) -> StoreResult<Report> {
    let mut report = Report { faults: rows.integrity_errors().await?, ..Report::default() };
    every_revision(rows, &mut report).await?;
    let mut cursor = None;
    loop {
        let page = rows.jobs(&JobFilter::default(), &PageRequest { limit: PAGE, cursor }).await?;
        for job in &page.items {
            every_file(rows, blobs, job, depth, &mut report).await?;
        }
        report.jobs += page.skipped.len();
        report.unreadable.extend(page.skipped.iter().map(|row| format!("job {} cannot be read", row.id)));
        cursor = page.next_cursor;
        if cursor.is_none() {
            break;
        }
    }
    for id in rows.open_uploads().await? {
        open_upload(rows, blobs, id, &mut report).await?;
    }
    for job in blobs.jobs_with_blobs().await? {
        if rows.blob_owner(job.id).await?.is_none() && !rows.upload_is_open(job.id).await? {
            report.orphans += 1;
        }
    }
    Ok(report)
}

/// Every revision, of deleted profiles too: results name them.
async fn every_revision(rows: &dyn MetadataStore, report: &mut Report) -> StoreResult<()> {
    let mut cursor = None;
    loop {
        let page = rows.all_revisions(&PageRequest { limit: PAGE, cursor }).await?;
        for Profile { rig, lens, revision, digest, optics_digest: optics, input, .. } in &page.items {
            report.revisions += 1;
            if profile_digest(input) != *digest || optics_digest(input) != *optics {
                report.faults.push(format!("revision {revision} of profile {rig}/{lens} is not what its digest says"));
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

/// A file that a row names.
struct Named<'a> {
    what: &'a str,
    key: &'a str,
    bytes: u64,
    sha256: &'a str,
}

async fn every_file(
    rows: &dyn MetadataStore,
    blobs: &dyn Blobs,
    job: &Job,
    depth: Depth,
    report: &mut Report,
) -> StoreResult<()> {
    report.jobs += 1;
    let upload = job.request.upload();
    let upload = (!job.upload_removed).then(|| Named {
        what: "the upload",
        key: &upload.key,
        bytes: upload.bytes,
        sha256: &upload.sha256,
    });
    let results = job.outcome.as_ref().map(|outcome| outcome.artifacts()).unwrap_or_default();
    let results = results.iter().map(|a| Named { what: &a.name, key: &a.key, bytes: a.bytes, sha256: &a.sha256 });
    if job.state == JobState::Succeeded && job.outcome.is_none() {
        report.faults.push(format!("job {} succeeded and has no result", job.id));
    }
    for named in upload.into_iter().chain(results) {
        report.files += 1;
        report.bytes += named.bytes;
        let found = blobs.local_path(named.key).await?;
        let wrong = match found {
            None => Some("is not there".to_owned()),
            Some(path) => examine(path, &named, depth).await?,
        };
        let Some(wrong) = wrong else { continue };
        // deleted since its row was read: no fault
        if rows.job(job.id).await?.is_some_and(|now| now.upload_removed == job.upload_removed) {
            report.faults.push(format!("job {}: {} ({}) {wrong}", job.id, named.what, named.key));
        }
    }
    Ok(())
}

async fn examine(path: PathBuf, named: &Named<'_>, depth: Depth) -> StoreResult<Option<String>> {
    let (bytes, sha256) = (named.bytes, named.sha256.to_owned());
    let looked = tokio::task::spawn_blocking(move || look(&path, bytes, &sha256, depth));
    let looked = looked.await.context("the task that looks at a file died")?;
    Ok(looked.unwrap_or_else(|error| Some(format!("cannot be read: {error}"))))
}

fn look(path: &Path, bytes: u64, sha256: &str, depth: Depth) -> io::Result<Option<String>> {
    let length = path.metadata()?.len();
    if length != bytes {
        return Ok(Some(format!("has {length} bytes instead of {bytes}")));
    }
    if depth == Depth::Sizes {
        return Ok(None);
    }
    let found = digest_of(path, length)?;
    Ok((found != sha256).then(|| format!("has digest {found} instead of {sha256}: its bytes have changed")))
}

/// SHA-256 of the first `length` bytes of a file, hex.
///
/// # Errors
/// When the file cannot be read, or is shorter.
pub fn digest_of(path: &Path, length: u64) -> io::Result<String> {
    let mut file = File::open(path)?.take(length);
    let mut hash = Sha256::new();
    let mut block = vec![0; 1 << 20];
    let mut seen = 0;
    loop {
        let read = file.read(&mut block)?;
        if read == 0 {
            break;
        }
        hash.update(block.get(..read).unwrap_or_default());
        seen += read as u64;
    }
    if seen < length { Err(io::ErrorKind::UnexpectedEof.into()) } else { Ok(hex(&hash.finalize())) }
}

/// The bytes that a client was told are here.
async fn open_upload(rows: &dyn MetadataStore, blobs: &dyn Blobs, id: Uuid, report: &mut Report) -> StoreResult<()> {
    report.open_uploads += 1;
    // held by a request: it is at work on it, and knows better
    let Some(partial) = blobs.hold_partial(id).await? else { return Ok(()) };
    let Some(upload) = rows.upload(id).await? else { return Ok(()) };
    let there = partial.path().metadata().map(|m| m.len()).unwrap_or(0);
    let is_whole = upload.offset == upload.length;
    let is_published = is_whole && blobs.local_path(&super::blobs::upload_key(id)).await?.is_some();
    if there < upload.offset && !is_published {
        report.faults.push(format!("upload {id} has {there} bytes, and its client was told {}", upload.offset));
    }
    Ok(())
}
