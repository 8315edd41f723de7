//! `POST /v1/calibrations/{id}/cancel`

use axum::{Json, extract::State, http::StatusCode};

use crate::{
    contract::JobKind,
    http::{
        extract::JobId,
        job_resource,
        problem::ApiResult,
        state::App,
        views::{Calibration, JobDocument},
    },
};

/// Cancel a calibration
///
/// A waiting calibration is cancelled at once, a running one within seconds. Cancelling it again is not an error.
#[utoipa::path(
    post,
    path = "/v1/calibrations/{id}/cancel",
    operation_id = "cancel_calibration",
    tag = "calibrations",
    params(("id" = String, Path, description = "Id of the calibration")),
    responses(
        (status = 202, description = "It is cancelled, or will be as soon as its worker stops", body = Calibration),
        (status = 404, description = "`not_found`"),
        (status = 409, description = "`conflict`: it has already succeeded or failed"),
    )
)]
pub async fn cancel(State(app): State<App>, JobId(id): JobId) -> ApiResult<(StatusCode, Json<JobDocument>)> {
    job_resource::cancel(&app, id, JobKind::Calibration).await
}
