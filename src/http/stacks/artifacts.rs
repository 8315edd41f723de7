//! The files that a stack makes: `GET /v1/stacks/{id}/{image,mask,backlight,depth,preview}`.

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, header},
    response::Response,
};
use uuid::Uuid;

use crate::{
    http::{
        artifacts::{accept, convert, download, name, outcome},
        extract::JobId,
        problem::ApiResult,
        state::App,
        watch::load::load,
    },
    model::JobKind,
};

async fn send(app: &App, id: Uuid, headers: &HeaderMap, what: &str) -> ApiResult<Response> {
    let job = load(app, id, JobKind::Stack).await?;
    let artifact = outcome::artifact(&job, what)?;
    let download = download::stored(app, artifact, name::of(&job, what, &artifact.media_type)).await?;
    download.answer(headers).await
}

/// The fused image
///
/// RGBA with straight alpha when there is a mask. PNG or TIFF, as the stack was asked to store it; `Accept` gets the
/// other one, made on the way with the same pixels, colour profile and EXIF.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/image",
    operation_id = "get_stack_image",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Accept" = Option<String>, Header, description = "`image/png` or `image/tiff`"),
        ("Range" = Option<String>, Header, description = "One range of bytes"),
        ("If-Range" = Option<String>, Header, description = "`ETag`: the range only if it is still that file"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of what the client has"),
    ),
    responses(
        (status = 200, description = "The image", content((Vec<u8> = "image/png"), (Vec<u8> = "image/tiff")), headers(
            ("ETag" = String, description = "SHA-256 of the file"), ("Content-Disposition" = String, description = "A sensible name"))),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed or was cancelled"),
        (status = 406, description = "`not_acceptable`: neither PNG nor TIFF is accepted"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn image(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Stack).await?;
    let artifact = outcome::artifact(&job, "image")?;
    let wanted = accept::choose(&headers, &artifact.media_type)?;
    let name = name::of(&job, "image", wanted);
    let download = if wanted == artifact.media_type {
        download::stored(&app, artifact, name).await?
    } else {
        convert::converted(&app, &headers, artifact, wanted, name).await?
    };
    let mut response = download.answer(&headers).await?;
    response.headers_mut().insert(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// The alpha mask
///
/// 8-bit grey PNG: 255 object, 0 background.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/mask",
    operation_id = "get_stack_mask",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The mask", body = Vec<u8>, content_type = "image/png"),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed, was cancelled, or has no back light"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn mask(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    send(&app, id, &headers, "mask").await
}

/// The fused back-light stack
///
/// What the mask was made from.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/backlight",
    operation_id = "get_stack_backlight",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The fused back light", body = Vec<u8>, content_type = "image/png"),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed, was cancelled, or has no back light"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn backlight(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    send(&app, id, &headers, "backlight").await
}

/// The slice-index map
///
/// 16-bit grey PNG: 0-based index of the sharpest slice; 65535 where no slice covers.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/depth",
    operation_id = "get_stack_depth",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The map", body = Vec<u8>, content_type = "image/png"),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed or was cancelled"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn depth(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    send(&app, id, &headers, "depth").await
}

/// A small picture for a page
///
/// The image, made smaller, as 8-bit PNG.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/preview",
    operation_id = "get_stack_preview",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 206, description = "A part of it"),
        (status = 304, description = "The client has it already"),
        (status = 404, description = "`not_found`; `no_result`: it failed or was cancelled"),
        (status = 409, description = "`not_finished`: it waits or runs"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn preview(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    send(&app, id, &headers, "preview").await
}
