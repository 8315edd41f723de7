//! `GET /v1/scans/{scan}/reconstructions`

use axum::{Json, extract::State, http::Uri};

use crate::{
    contract::{JobKind, JobState},
    http::{
        ApiResult, App,
        auth::Caller,
        extract::{PageQuery, params},
        scans::{ScanName, find},
        views::ReconstructionList,
    },
    store::JobFilter,
};

/// List the reconstructions of a scan
///
/// Newest first.
#[utoipa::path(
    get,
    path = "/v1/scans/{scan}/reconstructions",
    operation_id = "list_reconstructions_of_scan",
    tag = "reconstructions",
    params(
        ("scan" = String, Path, description = "Name of the scan"),
        ("state" = Option<JobState>, Query, description = "Only reconstructions in this state"),
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of reconstructions", body = ReconstructionList),
        (status = 400, description = "`invalid_request`: an invalid name, an unknown parameter, or a value outside its range"),
        (status = 404, description = "`scan_not_found`"),
    )
)]
pub async fn list(
    State(app): State<App>,
    caller: Caller,
    ScanName(name): ScanName,
    uri: Uri,
) -> ApiResult<Json<ReconstructionList>> {
    find(&app, &caller, &name).await?;
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let filter = params::job_filter(JobKind::Reconstruction, &pairs)?;
    let filter = JobFilter { owner: caller.sees_only(&app), scan: Some(name), ..filter };
    Ok(Json(app.store.metadata.jobs(&filter, &page).await?.into()))
}
