//! `POST /v1/profiles/{rig}/{lens}/calibrations`

use axum::{extract::State, response::Response};
use serde::Deserialize;
use utoipa::ToSchema;

use super::stored;
use crate::{
    contract::{Code, JobKind},
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        extract::{ProfileKey, Sent},
        ingest::{body::media_type, fields::Fields, request::IngestRequest},
        views::Calibration,
    },
};
use pinstack_science::types::calibration_options::CalibrationOptions;

/// The slices of a calibration as a form.
#[derive(Debug, Deserialize, ToSchema)]
#[allow(dead_code)]
pub struct CalibrationForm {
    /// Options as JSON. Every option has a default.
    #[schema(value_type = CalibrationOptions, required = false)]
    options: Option<CalibrationOptions>,
    /// The zip of the slices.
    #[schema(value_type = String, format = Binary)]
    stack: Vec<u8>,
}

/// Calibrate from a dot target or from stacks
///
/// The body is a zip with one image of the dot target per rail position, as the whole body or as the part `stack` of a
/// form. With `source=stacks` it is a zip of an ordinary stack, or of all views of a scan in the layout of
/// `PUT /v1/scans/{scan}/archive`: the slices are then aligned by what they show. Stacks or a scan whose zips are
/// stored need not be sent again: a body of type `application/json` with the schema `StoredStacks` names them. (That
/// type is `x-json-body` below, and not one of the types of the body, because a client that is generated from this
/// document sends one type of body.) When the calibration succeeds, its homographies and gains become the next revision
/// of the profile. With `from` stacks refine the homographies of a revision, whose camera and gains are kept.
///
/// A folder `moved` of the zip has one image of the same target after it was moved by `target_advance_mm`, with the
/// rail where it was for the reference slice, or one per rail position. It measures the principal distance whatever
/// moves.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/calibrations",
    operation_id = "calibrate",
    tag = "calibrations",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the calibration of the first"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 50) for the job to end"),
    ),
    request_body(description = "The zip, as the whole body or in a form", content(
        (Vec<u8> = "application/zip"),
        (Vec<u8> = "application/octet-stream"),
        (CalibrationForm = "multipart/form-data"),
    )),
    extensions(("x-json-body" = json!({ "$ref": "#/components/schemas/StoredStacks" }))),
    responses(
        (status = 200, description = "The calibration has ended within the time of `Prefer: wait`", body = Calibration),
        (status = 202, description = "The calibration is accepted (with `Idempotency-Replayed: true`: by an earlier request)", body = Calibration, headers(("Location" = String, description = "URL of the calibration"))),
        (status = 400, description = "`invalid_request`: an invalid name or parameter; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`not_found`: no such stack; `scan_not_found`; `profile_not_found`: no revision `from`"),
        (status = 410, description = "`upload_removed`: the zip of a stored stack was removed at the end of its retention period"),
        (status = 413, description = "`upload_too_large`: the body exceeds the limit, or storing a shared zip takes longer than 50 minutes"),
        (status = 415, description = "`unsupported_media_type`: neither a zip, a form nor JSON"),
        (status = 422, description = "`invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn create(State(app): State<App>, caller: Caller, key: ProfileKey, sent: Sent) -> ApiResult<Response> {
    let mut fields = Fields::of_query(&sent.uri)?;
    if let Some(name) = ["rig", "lens"].into_iter().find(|name| fields.get(name).is_some()) {
        return Err(ApiError::new(
            Code::InvalidRequest,
            format!("the parameter '{name}' repeats the {name} of the path; omit it"),
        ));
    }
    fields.set("rig", key.rig.to_string());
    fields.set("lens", key.lens.to_string());
    if media_type(&sent.headers).is_some_and(|kind| kind == "application/json") {
        return stored::create(&app, &caller, &fields, sent).await;
    }
    let request = IngestRequest::begin(&app, &caller, &sent.headers).await?;
    let (submission, zip) = request.receive(&JobKind::Calibration, fields, sent.body).await?;
    let calibration = request.submit(submission, zip).await?;
    request.answer(calibration).await
}
