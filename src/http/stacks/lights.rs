//! `GET /v1/stacks/{id}/lights/{name}`: the picture of a further light.

use axum::{
    extract::State,
    http::{HeaderMap, Method},
    response::Response,
};

use crate::{
    contract::{
        JobKind,
        artifact::{LIGHT_FORMATS, light_name},
    },
    http::{
        ApiResult, App,
        artifacts::{picture, redirect::MayRedirect},
        extract::{JobId, path::LightName},
        job_resource::load,
    },
};

/// Get the picture of a further light
///
/// A zip with `front/` may have further folders with slices of the same view under other lights, such as `uv/`. Each is
/// fused by the decision map of the front light: every pixel shows the same slices as the same pixel of the image, and
/// has the same alpha. Formats and headers are those of the image.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/lights/{name}",
    operation_id = "get_stack_light",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("name" = String, Path, description = "Name of the light: of its folder in the zip"),
        ("Accept" = Option<String>, Header, description = "A media type listed under 200. Anything else: the stored file"),
        ("redirect" = Option<bool>, Query, description = "The client follows a redirect to the bucket of the service"),
        ("Range" = Option<String>, Header, description = "One byte range"),
        ("If-Range" = Option<String>, Header, description = "`ETag`: send the range only if the file still has this tag, otherwise the whole file"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of the copy that the client has"),
    ),
    responses(
        (status = 200, description = "The file", content(
            (Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"), (Vec<u8> = "image/jpeg")
        ), headers(
            ("ETag" = String, description = "SHA-256 of the stored file; with a suffix for a converted file"),
            ("Content-Disposition" = String, description = "A file name made from label, scan, angles and light"))),
        (status = 206, description = "The requested range"),
        (status = 307, description = "With `redirect=true`, if the service signs URLs of its bucket: the stored file at `Location`, until the URL expires", headers(
            ("Location" = String, description = "A signed URL; send no token to it"))),
        (status = 304, description = "The copy of the client is current"),
        (status = 400, description = "`invalid_request`: `redirect` is neither `true` nor `false`, or is given twice"),
        (status = 404, description = "`not_found`; `no_result`: the stack failed, was cancelled, or has no light of this name"),
        (status = 409, description = "`not_finished`: the stack is queued or running"),
        (status = 412, description = "`precondition_failed`: the file does not have the tag in `If-Match`"),
        (status = 416, description = "`range_not_satisfiable`"),
        (status = 507, description = "`insufficient_storage`: no disk space to convert the file; request it as it is stored"),
    )
)]
pub async fn light(
    State(app): State<App>,
    JobId(id): JobId,
    LightName(light): LightName,
    redirect: MayRedirect,
    method: Method,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Stack).await?;
    picture::answer(&app, &job, (&light_name(&light), LIGHT_FORMATS), &method, &headers, redirect).await
}
