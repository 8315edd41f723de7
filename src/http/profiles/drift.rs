//! `GET /v1/profiles/{rig}/{lens}/drift`, and how the previous revision is found.

use axum::{Json, extract::State, http::Uri};
use serde::Deserialize;

use super::find;
use crate::{
    contract::{Code, Name, profile::Profile},
    http::{
        ApiError, ApiResult, App,
        extract::{ProfileKey, params},
    },
};
use pinstack_science::{calibration, types::report::Drift};

/// Most earlier revisions that are tried when the previous one was deleted.
const MAX_TRIED: usize = 64;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    from: Option<u32>,
    to: Option<u32>,
}

/// Get the drift of a rig between two revisions
///
/// For each slice, how far the image corners moved (px) and how the gain changed. `from` and `to` may be given in
/// either order; the response runs from the older to the newer.
#[utoipa::path(
    get,
    path = "/v1/profiles/{rig}/{lens}/drift",
    operation_id = "get_profile_drift",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("from" = Option<u32>, Query, description = "The older revision; default: the one before `to`"),
        ("to" = Option<u32>, Query, description = "The newer revision; default: the current one"),
    ),
    responses(
        (status = 200, description = "The drift. Distances are null where the two revisions cannot be compared; `detail` states the reason", body = Drift),
        (status = 400, description = "`invalid_request`: an invalid name or parameter"),
        (status = 404, description = "`profile_not_found`: no such profile or revision, or none before it"),
    )
)]
pub async fn drift(State(app): State<App>, key: ProfileKey, uri: Uri) -> ApiResult<Json<Drift>> {
    let Parameters { from, to } = params::from_uri(&uri)?;
    let ProfileKey { rig, lens } = &key;
    let to = find(&app, rig, lens, to).await?;
    let from = match from {
        Some(from) => find(&app, rig, lens, Some(from)).await?,
        None => before(&app, rig, lens, to.revision).await?.ok_or_else(|| nothing_before(&key, to.revision))?,
    };
    let (older, newer) = if from.revision <= to.revision { (&from, &to) } else { (&to, &from) };
    Ok(Json(between(older, newer)))
}

/// The drift from the older of two revisions to the newer.
pub fn between(older: &Profile, newer: &Profile) -> Drift {
    calibration::drift((older.revision, &older.input), (newer.revision, &newer.input))
}

/// The nearest revision before `revision` that exists.
///
/// # Errors
/// When the store cannot be read.
pub async fn before(app: &App, rig: &Name, lens: &Name, revision: u32) -> ApiResult<Option<Profile>> {
    for earlier in (1..revision).rev().take(MAX_TRIED) {
        if let Some(profile) = app.store.metadata.profile(rig, lens, Some(earlier)).await? {
            return Ok(Some(profile));
        }
    }
    Ok(None)
}

fn nothing_before(ProfileKey { rig, lens }: &ProfileKey, revision: u32) -> ApiError {
    let detail = format!(
        "the profile of rig '{rig}' and lens '{lens}' has no revision before {revision} to compare with; calibrate it again, \
         or name a revision with the parameter from"
    );
    ApiError::new(Code::ProfileNotFound, detail)
}
