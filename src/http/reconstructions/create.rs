//! `POST /v1/scans/{scan}/reconstructions`

use axum::{extract::State, response::Response};
use uuid::Uuid;

use super::plan::request_of;
use crate::{
    contract::{
        Code, JobKind, Name, Scan,
        reconstruction::{ReconstructionOptions, ReconstructionRequest},
        request::JobRequest,
    },
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        background,
        extract::{Sent, json},
        ingest::{
            idempotency,
            request::IngestRequest,
            submit::{Submitted, refusal},
        },
        scans::ScanName,
        views::Reconstruction,
    },
    jobs::reconstruction::INSTALL,
    store::{Enqueue, NewJob},
    telemetry::traces,
};

/// Reconstruct a scan
///
/// Makes a job that has COLMAP reconstruct the views of the scan, with the masks, the camera of the profile, and the
/// neighbours by pan and tilt. It runs on a worker that has COLMAP. Results: the cameras, points with colours, the
/// visual hull of the masks, the model of COLMAP, the report on the poses, numbers for each view, and findings in
/// words.
///
/// All views must have succeeded and fit together, as for a bundle; `partial: true` leaves out views that have no
/// result. The job reads the present results of the stacks; views that are replaced later need another reconstruction.
#[utoipa::path(
    post,
    path = "/v1/scans/{scan}/reconstructions",
    operation_id = "reconstruct_scan",
    tag = "reconstructions",
    params(
        ("scan" = String, Path, description = "Name of the scan"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the reconstruction of the first"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 50) for the job to end"),
    ),
    request_body(content = ReconstructionOptions, description = "The options; empty: the defaults"),
    responses(
        (status = 200, description = "The reconstruction has ended within the time of `Prefer: wait`", body = Reconstruction),
        (status = 202, description = "The reconstruction is accepted (with `Idempotency-Replayed: true`: by an earlier request)", body = Reconstruction, headers(
            ("Location" = String, description = "URL of the reconstruction"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made the reconstruction"),
            ("Preference-Applied" = String, description = "The wait that was granted"))),
        (status = 400, description = "`invalid_request`: an invalid name or option, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`scan_not_found`; `not_found`: the scan has no views with results"),
        (status = 409, description = "`not_finished`: views are queued or running, or have failed; `conflict`: the server has no COLMAP"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`scan_mismatch`: views of another size, crop, profile revision or camera than most; `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
    )
)]
pub async fn create(
    State(app): State<App>,
    caller: Caller,
    ScanName(name): ScanName,
    sent: Sent,
) -> ApiResult<Response> {
    sent.refuse_query("the options are members of the JSON body")?;
    let (headers, options) = options(&app, sent).await?;
    require_colmap(&app)?;
    let request = IngestRequest::begin(&app, &caller, &headers).await?;
    let key = request.key.stored.clone();
    let making = {
        let (app, caller) = (app.clone(), caller.clone());
        async move { accept(&app, &caller, &name, options, key).await }
    };
    let submitted = background::to_the_end(making).await?;
    request.answer(submitted).await
}

/// Requires that a worker may have COLMAP.
///
/// # Errors
/// `conflict`, with what to install.
pub fn require_colmap(app: &App) -> ApiResult<()> {
    if app.policy.reconstructs {
        return Ok(());
    }
    let detail =
        format!("no worker of this service has COLMAP, which reconstructions need; the operator has to {INSTALL}");
    Err(ApiError::new(Code::Conflict, detail))
}

/// The headers, and the options of the body.
async fn options(app: &App, sent: Sent) -> ApiResult<(axum::http::HeaderMap, ReconstructionOptions)> {
    let Sent { headers, body, .. } = sent;
    json::require_json(&headers)?;
    let bytes = json::read(app, &headers, body).await?;
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Ok((headers, ReconstructionOptions::default()));
    }
    let options: ReconstructionOptions = json::parse(&bytes, Code::InvalidRequest)?;
    options.check()?;
    Ok((headers, options))
}

/// Makes the job, or finds that of an earlier request.
async fn accept(
    app: &App,
    caller: &Caller,
    name: &Name,
    options: ReconstructionOptions,
    key: Option<String>,
) -> ApiResult<Submitted> {
    // without the digest of the pictures: a repeated request gets its job, whatever became of the views meanwhile
    let fingerprint = idempotency::fingerprint(JobKind::Reconstruction, (name, options), "");
    if let Some(key) = &key
        && let Some(job) = idempotency::earlier(app, key, &fingerprint).await?
    {
        return Ok(Submitted { job, replayed: true });
    }
    let (scan, request) = request_of(app, caller, name, options).await?;
    enqueue(app, caller, scan, request, key.map(|key| (key, fingerprint))).await
}

/// Makes the job. `idempotency`: the key as the store keeps it, and the fingerprint of the request.
///
/// # Errors
/// `queue_full`; `idempotency_key_reused`.
pub async fn enqueue(
    app: &App,
    caller: &Caller,
    scan: Scan,
    request: ReconstructionRequest,
    idempotency: Option<(String, String)>,
) -> ApiResult<Submitted> {
    let job = NewJob {
        id: Uuid::now_v7(),
        rig: scan.input.rig,
        lens: scan.input.lens,
        request: JobRequest::Reconstruction(request),
        warnings: Vec::new(),
        idempotency,
        owner: caller.id(),
        trace: traces::for_the_row(),
    };
    let enqueuing = app.store.metadata.enqueue(&job, app.policy.queue_limit);
    match traces::section("enqueue", enqueuing).await? {
        Enqueue::Accepted(job) => Ok(Submitted { job: *job, replayed: false }),
        Enqueue::Repeated(job) => Ok(Submitted { job: *job, replayed: true }),
        refused => Err(refusal(refused, 0, job.idempotency.as_ref().map_or("", |(key, _)| key.as_str()))),
    }
}
