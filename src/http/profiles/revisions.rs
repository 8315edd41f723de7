//! `GET /v1/profiles/{rig}/{lens}/revisions`

use axum::{Json, extract::State, http::Uri};

use super::not_found;
use crate::http::{
    ApiResult, App,
    extract::{PageQuery, ProfileKey, params},
    views::ProfileList,
};

/// List the revisions of a profile
///
/// Newest first, without the data per slice; `GET` of the profile with `?revision=N` returns it. A revision never
/// changes. Each stack names the revision that it used.
#[utoipa::path(
    get,
    path = "/v1/profiles/{rig}/{lens}/revisions",
    operation_id = "list_profile_revisions",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of revisions", body = ProfileList),
        (status = 400, description = "`invalid_request`: an invalid name or parameter"),
        (status = 404, description = "`profile_not_found`"),
    )
)]
pub async fn revisions(State(app): State<App>, key: ProfileKey, uri: Uri) -> ApiResult<Json<ProfileList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    params::refuse_rest(&pairs, "limit, cursor")?;
    let is_first_page = page.cursor.is_none();
    let page = app.store.metadata.revisions(&key.rig, &key.lens, &page).await?;
    if page.items.is_empty() && page.skipped.is_empty() && is_first_page {
        return Err(not_found(&app, &key.rig, &key.lens, None).await);
    }
    Ok(Json(page.into()))
}
