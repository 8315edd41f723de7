//! `GET /v1/reconstructions/{id}/poses`

use axum::{extract::State, http::Uri, response::Response};
use serde::Deserialize;

use crate::{
    contract::{JobKind, reconstruction::files},
    http::{
        ApiError, ApiResult, App,
        artifacts::{download::bytes, outcome::artifact},
        extract::{JobId, params},
        job_resource::load,
        poses::{ReportFormat, written},
    },
};
use pinstack_science::photogrammetry::poses::PoseReport;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    #[serde(default)]
    format: ReportFormat,
}

/// Get the report on the camera poses of a reconstruction
///
/// The same report as of `POST /v1/scans/{scan}/poses` with the model of this reconstruction.
#[utoipa::path(
    get,
    path = "/v1/reconstructions/{id}/poses",
    operation_id = "get_reconstruction_poses",
    tag = "reconstructions",
    params(
        ("id" = String, Path, description = "Id of the reconstruction"),
        ("format" = inline(Option<ReportFormat>), Query, description = "Format of the answer"),
    ),
    responses(
        (status = 200, description = "The report", content(
            (PoseReport = "application/json"),
            (String = "text/plain"),
            (String = "application/x-latex"),
            (String = "text/html"),
        )),
        (status = 400, description = "`invalid_request`: an unknown parameter or format"),
        (status = 404, description = "`not_found`; `no_result`: the reconstruction failed or was cancelled, or too few views were registered"),
        (status = 409, description = "`not_finished`: the reconstruction is queued or running"),
    )
)]
pub async fn poses(State(app): State<App>, JobId(id): JobId, uri: Uri) -> ApiResult<Response> {
    let Query { format } = params::from_uri(&uri)?;
    let job = load(&app, id, JobKind::Reconstruction).await?;
    let stored = bytes(&app, &job, artifact(&job, files::POSES)?).await?;
    let report: PoseReport = serde_json::from_slice(&stored).map_err(ApiError::internal)?;
    Ok(written(&report, format))
}
