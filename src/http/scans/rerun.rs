//! `POST /v1/scans/{scan}/rerun`

use axum::{Json, extract::State, http::StatusCode};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::{
    ScanName, find,
    table::{View, views},
};
use crate::{
    contract::{Code, JobKind, Name, request::JobRequest},
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        background,
        extract::Sent,
        ingest::{
            many::{CheckedJob, ManyOrigin, check, require_queue_places, submit_all},
            submission::Submission,
        },
        stacks::rerun::{changes, stored_zip, submission},
        views::job::{url, url_of},
    },
    store::Job,
};

/// Options that belong to one view.
const OF_ONE_VIEW: [&str; 4] = ["label", "scan", "pan_deg", "tilt_deg"];

/// The new stacks of a scan.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanRerun {
    /// The scan.
    pub scan: Name,
    /// The views that are fused again.
    pub views: Vec<RerunView>,
    /// The views that are not, and why.
    pub skipped: Vec<SkippedView>,
}

/// A view that is fused again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RerunView {
    /// Name of the view.
    pub name: String,
    /// URL of the new stack.
    pub stack: String,
    /// URL of the stack whose zip it uses.
    pub rerun_of: String,
}

/// A view that is not fused again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SkippedView {
    /// Name of the view.
    pub name: String,
    /// URL of its stack.
    pub stack: String,
    /// Why.
    pub detail: String,
}

/// Fuse every view of a scan again
///
/// Makes a new stack from the stored zip of each view, with other options or another revision of the profile; see `POST
/// /v1/stacks/{id}/rerun` for the body. The new stacks count for the scan from now on; the old ones are kept. File
/// names stay the same. Either all views are accepted or none, except views whose zip was removed at the end of its
/// retention period, which `skipped` lists.
#[utoipa::path(
    post,
    path = "/v1/scans/{scan}/rerun",
    operation_id = "rerun_scan",
    tag = "scans",
    params(("scan" = String, Path, description = "Name of the scan")),
    request_body(content = ref("#/components/schemas/RerunOptions"), content_type = "application/json", description = "The options to change; empty: none"),
    responses(
        (status = 202, description = "The new stacks are accepted", body = ScanRerun),
        (status = 400, description = "`invalid_request`: an invalid option, one that belongs to a single view, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`scan_not_found`; `not_found`: the scan has no views; `profile_not_found`: no such revision"),
        (status = 409, description = "`conflict`: the scan has more views than may be queued (setting `queue_limit` of the server)"),
        (status = 410, description = "`upload_removed`: the zips of all views were removed"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB, or storing the zip takes longer than 50 minutes, which only a resumable upload may take"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`size_mismatch`, `slice_count_mismatch`: a zip does not match the other revision; `mask_failed` (required without a back light)"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn rerun(
    State(app): State<App>,
    caller: Caller,
    ScanName(name): ScanName,
    sent: Sent,
) -> ApiResult<(StatusCode, Json<ScanRerun>)> {
    sent.refuse_query("the options are members of the JSON body")?;
    let changes = changes(&app, &sent.headers, sent.body).await?;
    if let Some(option) = OF_ONE_VIEW.into_iter().find(|option| changes.contains_key(*option)) {
        let detail = format!("'{option}' belongs to one view; change it with POST /v1/stacks/{{id}}/rerun");
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    find(&app, &caller, &name).await?;
    let views = views(&app, &caller, &name).await?;
    if views.is_empty() {
        return Err(ApiError::new(
            Code::NotFound,
            format!("the scan '{name}' has no views yet; send its stacks first"),
        ));
    }
    let rerun = async move { rerun_views(&app, &caller, name, &views, &changes).await };
    Ok((StatusCode::ACCEPTED, Json(background::to_the_end(rerun).await?)))
}

async fn rerun_views(
    app: &App,
    caller: &Caller,
    scan: Name,
    views: &[View],
    changes: &Map<String, Value>,
) -> ApiResult<ScanRerun> {
    let mut skipped = Vec::new();
    let mut submissions = Vec::new();
    for view in views {
        let submission = submission_of(app, caller, view, changes).await;
        submissions.extend(unless_removed(view, submission, &mut skipped)?.map(|of_view| (view, of_view)));
    }
    // before zips are read, which takes long where they are in a bucket
    require_queue_places(app, submissions.len(), Code::Conflict, "rerun its stacks one by one").await?;
    let (mut checked, mut again) = (Vec::new(), Vec::new());
    for (view, (first, submission)) in submissions {
        let job = check_stored(app, &first, &submission).await;
        if let Some(job) = unless_removed(view, job, &mut skipped)? {
            checked.push(job);
            again.push(view);
        }
    }
    if checked.is_empty() {
        let detail = format!("the zips of all {} views were removed; send them again", views.len());
        return Err(ApiError::new(Code::UploadRemoved, detail));
    }
    let jobs = submit_all(app, checked, ManyOrigin::Request(caller.id())).await?;
    let views = jobs.iter().zip(again);
    let views =
        views.map(|(job, view)| RerunView { name: view.stem.clone(), stack: url(job), rerun_of: stack_url(view) });
    Ok(ScanRerun { scan, views: views.collect(), skipped })
}

/// What was found for a view; `None` when its zip or its stack was removed, which `skipped` then lists.
///
/// # Errors
/// Any other error, with the name of the view.
fn unless_removed<T>(view: &View, found: ApiResult<T>, skipped: &mut Vec<SkippedView>) -> ApiResult<Option<T>> {
    match found {
        Ok(found) => Ok(Some(found)),
        Err(error) if [Code::UploadRemoved, Code::NotFound].contains(&error.fault().code) => {
            let (name, stack) = (view.stem.clone(), stack_url(view));
            skipped.push(SkippedView { name, stack, detail: error.fault().detail.clone() });
            Ok(None)
        }
        Err(error) => {
            let fault = error.fault().clone();
            let detail = format!("view '{}': {}; no view is fused again", view.stem, fault.detail);
            Err(crate::contract::Fault { detail, ..fault }.into())
        }
    }
}

/// The stack of a view, and the submission with the changed options.
async fn submission_of(
    app: &App,
    caller: &Caller,
    view: &View,
    changes: &Map<String, Value>,
) -> ApiResult<(Job, Submission)> {
    let gone = || ApiError::new(Code::NotFound, "the stack was deleted");
    let first = app.store.metadata.job(view.stack.id).await?.ok_or_else(gone)?;
    let JobRequest::Stack(stored) = &first.request else { return Err(gone()) };
    if first.upload_removed {
        return Err(crate::http::stacks::upload::removed());
    }
    let submission = submission(app, caller, &first, stored, changes.clone()).await?;
    Ok((first, submission))
}

/// Checks the stored zip of a stack against the submission.
async fn check_stored(app: &App, first: &Job, submission: &Submission) -> ApiResult<CheckedJob> {
    check(app, submission, stored_zip(app, first).await?, None).await
}

fn stack_url(view: &View) -> String {
    url_of(JobKind::Stack, view.stack.id)
}
