//! `GET /v1/profiles`

use axum::{Json, extract::State, http::Uri};

use crate::http::{
    ApiError, ApiResult, App,
    extract::{PageQuery, params, path::name},
    views::ProfileList,
};

/// List profiles
///
/// The current revision of every profile, most recently written first, without the data per slice.
#[utoipa::path(
    get,
    path = "/v1/profiles",
    operation_id = "list_profiles",
    tag = "profiles",
    params(
        ("rig" = Option<String>, Query, description = "Only profiles of this rig"),
        ("lens" = Option<String>, Query, description = "Only profiles of this lens"),
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of profiles", body = ProfileList),
        (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
    )
)]
pub async fn list(State(app): State<App>, uri: Uri) -> ApiResult<Json<ProfileList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let rig = params::take(&mut pairs, "rig").map(|text| name("rig", text)).transpose()?;
    let lens = params::take(&mut pairs, "lens").map(|text| name("lens", text)).transpose()?;
    params::refuse_rest(&pairs, "rig, lens, limit, cursor")?;
    let page = app.store.metadata.profiles(rig.as_ref(), lens.as_ref(), &page).await?;
    Ok::<_, ApiError>(Json(page.into()))
}
