//! `GET /v1/calibrations`

use axum::{Json, extract::State, http::Uri};

use crate::{
    contract::{JobKind, JobState},
    http::{
        extract::{PageQuery, params},
        problem::ApiResult,
        state::App,
        views::CalibrationList,
    },
    store::JobFilter,
};

/// List calibrations
///
/// Newest first. A page holds at most `limit` items, fewer when the response would exceed about 4 MiB.
#[utoipa::path(
    get,
    path = "/v1/calibrations",
    operation_id = "list_calibrations",
    tag = "calibrations",
    params(
        ("state" = Option<JobState>, Query, description = "Only calibrations in this state"),
        ("rig" = Option<String>, Query, description = "Only calibrations of this rig"),
        ("lens" = Option<String>, Query, description = "Only calibrations of this lens"),
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of calibrations", body = CalibrationList),
        (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
    )
)]
pub async fn list(State(app): State<App>, uri: Uri) -> ApiResult<Json<CalibrationList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let filter: JobFilter = params::job_filter(JobKind::Calibration, &pairs)?;
    Ok(Json(app.store.metadata.jobs(&filter, &page).await?.into()))
}
