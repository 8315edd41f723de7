//! `GET /v1/scans`

use axum::{Json, extract::State, http::Uri};
use serde::Deserialize;

use crate::{
    contract::Name,
    http::{
        ApiResult, App,
        auth::Caller,
        extract::{PageQuery, params},
        views::ScanList,
    },
    store::scans::ScanFilter,
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    rig: Option<Name>,
    lens: Option<Name>,
}

/// List scans
///
/// Newest first, without their views.
#[utoipa::path(
    get,
    path = "/v1/scans",
    operation_id = "list_scans",
    tag = "scans",
    params(
        ("rig" = Option<String>, Query, description = "Only scans of this rig"),
        ("lens" = Option<String>, Query, description = "Only scans of this lens"),
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of scans", body = ScanList),
        (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
    )
)]
pub async fn list(State(app): State<App>, caller: Caller, uri: Uri) -> ApiResult<Json<ScanList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let Query { rig, lens } = params::typed(&pairs)?;
    let filter = ScanFilter { rig, lens, owner: caller.sees_only(&app) };
    Ok(Json(app.store.metadata.scans(&filter, &page).await?.into()))
}
