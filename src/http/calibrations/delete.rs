//! `DELETE /v1/calibrations/{id}`

use axum::{extract::State, http::StatusCode};

use crate::{
    contract::JobKind,
    http::{extract::JobId, job_resource, problem::ApiResult, state::App},
};

/// Delete a calibration
///
/// The upload and the results are deleted. A running calibration is cancelled first, and its files are deleted when its
/// worker has stopped.
#[utoipa::path(
    delete,
    path = "/v1/calibrations/{id}",
    operation_id = "delete_calibration",
    tag = "calibrations",
    params(("id" = String, Path, description = "Id of the calibration")),
    responses(
        (status = 204, description = "It is deleted, or will be as soon as its worker stops"),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn delete(State(app): State<App>, JobId(id): JobId) -> ApiResult<StatusCode> {
    job_resource::delete(&app, id, JobKind::Calibration).await
}
