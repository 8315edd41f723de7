//! `GET /v1/profiles/{rig}/{lens}/drift`, and how the revision before is found.

use axum::{Json, extract::State, http::Uri};
use serde::Deserialize;

use super::not_found;
use crate::{
    contract::{Code, Name, profile::Profile},
    http::{
        extract::{ProfileKey, params},
        problem::{ApiError, ApiResult},
        state::App,
    },
};
use pinstack_science::{calibration, types::report::Drift};

/// Revisions that are tried, one after the other, when the one before is not there.
const TRIED: usize = 64;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    from: Option<u32>,
    to: Option<u32>,
}

/// How far a rig moved between two revisions
///
/// Per slice, how far the image corners and the gains moved. The older of the two revisions is `from`.
#[utoipa::path(
    get,
    path = "/v1/profiles/{rig}/{lens}/drift",
    operation_id = "get_profile_drift",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("from" = Option<u32>, Query, description = "The older revision, by default the one before `to`"),
        ("to" = Option<u32>, Query, description = "The newer revision, by default the current one"),
    ),
    responses(
        (status = 200, description = "How far it moved; distances are null where the two cannot be compared, and `detail` says why", body = Drift),
        (status = 400, description = "`invalid_request`: a name or parameter that breaks its rule"),
        (status = 404, description = "`profile_not_found`: no such profile or revision, or none before it"),
    )
)]
pub async fn drift(State(app): State<App>, key: ProfileKey, uri: Uri) -> ApiResult<Json<Drift>> {
    let Parameters { from, to } = params::from_uri(&uri)?;
    let ProfileKey { rig, lens } = &key;
    let load = async |revision: Option<u32>| -> ApiResult<Profile> {
        match app.store.metadata.profile(rig, lens, revision).await? {
            Some(profile) => Ok(profile),
            None => Err(not_found(&app, rig, lens, revision).await),
        }
    };
    let to = load(to).await?;
    let from = match from {
        Some(from) => load(Some(from)).await?,
        None => before(&app, rig, lens, to.revision).await?.ok_or_else(|| nothing_before(&key, to.revision))?,
    };
    let (older, newer) = if from.revision <= to.revision { (&from, &to) } else { (&to, &from) };
    Ok(Json(between(older, newer)))
}

/// How far the rig moved from the older of two revisions to the newer.
pub fn between(older: &Profile, newer: &Profile) -> Drift {
    calibration::drift((older.revision, &older.input), (newer.revision, &newer.input))
}

/// The revision before another one, or the nearest one before that when that one is gone.
///
/// # Errors
/// When the rows do not answer.
pub async fn before(app: &App, rig: &Name, lens: &Name, revision: u32) -> ApiResult<Option<Profile>> {
    for earlier in (1..revision).rev().take(TRIED) {
        if let Some(profile) = app.store.metadata.profile(rig, lens, Some(earlier)).await? {
            return Ok(Some(profile));
        }
    }
    Ok(None)
}

fn nothing_before(ProfileKey { rig, lens }: &ProfileKey, revision: u32) -> ApiError {
    let detail = format!(
        "the profile of rig '{rig}' and lens '{lens}' has no revision before {revision} to compare with; calibrate it again, \
         or name one with from"
    );
    ApiError::new(Code::ProfileNotFound, detail)
}
