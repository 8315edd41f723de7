//! `GET /v1/calibrations/{id}`

use axum::{Json, extract::State, http::HeaderMap};

use crate::{
    contract::JobKind,
    http::{
        extract::{JobId, prefer},
        problem::ApiResult,
        state::App,
        views::Calibration,
        watch::{load::load, wait::until_final},
    },
};

/// Read a calibration
///
/// With `Prefer: wait=N` the answer comes when the calibration has ended, after N seconds at the latest.
#[utoipa::path(
    get,
    path = "/v1/calibrations/{id}",
    operation_id = "get_calibration",
    tag = "calibrations",
    params(
        ("id" = String, Path, description = "Id of the calibration"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds for the end, at most 60"),
    ),
    responses(
        (status = 200, description = "The calibration", body = Calibration),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Json<Option<Calibration>>> {
    let mut job = load(&app, id, JobKind::Calibration).await?;
    if let Some(patience) = prefer::wait(&headers) {
        job = until_final(&app, id, patience).await?.unwrap_or(job);
    }
    Ok(Json(Calibration::of(&job)))
}
