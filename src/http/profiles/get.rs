//! `GET /v1/profiles/{rig}/{lens}`

use axum::{extract::State, http::Uri, response::Response};
use serde::Deserialize;

use super::find;
use crate::{
    contract::profile::Profile,
    http::{
        ApiResult, App,
        extract::{Conditional, ProfileKey, params},
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
pub async fn get(State(app): State<App>, key: Conditional<ProfileKey>, uri: Uri) -> ApiResult<Response> {
    let Parameters { revision } = params::from_uri(&uri)?;
    let profile = find(&app, &key.of.rig, &key.of.lens, revision).await?;
    Ok(key.shown(profile.revision, &profile))
}
