//! `GET /v1/profiles/{rig}/{lens}`

use axum::{
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use serde::Deserialize;

use super::{not_found, response};
use crate::{
    contract::profile::Profile,
    http::{
        extract::{ProfileKey, params},
        problem::ApiResult,
        state::App,
    },
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    revision: Option<u32>,
}

/// Get a profile
///
/// The current revision, or an older one with `?revision=N`. The `ETag` is the revision number.
#[utoipa::path(
    get,
    path = "/v1/profiles/{rig}/{lens}",
    operation_id = "get_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens (one per setting)"),
        ("revision" = Option<u32>, Query, description = "Revision; default: the current one"),
        ("If-None-Match" = Option<String>, Header, description = "`ETag` of the copy that the client has"),
    ),
    responses(
        (status = 200, description = "The profile", body = Profile, headers(("ETag" = String, description = "The revision number"))),
        (status = 304, description = "The copy of the client is current"),
        (status = 400, description = "`invalid_request`: an invalid name or parameter"),
        (status = 404, description = "`profile_not_found`"),
    )
)]
pub async fn get(State(app): State<App>, key: ProfileKey, uri: Uri, headers: HeaderMap) -> ApiResult<Response> {
    let Parameters { revision } = params::from_uri(&uri)?;
    let profile = app.store.metadata.profile(&key.rig, &key.lens, revision).await?;
    let Some(profile) = profile else { return Err(not_found(&app, &key.rig, &key.lens, revision).await) };
    Ok(response(&headers, &profile))
}
