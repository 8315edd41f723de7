//! From a zip on the disk to a queued job. This is the only way, for zips that came in one request, in pieces, or are
//! stored already.
//!
//! 1. The zip is inspected and checked against the submission.
//! 2. The file becomes a blob.
//! 3. The job becomes a row.
//!
//! A crash between 2 and 3 leaves a blob without a job, which garbage collection removes.

use std::time::Instant;

use uuid::Uuid;

use super::{admission::queue_full, idempotency, quota::over_quota, submission::Submission};
use crate::{
    contract::{
        Code, Fault,
        request::{JobRequest, Upload},
    },
    http::{ApiError, ApiResult, App, uploads::lock::not_found},
    store::{
        Enqueue, Job, NewJob, SpoolFile,
        blobs::{OpenBlob, upload_key},
        gc::delete_blobs,
    },
    telemetry::traces,
};
use pinstack_science::{
    archive,
    types::{Warning, stack_layout::StackLayout},
};

/// A zip on the disk that is to become a job.
#[derive(Debug)]
pub struct IncomingZip {
    /// Id of the job, UUIDv7.
    pub id: Uuid,
    /// The zip.
    pub file: ZipFile,
    /// Size, bytes.
    pub bytes: u64,
    /// SHA-256, hex.
    pub sha256: String,
    /// File name that the client gave.
    pub filename: Option<String>,
    /// How it arrived.
    pub origin: Origin,
}

/// Where a zip is.
#[derive(Debug)]
pub enum ZipFile {
    /// In a spool file, which is to become the blob of the job.
    Spooled(SpoolFile),
    /// It is the blob of the job already.
    Stored(OpenBlob),
}

/// How a zip arrived.
#[derive(Debug)]
pub enum Origin {
    /// In this request, or it was stored before.
    Request {
        /// The token of the request.
        owner: Option<Uuid>,
        /// The `Idempotency-Key` and the fingerprint of the request.
        idempotency: Option<(String, String)>,
    },
    /// As the resumable upload with the id of the job. The row of the upload knows the owner.
    ResumableUpload,
}

/// A job that can be shown to the client.
#[derive(Debug)]
pub struct Submitted {
    /// The job.
    pub job: Job,
    /// True when an earlier request made it.
    pub replayed: bool,
}

/// Makes the job of a submission from a zip on the disk. If the job is refused, there is no job, and the blob of a zip
/// that came in a request is removed. After an error of the store the row may exist; garbage collection decides about
/// the blob.
///
/// # Errors
/// What is wrong with the zip, or that it does not match the submission; `queue_full`; `idempotency_key_reused`;
/// `insufficient_storage`; `upload_too_large` when a request stores the zip too slowly; `not_found` when a resumable
/// upload was deleted meanwhile.
pub async fn submit(app: &App, submission: &Submission, zip: IncomingZip) -> ApiResult<Submitted> {
    let IncomingZip { id, file, bytes, sha256, filename, origin } = zip;
    let key = upload_key(id);
    let upload = Upload { key: key.clone(), bytes, sha256, filename };
    let (request, warnings) = match &file {
        ZipFile::Spooled(file) => checked(app, submission, &file.open().await?, upload).await?,
        ZipFile::Stored(blob) => checked(app, submission, blob, upload).await?,
    };
    if let ZipFile::Spooled(file) = file {
        let begun = Instant::now();
        traces::section("store upload", app.store.blobs.put(&key, file)).await?;
        if matches!(origin, Origin::Request { .. })
            && let Err(late) = require_stored_in_time(app, begun)
        {
            remove_blob(app, id).await;
            return Err(late);
        }
    }
    let (rig, lens) = submission.profile_key();
    let (owner, idempotency) = match &origin {
        Origin::Request { owner, idempotency } => (*owner, idempotency.clone()),
        Origin::ResumableUpload => (None, None),
    };
    let (rig, lens, trace) = (rig.clone(), lens.clone(), traces::for_the_row());
    let job = NewJob { id, rig, lens, request, warnings, idempotency, owner, trace };
    // an error here does not say whether the row was stored: garbage collection decides about the blob
    let enqueuing = async {
        match &origin {
            Origin::Request { .. } => app.store.metadata.enqueue(&job, app.policy.queue_limit).await.map(Some),
            Origin::ResumableUpload => app.store.metadata.complete_upload(&job, app.policy.queue_limit).await,
        }
    };
    let stored = traces::section("enqueue", enqueuing).await?;
    let outcome = match stored {
        Some(Enqueue::Accepted(job)) => return Ok(Submitted { job: *job, replayed: false }),
        Some(Enqueue::Repeated(job)) => Ok(Submitted { job: *job, replayed: true }),
        Some(refused) => Err(refusal(refused, bytes, job.idempotency.as_ref().map_or("", |(key, _)| key.as_str()))),
        None => Err(not_found(id)),
    };
    match origin {
        Origin::Request { .. } => remove_blob(app, id).await,
        // all bytes are kept: the job can be made when the client asks again
        Origin::ResumableUpload => {}
    }
    outcome
}

