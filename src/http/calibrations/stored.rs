//! A calibration from stacks that are stored: the body names them, or a scan, instead of sending their pictures.
//!
//! The calibration keeps the zip of the first stack, which it shares with that stack. The zips of the others are found
//! by the ids of their stacks when the job runs, so nothing is copied. A stack whose zip is gone by then fails the job.

use axum::response::Response;
use serde::Deserialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::{
    contract::{
        Code, Fault, JobKind, JobState, Name,
        input::SliceOrder,
        request::{JobRequest, StackRequest, StoredStack},
    },
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        extract::{Sent, json},
        ingest::{
            admission::require_admissible,
            fields::Fields,
            request::IngestRequest,
            submission::{Submission, calibration::CalibrationSubmission},
        },
        job_resource::{load, not_found},
        scans::{self, table},
        stacks::rerun::stored_zip,
    },
    store::Job,
};

/// Most stacks of a calibration: each is an open file of the job.
const MOST: usize = 100;

/// The stored stacks of a calibration: either `stacks` or `scan`.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StoredStacks {
    /// Ids of 1 to 100 stacks of one rig with equal numbers and sizes of slices. Of stacks with the same zip, such as
    /// reruns, one counts.
    #[serde(default)]
    #[schema(min_items = 1, max_items = 100)]
    stacks: Option<Vec<Uuid>>,
    /// A scan: all views that did not fail and whose zips are stored; of more than 100 views a part, evenly spread.
    #[serde(default)]
    scan: Option<Name>,
}

/// Makes a calibration from the stored stacks that the body names.
///
/// # Errors
/// `invalid_request`; `not_found` and `scan_not_found`; `upload_removed`; `size_mismatch`; `slice_count_mismatch`; what
/// every submission refuses.
pub async fn create(app: &App, caller: &Caller, fields: &Fields, sent: Sent) -> ApiResult<Response> {
    let submission = CalibrationSubmission::read(app, fields).await?;
    if !submission.is_by_stacks() {
        let detail = "the body is JSON, which names stored stacks of objects: add source=stacks to the URL, or send the zip of \
                      a dot target as application/zip";
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    let named = json::read(app, &sent.headers, sent.body).await?;
    let jobs = named_jobs(app, caller, json::parse(&named, Code::InvalidRequest)?).await?;
    let (first, stacks) = checked(&jobs, fields.get("rig").unwrap_or_default())?;
    let submission = Submission::Calibration(Box::new(submission.with_stacks(stacks)));
    let request = IngestRequest::begin(app, caller, &sent.headers).await?;
    if !request.key.is_repeat {
        require_admissible(app, caller, 0, 0).await?;
    }
    let zip = stored_zip(app, first).await?;
    let calibration = request.submit(submission, zip).await?;
    request.answer(calibration).await
}

/// The stacks that the body names, in its order, or those of the scan.
async fn named_jobs(app: &App, caller: &Caller, named: StoredStacks) -> ApiResult<Vec<Job>> {
    let ids = match (named.stacks, named.scan) {
        (Some(ids), None) if (1..=MOST).contains(&ids.len()) => ids,
        (None, Some(scan)) => return of_scan(app, caller, &scan).await,
        _ => {
            let detail =
                format!("the body needs either stacks, with the ids of 1 to {MOST} stacks, or scan, with its name");
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
    };
    let mut jobs = Vec::with_capacity(ids.len());
    for id in ids {
        let owner = app.store.metadata.owner(id).await?;
        if caller.sees_only(app).is_some_and(|own| owner.is_some_and(|owner| owner != own)) {
            return Err(not_found(id, JobKind::Stack));
        }
        let job = load(app, id, JobKind::Stack).await?;
        if job.upload_removed {
            let detail = format!(
                "the pictures of the stack {id} were removed at the end of their retention period (keep_uploads_days of the \
                 server); leave it out, or send its pictures"
            );
            return Err(ApiError::new(Code::UploadRemoved, detail));
        }
        jobs.push(job);
    }
    Ok(jobs)
}

async fn of_scan(app: &App, caller: &Caller, name: &Name) -> ApiResult<Vec<Job>> {
    scans::find(app, caller, name).await?;
    let mut views = table::views(app, caller, name).await?;
    views.retain(|view| !view.stack.upload_removed && view.stack.state != JobState::Failed);
    let mut jobs = Vec::new();
    for view in views.iter().step_by(views.len().div_ceil(MOST).max(1)) {
        // deleted since the list was read
        jobs.extend(app.store.metadata.job(view.stack.id).await?);
    }
    if jobs.is_empty() {
        let detail = format!(
            "the scan '{name}' has no view whose pictures are stored: they were not sent, or were removed at the end of their \
             retention period (keep_uploads_days of the server); send the pictures"
        );
        return Err(ApiError::new(Code::UploadRemoved, detail));
    }
    Ok(jobs)
}

/// The first stack, and what the job needs to know of all of them: each zip once.
fn checked<'a>(jobs: &'a [Job], rig: &str) -> ApiResult<(&'a Job, Vec<StoredStack>)> {
    let mut stacks: Vec<StoredStack> = Vec::with_capacity(jobs.len());
    let mut known: Vec<(&Job, &StackRequest)> = Vec::with_capacity(jobs.len());
    for job in jobs {
        let JobRequest::Stack(request) = &job.request else { return Err(not_found(job.id, JobKind::Stack)) };
        if job.rig.as_str() != rig {
            let detail = format!(
                "the stack {} is of rig '{}', not of rig '{rig}': leave it out, or correct the rig",
                job.id, job.rig
            );
            return Err(ApiError::new(Code::InvalidRequest, detail));
        }
        if known.iter().any(|(_, other)| other.upload.sha256 == request.upload.sha256) {
            continue;
        }
        if let Some(fault) = known.first().and_then(|(first, of_first)| unlike(first, of_first, job, request)) {
            return Err(fault.into());
        }
        let reversed = request.options.order == SliceOrder::Reverse;
        stacks.push(StoredStack { id: job.id, bytes: request.upload.bytes, reversed });
        known.push((job, request));
    }
    let (first, _) = known.first().ok_or_else(|| ApiError::internal("a calibration of stored stacks has none"))?;
    Ok((first, stacks))
}

/// How the slices of a stack differ from those of the first.
fn unlike(first: &Job, of_first: &StackRequest, job: &Job, request: &StackRequest) -> Option<Fault> {
    let shape = |request: &StackRequest| {
        let layout = &request.layout;
        (layout.front.len(), (layout.width, layout.height, layout.orientation))
    };
    let ((count, size), (other_count, other_size)) = (shape(of_first), shape(request));
    let code = match (count == other_count, size == other_size) {
        (true, true) => return None,
        (_, false) => Code::SizeMismatch,
        (false, true) => Code::SliceCountMismatch,
    };
    let told = |count: usize, (width, height, tag): (u32, u32, u8)| {
        format!("{count} slices of {width} x {height} px with the orientation tag {tag}")
    };
    let detail = format!(
        "the stack {} has {}, and the stack {} has {}: all stacks of a calibration need the same; leave out those that differ",
        job.id,
        told(other_count, other_size),
        first.id,
        told(count, size)
    );
    Some(Fault::new(code, detail))
}
