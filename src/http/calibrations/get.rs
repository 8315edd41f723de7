//! `GET /v1/calibrations/{id}`

use axum::{Json, extract::State, http::HeaderMap};

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

/// Get a calibration
///
/// With `Prefer: wait=N` the response is sent when the calibration has ended, or after N seconds (at most 60).
#[utoipa::path(
    get,
    path = "/v1/calibrations/{id}",
    operation_id = "get_calibration",
    tag = "calibrations",
    params(
        ("id" = String, Path, description = "Id of the calibration"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 60) for the job to end"),
    ),
    responses(
        (status = 200, description = "The calibration", body = Calibration),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Json<JobDocument>> {
    job_resource::get(&app, id, JobKind::Calibration, &headers).await
}