/// Requires that the blobs of a request were stored so fast that garbage collection has taken none of them for a
/// leftover. `begun`: before the first one.
///
/// # Errors
/// `upload_too_large`: only a resumable upload may take longer.
pub fn require_stored_in_time(app: &App, begun: Instant) -> ApiResult<()> {
    let most = app.policy.most_storing;
    if begun.elapsed() <= most {
        return Ok(());
    }
    let detail = format!(
        "storing the zip took longer than {} minutes, the limit for one request; send it as a resumable upload (POST \
         /v1/uploads), which has no such limit",
        most.as_secs() / 60
    );
    Err(ApiError::new(Code::UploadTooLarge, detail))
}

/// Removes the blobs of a job that was not made.
pub async fn remove_blob(app: &App, id: Uuid) {
    if let Err(error) = delete_blobs(&*app.store.blobs, id).await {
        tracing::warn!(%error, %id, "a blob without a job is left to garbage collection");
    }
}

/// Inspects a zip and builds the request of its job.
///
/// # Errors
/// What is wrong with the zip, or that it does not match the submission; `unavailable` when the storage does not send
/// it.
pub async fn checked(
    app: &App,
    submission: &Submission,
    zip: &OpenBlob,
    upload: Upload,
) -> ApiResult<(JobRequest, Vec<Warning>)> {
    let (layout, mut warnings) =
        traces::section("inspect archive", inspect(app, zip, submission.may_be_scan())).await?;
    let (request, more_warnings) = submission.to_request(upload, layout)?;
    warnings.extend(more_warnings);
    Ok((request, warnings))
}

/// The error for a job that was not accepted.
pub fn refusal(refused: Enqueue, bytes: u64, key: &str) -> ApiError {
    match refused {
        Enqueue::KeyReused => idempotency::reused(key),
        Enqueue::QueueFull { waiting } => queue_full(waiting),
        Enqueue::OverQuota(over) => over_quota(bytes, &over),
        Enqueue::NoSuchScan(scan) => {
            let detail = format!(
                "the scan '{scan}' was deleted, or its rig or lens was changed, while the request was processed; \
                 create it again with PUT /v1/scans/{scan}, then repeat the request; for a resumable upload, whose bytes \
                 are kept, HEAD is enough"
            );
            ApiError::new(Code::ScanNotFound, detail)
        }
        Enqueue::Accepted(_) | Enqueue::Repeated(_) => {
            ApiError::internal("an accepted job was taken for a refused one")
        }
    }
}

/// Reads the directory of a zip and the headers of its images; of a scan those of the first view.
async fn inspect(app: &App, zip: &OpenBlob, may_be_scan: bool) -> ApiResult<(StackLayout, Vec<Warning>)> {
    let (limits, bytes) = (app.policy.archive, zip.bytes());
    let inspected = app.inspect(move || -> Result<_, Fault> {
        // the client waits: whatever takes long to check is checked by the job
        let open = if may_be_scan { archive::open_first_near } else { archive::open_near };
        let archive = open(bytes, &limits)?;
        Ok((archive.layout().clone(), archive.warnings().to_vec()))
    });
    let inspected = inspected.await?;
    // it is not the zip that is wrong
    if inspected.is_err()
        && let Some(error) = zip.failure()
    {
        return Err(error.into());
    }
    Ok(inspected?)
}
