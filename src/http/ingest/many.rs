//! Several jobs from one request: all of them are made, or none.
//!
//! Every zip is checked before the first one becomes a blob, and all rows are written in one transaction. A crash
//! before that leaves blobs without jobs, which garbage collection removes.

use std::time::Instant;

use uuid::Uuid;

use super::{
    spool::SpooledZip,
    submission::Submission,
    submit::{checked, refusal, remove_blob, require_stored_in_time},
};
use crate::{
    contract::{Code, request::Upload},
    http::{ApiError, ApiResult, App, uploads::lock::not_found},
    store::{Enqueue, EnqueueAll, Job, NewJob, SpoolFile, blobs::upload_key},
    telemetry::traces,
};

/// A job whose zip is checked and not yet stored.
pub struct CheckedJob {
    job: NewJob,
    file: SpoolFile,
}

/// Who makes the jobs.
pub enum ManyOrigin {
    /// A request of this token.
    Request(Option<Uuid>),
    /// The resumable upload with this id. Its row knows the owner.
    ResumableUpload(Uuid),
}

/// Requires places in the queue for all views of a scan, before anything is written. The transaction of [`submit_all`]
/// checks it again.
///
/// # Errors
/// `queue_full`, which tells clients to try again later; `impossible` when the scan has more views than may ever be
/// queued: to raise the limit helps then, or `instead`.
pub async fn require_queue_places(app: &App, views: usize, impossible: Code, instead: &str) -> ApiResult<()> {
    let limit = app.policy.queue_limit;
    if views as u64 > limit {
        let detail = format!(
            "the scan has {views} views, and at most {limit} jobs may be queued: raise the setting 'queue_limit', or \
             {instead}"
        );
        return Err(ApiError::new(impossible, detail));
    }
    let waiting = app.store.metadata.counts().await?.queued;
    if waiting.saturating_add(views as u64) > limit {
        let detail = format!(
            "the scan has {views} views, {waiting} jobs are waiting, and at most {limit} may be queued; try again later"
        );
        return Err(ApiError::new(Code::QueueFull, detail));
    }
    Ok(())
}

/// Checks one zip against its submission.
///
/// # Errors
/// What is wrong with the zip, or that it does not match the submission.
pub async fn check(
    app: &App,
    submission: &Submission,
    zip: SpooledZip,
    idempotency: Option<(String, String)>,
) -> ApiResult<CheckedJob> {
    let id = Uuid::now_v7();
    let SpooledZip { file, bytes, sha256, filename, .. } = zip;
    let upload = Upload { key: upload_key(id), bytes, sha256, filename };
    let (request, warnings) = checked(app, submission, &file.open().await?, upload).await?;
    let (rig, lens) = submission.profile_key();
    let (rig, lens, trace) = (rig.clone(), lens.clone(), traces::for_the_row());
    let job = NewJob { id, rig, lens, request, warnings, idempotency, owner: None, trace };
    Ok(CheckedJob { job, file })
}

/// Stores the zips and makes the jobs, in the order given. If the jobs are refused, there are none, and the blobs are
/// removed. After an error of the store the rows may exist; garbage collection decides about the blobs.
///
/// # Errors
/// `queue_full`; `insufficient_storage`; `upload_too_large` when a request stores them too slowly; `conflict` when some
/// of the jobs were made before; `not_found` when a resumable upload was deleted meanwhile.
pub async fn submit_all(app: &App, checked: Vec<CheckedJob>, origin: ManyOrigin) -> ApiResult<Vec<Job>> {
    let bytes = checked.iter().map(|checked| checked.job.request.upload().bytes).sum();
    let key = checked.first().and_then(|first| first.job.idempotency.as_ref()).map(|(key, _)| key.clone());
    let mut jobs = Vec::with_capacity(checked.len());
    let begun = Instant::now();
    for CheckedJob { mut job, file } in checked {
        if let ManyOrigin::Request(owner) = origin {
            job.owner = owner;
        }
        let key = upload_key(job.id);
        let stored = traces::section("store upload", app.store.blobs.put(&key, file)).await;
        jobs.push(job);
        if let Err(error) = stored {
            remove_blobs(app, &jobs).await;
            return Err(error.into());
        }
    }
    if matches!(origin, ManyOrigin::Request(_))
        && let Err(late) = require_stored_in_time(app, begun)
    {
        remove_blobs(app, &jobs).await;
        return Err(late);
    }
    // an error here does not say whether the rows were stored: garbage collection decides about the blobs
    let limit = app.policy.queue_limit;
    let enqueuing = async {
        match origin {
            ManyOrigin::Request(_) => app.store.metadata.enqueue_all(&jobs, limit).await.map(Some),
            ManyOrigin::ResumableUpload(id) => app.store.metadata.complete_scan_upload(id, &jobs, limit).await,
        }
    };
    let enqueued = traces::section("enqueue", enqueuing).await?;
    let error = match (enqueued, origin) {
        (Some(EnqueueAll::Accepted(jobs)), _) => return Ok(jobs),
        (Some(EnqueueAll::Refused(Enqueue::Repeated(job))), _) => {
            let detail = format!(
                "some stacks of an earlier request with this Idempotency-Key still exist ({}), others were deleted; use a \
                 new key",
                job.id
            );
            ApiError::new(Code::Conflict, detail)
        }
        (Some(EnqueueAll::Refused(refused)), _) => refusal(refused, bytes, key.as_deref().unwrap_or_default()),
        (None, ManyOrigin::ResumableUpload(id)) => not_found(id),
        (None, ManyOrigin::Request(_)) => ApiError::internal("the jobs of a request were not enqueued"),
    };
    remove_blobs(app, &jobs).await;
    Err(error)
}

async fn remove_blobs(app: &App, jobs: &[NewJob]) {
    for job in jobs {
        remove_blob(app, job.id).await;
    }
}
