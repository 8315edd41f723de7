//! From a zip on the disk to a job: the one way for zips that came in a request, in pieces, or lie in the store.
//!
//! The zip is inspected and checked against what is asked, becomes a blob, and then the job becomes a row. A crash
//! between the last two leaves a blob without a job, which the clean-up removes.

use std::path::PathBuf;

use uuid::Uuid;

use super::{admission::queue_full, idempotency, order::Order, quota::over_quota};
use crate::{
    contract::{Fault, request::Upload},
    http::{
        background,
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::{Enqueue, Job, NewJob, blobs::upload_key},
};
use pinstack_science::{
    archive,
    types::{Warning, stack_layout::StackLayout},
};

/// A zip on the disk that is to become a job.
#[derive(Debug)]
pub struct Submission {
    /// Id of the job, UUIDv7.
    pub id: Uuid,
    /// The zip: on the file system of the blobs. When it was published, it has moved.
    pub file: PathBuf,
    /// True when `file` is the blob of this job already.
    pub is_published: bool,
    /// Size of the zip.
    pub bytes: u64,
    /// SHA-256 of the zip, hex.
    pub sha256: String,
    /// Name that the client gave.
    pub filename: Option<String>,
    /// How it came.
    pub origin: Origin,
}

/// How a zip came.
#[derive(Debug)]
pub enum Origin {
    /// In this request, or it was in the store before it.
    Request {
        /// The token of the request.
        owner: Option<Uuid>,
        /// The `Idempotency-Key` and the fingerprint of the request.
        idempotency: Option<(String, String)>,
    },
    /// As the resumable upload of the same id; its row says whose it is.
    ResumableUpload,
}

/// A job that the client may hear of.
#[derive(Debug)]
pub struct Submitted {
    /// The job.
    pub job: Job,
    /// True when an earlier request made it.
    pub replayed: bool,
}

/// Makes the job that `order` asks for of a zip on the disk. On an error there is no job; what was published of a
/// request is removed again.
///
/// # Errors
/// What is wrong with the zip, or that it does not fit the order; `queue_full`, `idempotency_key_reused`;
/// `not_found` when the resumable upload is gone; `insufficient_storage`.
pub async fn submit<O: Order>(app: &App, order: O, submission: Submission) -> ApiResult<Submitted> {
    let Submission { id, file, is_published, bytes, sha256, filename, origin } = submission;
    let (layout, mut warnings) = inspect(app, file.clone()).await?;
    warnings.extend(order.check(&layout)?);
    let key = upload_key(id);
    if !is_published {
        app.blobs.publish(&file, &key).await?;
    }
    let (rig, lens) = order.key();
    let (owner, idempotency) = match &origin {
        Origin::Request { owner, idempotency } => (*owner, idempotency.clone()),
        Origin::ResumableUpload => (None, None),
    };
    let job = NewJob {
        id,
        rig: rig.clone(),
        lens: lens.clone(),
        request: order.request(Upload { key, bytes, sha256, filename }, layout),
        warnings,
        idempotency,
        owner,
    };
    // an error here does not say whether the row was stored: the sweep decides about the blob
    let stored = match &origin {
        Origin::Request { .. } => Some(app.rows.enqueue(&job, app.policy.queue_limit).await?),
        Origin::ResumableUpload => app.rows.complete_upload(&job, app.policy.queue_limit).await?,
    };
    let outcome = match stored {
        Some(Enqueue::Accepted(job)) => return Ok(Submitted { job: *job, replayed: false }),
        Some(Enqueue::Repeated(job)) => Ok(Submitted { job: *job, replayed: true }),
        Some(Enqueue::KeyReused) => {
            Err(idempotency::reused(job.idempotency.as_ref().map_or("", |(key, _)| key.as_str())))
        }
        Some(Enqueue::QueueFull { waiting }) => Err(queue_full(waiting)),
        Some(Enqueue::OverQuota(over)) => Err(over_quota(bytes, &over)),
        None => Err(crate::http::uploads::hold::unknown(id)),
    };
    match origin {
        Origin::Request { .. } => {
            if let Err(error) = app.blobs.delete_job(id).await {
                tracing::warn!(%error, %id, "a blob without a job is left for the sweep");
            }
        }
        // all bytes are here: the job can be made when the client asks again
        Origin::ResumableUpload => {}
    }
    outcome
}

/// What the directory of a zip and the headers of its pictures tell.
async fn inspect(app: &App, file: PathBuf) -> ApiResult<(StackLayout, Vec<Warning>)> {
    let limits = app.policy.archive;
    let _turn = app.looks.acquire().await.map_err(ApiError::internal)?;
    let inspected = background::spawn_blocking(move || -> Result<_, Fault> {
        // the client waits: what takes long to look at is looked at in the job
        let archive = archive::open_near(&file, &limits)?;
        Ok((archive.layout().clone(), archive.warnings().to_vec()))
    });
    Ok(inspected.await.map_err(ApiError::internal)??)
}
