//! The files that a stack makes: `GET /v1/stacks/{id}/{image,mask,backlight,depth,preview}`.

use axum::{
    extract::State,
    http::{HeaderMap, Method},
    response::Response,
};
use uuid::Uuid;

use crate::{
    contract::JobKind,
    http::{
        artifacts::{accept::Formats, picture},
        extract::JobId,
        job_resource::load,
        problem::ApiResult,
        state::App,
    },
};

async fn send(app: &App, id: Uuid, what: &str, formats: Formats, request: (Method, HeaderMap)) -> ApiResult<Response> {
    let (method, headers) = request;
    let job = load(app, id, JobKind::Stack).await?;
    picture::answer(app, &job, what, formats, &method, &headers).await
}

/// The fused image
///
/// RGBA with straight alpha; a JPEG has no alpha. PNG, TIFF or JPEG, as the stack was asked to store it; `Accept` gets
/// another one, made on the way with the same pixels, colour profile and EXIF. When none of the three is accepted, the
/// stored file is sent. `HEAD` makes nothing, so it tells no length of a file that is not made yet.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/image",
    operation_id = "get_stack_image",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Accept" = Option<String>, Header, description = "`image/png`, `image/tiff` or `image/jpeg`; anything else: as stored"),
        ("Range" = Option<String>, Header, description = "One range of bytes"),
        ("If-Range" = Option<String>, Header, description = "`ETag`: the range only if it is still that file"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of what the client has"),
    ),
    responses(
        (status = 200, description = "The image", content((Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"), (Vec<u8> = "image/jpeg")), headers(
            ("ETag" = String, description = "SHA-256 of the file"), ("Content-Disposition" = String, description = "A sensible name"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed or was cancelled"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 412, description = "`precondition_failed`: the file is not the one that `If-Match` names"),
        (status = 416, description = "`range_not_satisfiable`"),
        (status = 507, description = "`insufficient_storage`: no room to convert it; it can be had as it is stored"),
    )
)]
pub async fn image(
    State(app): State<App>,
    JobId(id): JobId,
    method: Method,
    headers: HeaderMap,
) -> ApiResult<Response> {
    send(&app, id, "image", Formats::All, (method, headers)).await
}

/// The alpha mask
///
/// 8-bit grey PNG: 255 object, 0 background. TIFF by `Accept: image/tiff`.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/mask",
    operation_id = "get_stack_mask",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The mask", content((Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed, was cancelled, or has no back light"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 412, description = "`precondition_failed`: the file is not the one that `If-Match` names"),
        (status = 416, description = "`range_not_satisfiable`"),
        (status = 507, description = "`insufficient_storage`: no room to convert it; it can be had as it is stored"),
    )
)]
pub async fn mask(State(app): State<App>, JobId(id): JobId, method: Method, headers: HeaderMap) -> ApiResult<Response> {
    send(&app, id, "mask", Formats::Lossless, (method, headers)).await
}

/// The fused back-light stack
///
/// What the mask was made from. PNG; TIFF or JPEG by `Accept`.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/backlight",
    operation_id = "get_stack_backlight",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The fused back light", content((Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"), (Vec<u8> = "image/jpeg"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed, was cancelled, or has no back light"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 412, description = "`precondition_failed`: the file is not the one that `If-Match` names"),
        (status = 416, description = "`range_not_satisfiable`"),
        (status = 507, description = "`insufficient_storage`: no room to convert it; it can be had as it is stored"),
    )
)]
pub async fn backlight(
    State(app): State<App>,
    JobId(id): JobId,
    method: Method,
    headers: HeaderMap,
) -> ApiResult<Response> {
    send(&app, id, "backlight", Formats::All, (method, headers)).await
}

/// The slice-index map
///
/// 16-bit grey PNG: 0-based index of the sharpest slice; 65535 where no slice covers. TIFF by `Accept: image/tiff`.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/depth",
    operation_id = "get_stack_depth",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The map", content((Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed or was cancelled"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 412, description = "`precondition_failed`: the file is not the one that `If-Match` names"),
        (status = 416, description = "`range_not_satisfiable`"),
        (status = 507, description = "`insufficient_storage`: no room to convert it; it can be had as it is stored"),
    )
)]
pub async fn depth(
    State(app): State<App>,
    JobId(id): JobId,
    method: Method,
    headers: HeaderMap,
) -> ApiResult<Response> {
    send(&app, id, "depth", Formats::Lossless, (method, headers)).await
}

/// A small picture for a page
///
/// JPEG of at most 800 px a side; light grey shows through where the image is transparent. Older stacks have a PNG.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/preview",
    operation_id = "get_stack_preview",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The picture", content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed or was cancelled"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 412, description = "`precondition_failed`: the file is not the one that `If-Match` names"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn preview(
    State(app): State<App>,
    JobId(id): JobId,
    method: Method,
    headers: HeaderMap,
) -> ApiResult<Response> {
    send(&app, id, "preview", Formats::Stored, (method, headers)).await
}
