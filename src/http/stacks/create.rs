//! `POST /v1/stacks`

use axum::{extract::State, response::Response};
use serde::Deserialize;
use utoipa::ToSchema;

use crate::{
    contract::{JobKind, Name, options::StackOptions},
    http::{
        ApiResult, App,
        auth::Caller,
        extract::Sent,
        ingest::{fields::Fields, request::IngestRequest},
        views::Stack,
    },
};

/// A stack as a form. Give `rig` and `lens` either here or in the URL, not in both.
#[derive(Debug, Deserialize, ToSchema)]
#[allow(dead_code)]
pub struct StackForm {
    /// Rig of the profile.
    #[schema(value_type = String, required = false, example = "turntable-1")]
    rig: Option<Name>,
    /// Lens of the profile.
    #[schema(value_type = String, required = false, example = "mpe65-2x")]
    lens: Option<Name>,
    /// Options as JSON. Every option has a default.
    #[schema(value_type = StackOptions, required = false)]
    options: Option<StackOptions>,
    /// The zip of the slices.
    #[schema(value_type = String, format = Binary)]
    stack: Vec<u8>,
}

/// Submit a focus stack
///
/// The body is a zip of the slices: front-light slices in the folder `front/` (or in the root), back-light slices in
/// `back/`; beside `front/`, other folders are further lights of the same view. Slices are JPEG, PNG or TIFF files of 8
/// or 16 bits per sample. Their order is the natural order of their names.
///
/// Names, options, profile, length, quota and disk space are checked before the body is read; send `Expect:
/// 100-continue` to profit from that. The body is streamed to disk. The directory of the zip and the headers of its
/// images are checked before the response. 202 means that the stack is on stable storage and queued; poll its URL, or
/// follow its events.
///
/// Options are query parameters, or the JSON part `options` of a form. `PUT` is equivalent, for `curl -T`.
#[utoipa::path(
    post,
    path = "/v1/stacks",
    operation_id = "send_stack",
    tag = "stacks",
    params(
        ("rig" = Option<String>, Query, description = "Rig of the profile. Required for a bare zip. For a form, give it here or as the part `rig`, not both", example = "turntable-1"),
        ("lens" = Option<String>, Query, description = "Lens of the profile. Required for a bare zip. For a form, give it here or as the part `lens`, not both", example = "mpe65-2x"),
        ("Idempotency-Key" = Option<String>, Header, description = "A request that repeats an earlier one with the same key gets the stack of the first"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 50) for the job to end", example = "wait=30"),
    ),
    request_body(description = "The zip, as the whole body or in a form", content(
        (Vec<u8> = "application/zip"),
        (Vec<u8> = "application/octet-stream"),
        (StackForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "The stack has ended within the time of `Prefer: wait`", body = Stack),
        (status = 202, description = "The stack is accepted (with `Idempotency-Replayed: true`: by an earlier request)", body = Stack, headers(
            ("Location" = String, description = "URL of the stack"),
            ("Idempotency-Replayed" = String, description = "`true` when an earlier request made the stack"),
            ("Preference-Applied" = String, description = "The wait that was granted"))),
        (status = 400, description = "`invalid_request`: an invalid name or option, or a rig or lens that is missing or given twice; `upload_incomplete`: the connection closed or timed out before the end of the body"),
        (status = 404, description = "`profile_not_found`, sent before the body is read"),
        (status = 413, description = "`upload_too_large`: the body exceeds the limit, or storing the zip takes longer than 50 minutes, which only a resumable upload may take"),
        (status = 415, description = "`unsupported_media_type`: neither a zip nor a form"),
        (status = 422, description = "`invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light), `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn create(State(app): State<App>, caller: Caller, sent: Sent) -> ApiResult<Response> {
    let fields = Fields::of_query(&sent.uri)?;
    let request = IngestRequest::begin(&app, &caller, &sent.headers).await?;
    let (submission, zip) = request.receive(&JobKind::Stack, fields, sent.body).await?;
    let stack = request.submit(submission, zip).await?;
    request.answer(stack).await
}
