//! `GET /v1/scans/{scan}`

use axum::{extract::State, response::Response};

use super::{ScanName, find, table::views};
use crate::{
    contract::Scan,
    http::{ApiResult, App, auth::Caller, extract::conditional::shown, views::ScanWithViews},
};

/// Get a scan
///
/// With the table of its views: state, metrics, and in what a view differs from its neighbours. `missing` lists the
/// positions of pan and tilt at which the grid of the views has a gap.
///
/// The `ETag` is that of what is stored of the scan, for `If-Match` with `PUT` and `DELETE`; the table changes without
/// it.
#[utoipa::path(
    get,
    path = "/v1/scans/{scan}",
    operation_id = "get_scan",
    tag = "scans",
    params(("scan" = String, Path, description = "Name of the scan")),
    responses(
        (status = 200, description = "The scan", body = ScanWithViews, headers(("ETag" = String, description = "The version of the scan"))),
        (status = 400, description = "`invalid_request`: an invalid name"),
        (status = 404, description = "`scan_not_found`"),
    )
)]
pub async fn get(State(app): State<App>, caller: Caller, ScanName(name): ScanName) -> ApiResult<Response> {
    let scan: Scan = find(&app, &caller, &name).await?;
    let views = views(&app, &caller, &name).await?;
    // the table has no version of its own, so the response is never "not modified"
    Ok(shown(scan.version, &ScanWithViews::tabulated(scan, views).await?))
}
