//! Calibration profiles: one endpoint per file.

pub mod delete;
pub mod drift;
pub mod export;
pub mod file;
pub mod get;
pub mod import;
pub mod list;
mod near;
pub mod numbers;
pub mod put;
pub mod revisions;
pub mod rig_parameters;
mod write;

use axum::{
    Json,
    http::{HeaderMap, HeaderName, HeaderValue, header},
    response::{IntoResponse, Response},
};

use super::{
    extract::{
        ProfileKey,
        conditional::{Tags, etag, not_modified},
    },
    problem::{ApiError, ApiResult},
    state::App,
};
use crate::{
    contract::{Code, Name, profile::Profile},
    store::Precondition,
};

/// Profiles that are looked through for names near to one that is not there.
const LOOKED_THROUGH: u32 = 10_000;

/// No profile under this key; names those that may be meant.
pub async fn not_found(app: &App, rig: &Name, lens: &Name, revision: Option<u32>) -> ApiError {
    let detail = match revision {
        None => {
            // the answer is the same without them
            let keys = app.store.metadata.profile_keys(LOOKED_THROUGH).await.unwrap_or_default();
            let near = near::sentence(&near::near(rig, lens, &keys));
            format!(
                "there is no profile for rig '{rig}' and lens '{lens}'{near}; calibrate it or PUT /v1/profiles/{rig}/{lens} \
                 first"
            )
        }
        Some(revision) => format!("the profile of rig '{rig}' and lens '{lens}' has no revision {revision}"),
    };
    ApiError::new(Code::ProfileNotFound, detail)
}

/// A profile with its `ETag`, or 304 when the client has it.
fn shown(headers: &HeaderMap, profile: &Profile) -> Response {
    let tag = profile.revision.to_string();
    let headers_out = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, HeaderValue::from_static("no-cache"))];
    if not_modified(headers, &tag) {
        return (axum::http::StatusCode::NOT_MODIFIED, headers_out).into_response();
    }
    (headers_out, Json(profile)).into_response()
}

/// What `If-Match` and `If-None-Match` of a write demand. Of several tags in `If-Match`, the one of the current
/// revision counts.
async fn precondition(app: &App, key: &ProfileKey, headers: &HeaderMap) -> ApiResult<Precondition> {
    if Tags::of(headers, &header::IF_NONE_MATCH) == Some(Tags::Any) {
        return Ok(Precondition::Absent);
    }
    let list = match Tags::of(headers, &header::IF_MATCH) {
        None => return Ok(Precondition::Any),
        Some(Tags::Any) => return Ok(Precondition::Present),
        Some(list) => list,
    };
    let current = app.store.metadata.profile(&key.rig, &key.lens, None).await?.map(|p| p.revision);
    match current {
        Some(revision) if list.contains_strong(&revision.to_string()) => Ok(Precondition::Revision(revision)),
        _ => Err(lost_race(key, current, &header::IF_MATCH)),
    }
}

/// The precondition does not hold.
fn lost_race(key: &ProfileKey, current: Option<u32>, header: &HeaderName) -> ApiError {
    let ProfileKey { rig, lens } = key;
    let now = match current {
        Some(revision) => format!("is at revision {revision}"),
        None => "does not exist".to_owned(),
    };
    let detail = format!(
        "the profile of rig '{rig}' and lens '{lens}' {now}, which is not what {header} demands; read it again"
    );
    ApiError::new(Code::PreconditionFailed, detail)
}
