//! What the endpoints of all kinds of jobs have in common: a job of one kind, found by its id.

use axum::{
    Json,
    http::{HeaderMap, StatusCode, Uri},
    response::Response,
};
use uuid::Uuid;

use super::{
    ApiError, ApiResult, App,
    auth::Caller,
    extract::{PageQuery, params, prefer},
    log, sse,
    views::JobDocument,
    waiting::until_final,
};
use crate::{
    contract::{Code, JobKind, JobState},
    store::{CancelRequest, Job, JobFilter, Page, gc::gc_job},
};

/// A page of jobs. Stacks and reconstructions that other tokens sent are left out where tokens see only their own;
/// calibrations belong to a rig and not to a token.
///
/// # Errors
/// `invalid_request` for an unknown parameter, or a value outside its range.
pub async fn list(app: &App, caller: &Caller, uri: &Uri, kind: JobKind) -> ApiResult<Page<Job>> {
    let mut pairs = params::pairs(uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let owner = if kind == JobKind::Calibration { None } else { caller.sees_only(app) };
    let filter = JobFilter { owner, ..params::job_filter(kind, &pairs)? };
    Ok(app.store.metadata.jobs(&filter, &page).await?)
}

/// Shows a job. With `Prefer: wait=N` the response is sent when the job has ended, after N seconds at the latest.
///
/// # Errors
/// `not_found`.
pub async fn get(app: &App, id: Uuid, kind: JobKind, headers: &HeaderMap) -> ApiResult<Json<JobDocument>> {
    let mut job = load(app, id, kind).await?;
    if let Some(wait) = prefer::wait(headers) {
        job = until_final(app, id, wait).await?.unwrap_or(job);
    }
    Ok(Json(JobDocument::of(&job)))
}

/// Streams the events of a job.
///
/// # Errors
/// `not_found`.
pub async fn events(app: &App, id: Uuid, kind: JobKind, headers: &HeaderMap) -> ApiResult<Response> {
    let job = load(app, id, kind).await?;
    Ok(sse::answer(app, headers, job))
}

/// Cancels a job: a waiting one now, a running one when its worker sees the request. Cancelling twice is no error.
///
/// # Errors
/// `not_found`; `conflict` when the job succeeded or failed before.
pub async fn cancel(app: &App, id: Uuid, kind: JobKind) -> ApiResult<(StatusCode, Json<JobDocument>)> {
    load(app, id, kind).await?;
    if let Some(CancelRequest::AlreadyEnded(state)) = app.store.metadata.cancel(id).await?
        && state != JobState::Cancelled
    {
        let detail = format!("the {} has already {}, so it cannot be cancelled", kind.as_str(), state.as_str());
        return Err(ApiError::new(Code::Conflict, detail));
    }
    let job = load(app, id, kind).await?;
    Ok((StatusCode::ACCEPTED, Json(JobDocument::of(&job))))
}

/// Deletes a job with its upload and results. A running job is cancelled first.
///
/// # Errors
/// `not_found`.
pub async fn delete(app: &App, id: Uuid, kind: JobKind) -> ApiResult<StatusCode> {
    require(app, id, kind).await?;
    app.store.metadata.delete_job(id).await?;
    // the worker of a running job removes its blobs; what remains here is left to garbage collection
    if let Err(error) = gc_job(&app.store, id).await {
        tracing::warn!(%error, %id, "blobs of a deleted job are left to garbage collection");
    }
    app.conversions.forget_deleted().await;
    Ok(StatusCode::NO_CONTENT)
}

/// Deletes a stack or reconstruction of a scan that is deleted. No error when it is gone already.
///
/// # Errors
/// When the store cannot be written.
pub async fn delete_job_of_scan(app: &App, id: Uuid, kind: JobKind) -> ApiResult<()> {
    match delete(app, id, kind).await {
        Err(error) if error.fault().code != Code::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// The job with this id. Its rig and lens are noted in the log lines of the request.
///
/// # Errors
/// `not_found` when there is no job of this kind with this id.
pub async fn load(app: &App, id: Uuid, kind: JobKind) -> ApiResult<Job> {
    let job = app.store.metadata.job(id).await?.filter(|job| job.request.kind() == kind);
    let job = job.ok_or_else(|| not_found(id, kind))?;
    log::note("rig", &job.rig);
    log::note("lens", &job.lens);
    Ok(job)
}

/// Checks that the job exists without parsing its row, so that a damaged row can be deleted.
async fn require(app: &App, id: Uuid, kind: JobKind) -> ApiResult<()> {
    let found = app.store.metadata.job_kind(id).await?.filter(|of| *of == kind);
    found.map(|_| ()).ok_or_else(|| not_found(id, kind))
}

/// The error for a job that does not exist, or is of another kind.
pub fn not_found(id: Uuid, kind: JobKind) -> ApiError {
    ApiError::new(Code::NotFound, format!("there is no {} {id}", kind.as_str()))
}
