//! `GET /v1/calibrations`

use axum::{Json, extract::State, http::Uri};

use crate::{
    contract::{JobKind, JobState},
    http::{
        extract::{PageQuery, params},
        problem::ApiResult,
        state::App,
        views::{Calibration, CalibrationList},
    },
    store::JobFilter,
};

/// List calibrations
///
/// Newest first. A page ends at `limit` or when the answer would be larger than about 4 MiB.
#[utoipa::path(
    get,
    path = "/v1/calibrations",
    operation_id = "list_calibrations",
    tag = "calibrations",
    params(
        ("state" = Option<JobState>, Query, description = "Only in this state"),
        ("rig" = Option<String>, Query, description = "Only of this rig"),
        ("lens" = Option<String>, Query, description = "Only of this lens"),
        ("limit" = Option<u32>, Query, description = "Items on a page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` of the page before"),
    ),
    responses(
        (status = 200, description = "A page of calibrations", body = CalibrationList),
        (status = 400, description = "`invalid_request`: a parameter that breaks its rule"),
    )
)]
pub async fn list(State(app): State<App>, uri: Uri) -> ApiResult<Json<CalibrationList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let filter: JobFilter = params::job_filter(JobKind::Calibration, &pairs)?;
    let page = app.rows.jobs(&filter, &page).await?;
    let items = page.items.iter().filter_map(Calibration::of).collect();
    Ok(Json(CalibrationList { items, next_cursor: page.next_cursor, skipped: page.skipped }))
}
