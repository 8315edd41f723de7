//! `POST /v1/scans/{scan}/archive`

use axum::{
    Json,
    extract::State,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::{ScanName, url};
use crate::{
    contract::Name,
    http::{
        ApiResult, App,
        auth::Caller,
        background,
        extract::Sent,
        ingest::{
            fields::Fields,
            idempotency::{IDEMPOTENCY_REPLAYED, IdempotencyKey, earlier, fingerprint},
            many::ManyOrigin,
            request::IngestRequest,
            scan_views::{group, key_of_view},
            spool::SpooledZip,
            submission::scan::ScanSubmission,
        },
        views::{job, scan_archive::ScanArchiveView},
    },
};

/// Submit all views of a scan in one zip
///
/// The zip is taken apart into one stack per view on the server. Views, angles and light are recognised by the names: a
/// folder per view with `front/` and `back/` in it; trees such as `x={tilt}/y={pan}` with a tree per light; angles and
/// focus steps in file names; or a `manifest.json`. The guide to names is in the documentation of the archive.
///
/// `dry_run=true` shows the grouping and makes nothing. Otherwise every view is checked before the first stack is made:
/// either all views become stacks, or none. 202 means that all stacks are on stable storage and queued.
///
/// Options of stacks are query parameters or the JSON part `options` of a form; they apply to every view. `label`,
/// `pan_deg` and `tilt_deg` come from the names. `PUT` is equivalent, for `curl -T`.
#[utoipa::path(
    post,
    path = "/v1/scans/{scan}/archive",
    operation_id = "send_scan",
    tag = "scans",
    params(
        ("scan" = String, Path, description = "Name of the scan; create it first"),
        ("rig" = Option<String>, Query, description = "Rig of the profile; default: that of the scan"),
        ("lens" = Option<String>, Query, description = "Lens of the profile; default: that of the scan"),
        ("dry_run" = Option<bool>, Query, description = "`true`: only show the grouping"),
        ("x" = inline(Option<pinstack_science::archive::scan::Angle>), Query, description = "The angle that a number after `x` in a name is, as in `x=6`; default `tilt`"),
        ("x_degrees_per_unit" = Option<f64>, Query, description = "Degrees per unit of that number; default: 1 after `=`, unknown otherwise (`_x_00190_`: steps of a motor)"),
        ("x_zero" = Option<f64>, Query, description = "The number at 0 degrees; default 0"),
        ("y" = inline(Option<pinstack_science::archive::scan::Angle>), Query, description = "The same for a number after `y`; default `pan`"),
        ("y_degrees_per_unit" = Option<f64>, Query, description = "Degrees per unit of that number"),
        ("y_zero" = Option<f64>, Query, description = "The number at 0 degrees; default 0"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the stacks of the first"),
    ),
    request_body(description = "The zip, as the whole body or in a form", content(
        (Vec<u8> = "application/zip"),
        (Vec<u8> = "application/octet-stream"),
        (crate::http::stacks::create::StackForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The grouping (`dry_run=true`)", body = ScanArchiveView),
        (status = 202, description = "Every view became a stack (with `Idempotency-Replayed: true`: by an earlier request)", body = ScanArchiveView, headers(
            ("Location" = String, description = "URL of the scan"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made the stacks"))),
        (status = 400, description = "`invalid_request`: an invalid name or option; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`scan_not_found`, `profile_not_found`, sent before the body is read"),
        (status = 409, description = "`conflict`: some stacks of an earlier request with this key were deleted"),
        (status = 413, description = "`upload_too_large`: the body exceeds the limit, or storing the zip takes longer than 50 minutes, which only a resumable upload may take"),
        (status = 415, description = "`unsupported_media_type`: neither a zip nor a form"),
        (status = 422, description = "`scan_mismatch`: another rig or lens than that of the scan; `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, \
            `size_mismatch`, `slice_count_mismatch`, `mask_failed` of one or more views: `errors` names each view; `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures: the zip and its views need twice its size for a moment"),
    )
)]
pub async fn archive(
    State(app): State<App>,
    caller: Caller,
    ScanName(name): ScanName,
    sent: Sent,
) -> ApiResult<Response> {
    let fields = Fields::of_query(&sent.uri)?;
    let request = IngestRequest::begin(&app, &caller, &sent.headers).await?;
    let (submission, zip): (ScanSubmission, SpooledZip) = request.receive(&name, fields, sent.body).await?;
    let (app, caller, key) = (app.clone(), caller.clone(), request.key.clone());
    // all bytes are here: the stacks are made even when the client disconnects
    let answering = async move { answer(&app, &caller, &key, &submission, zip).await };
    let (view, replayed) = background::to_the_end(answering).await?;
    let made = view.views.iter().any(|view| view.stack.is_some());
    let status = if made { StatusCode::ACCEPTED } else { StatusCode::OK };
    let mut response = (status, [(header::LOCATION, url(&name))], Json(view)).into_response();
    if replayed {
        response.headers_mut().insert(IDEMPOTENCY_REPLAYED, HeaderValue::from_static("true"));
    }
    Ok(response)
}

/// The answer, and whether an earlier request made the stacks.
async fn answer(
    app: &App,
    caller: &Caller,
    key: &IdempotencyKey,
    submission: &ScanSubmission,
    zip: SpooledZip,
) -> ApiResult<(ScanArchiveView, bool)> {
    let grouped = group(app, submission, zip.file.path().to_owned()).await?;
    let scan = &submission.scan.name;
    if submission.dry_run {
        return Ok((grouped.view(scan, submission.slice_count()), false));
    }
    let fingerprint = fingerprint("scan", submission.fingerprint_input(), &zip.sha256);
    if let Some(key) = &key.stored
        && earlier(app, key, &fingerprint).await?.is_some()
    {
        let view = grouped.view(scan, submission.slice_count());
        return Ok((with_earlier_stacks(app, key, scan, view).await?, true));
    }
    let idempotency = key.stored.clone().map(|key| (key, fingerprint));
    let view = grouped.submit(app, submission, idempotency, ManyOrigin::Request(caller.id())).await?;
    Ok((view, false))
}

/// Fills in the stacks that the earlier request made.
async fn with_earlier_stacks(
    app: &App,
    key: &str,
    scan: &Name,
    mut view: ScanArchiveView,
) -> ApiResult<ScanArchiveView> {
    for (at, view) in view.views.iter_mut().enumerate() {
        let job = app.store.metadata.by_idempotency_key(&key_of_view(key, at)).await?;
        view.stack = job.map(|(job, _)| job).filter(|job| job.request.scan() == Some(scan)).map(|job| job::url(&job));
    }
    Ok(view)
}
