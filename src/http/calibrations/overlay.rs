//! `GET /v1/calibrations/{id}/overlay`

use axum::{
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use serde::Deserialize;

use crate::{
    contract::{Code, JobKind, artifact::overlay_name},
    http::{
        ApiError, ApiResult, App,
        artifacts::{download, name, outcome},
        extract::{JobId, params},
        job_resource::load,
    },
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    slice: Option<u32>,
}

/// Get a slice with the detected dots
///
/// PNG of a slice with the detected dots drawn in, reduced to at most 1600 px per side. Default: the reference slice.
#[utoipa::path(
    get,
    path = "/v1/calibrations/{id}/overlay",
    operation_id = "get_calibration_overlay",
    tag = "calibrations",
    params(
        ("id" = String, Path, description = "Id of the calibration"),
        ("slice" = Option<u32>, Query, description = "0-based index of the slice; default: the reference slice"),
    ),
    responses(
        (status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 206, description = "The requested range"),
        (status = 304, description = "The copy of the client is current"),
        (status = 400, description = "`invalid_request`: `slice` is not a number"),
        (status = 404, description = "`not_found`; `no_result`: no such slice, or the calibration failed or was cancelled"),
        (status = 412, description = "`precondition_failed`: the file does not have the tag in `If-Match`"),
        (status = 409, description = "`not_finished`: the calibration is queued or running"),
        (status = 416, description = "`range_not_satisfiable`"),
    )
)]
pub async fn overlay(State(app): State<App>, JobId(id): JobId, uri: Uri, headers: HeaderMap) -> ApiResult<Response> {
    let Parameters { slice } = params::from_uri(&uri)?;
    let job = load(&app, id, JobKind::Calibration).await?;
    let reference = outcome::of_calibration(&job)?.reference_index;
    let (slice, slices) =
        (slice.unwrap_or(reference) as usize, job.request.layout().map_or(0, |layout| layout.front.len()));
    if slice >= slices {
        let last = slices.saturating_sub(1);
        let detail = format!("the calibration has no slice {slice}; its {slices} slices are 0 to {last}");
        return Err(ApiError::new(Code::NoResult, detail));
    }
    let what = overlay_name(slice);
    let artifact = outcome::artifact(&job, &what)?;
    let download = download::stored(&app, &job, artifact, name::of(&job, &what, &artifact.media_type)).await?;
    download.answer(&headers).await
}
