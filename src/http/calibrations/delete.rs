//! `DELETE /v1/calibrations/{id}`

use axum::{extract::State, http::StatusCode};

use crate::{
    contract::JobKind,
    http::{extract::JobId, problem::ApiResult, state::App, watch::load::require},
    store::gc::gc_job,
};

/// Delete a calibration
///
/// Upload and results are removed. One that runs is cancelled first and goes when its worker has stopped.
#[utoipa::path(
    delete,
    path = "/v1/calibrations/{id}",
    operation_id = "delete_calibration",
    tag = "calibrations",
    params(("id" = String, Path, description = "Id of the calibration")),
    responses(
        (status = 204, description = "It is gone, or will be as soon as its worker stops"),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn delete(State(app): State<App>, JobId(id): JobId) -> ApiResult<StatusCode> {
    require(&app, id, JobKind::Calibration).await?;
    app.rows.delete_job(id).await?;
    // the blobs of a running job go with its worker, others at once; what stays here the sweep finds
    if let Err(error) = gc_job(&*app.rows, &*app.blobs, id).await {
        tracing::warn!(%error, %id, "blobs of a deleted job are left for the sweep");
    }
    Ok(StatusCode::NO_CONTENT)
}
