//! Calibration profiles: one endpoint per file.

pub mod delete;
pub mod drift;
pub mod export;
pub mod file;
pub mod get;
pub mod import;
pub mod list;
pub mod near;
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
        conditional::{self, etag, not_modified},
    },
    problem::{ApiError, ApiResult},
    state::App,
};
use crate::{
    contract::{Code, Name, profile::Profile},
    store::Precondition,
};

/// Most profiles that are searched for similar names.
const MAX_SEARCHED: u32 = 10_000;

/// The error for a profile or revision that does not exist. It suggests profiles with similar names.
pub async fn not_found(app: &App, rig: &Name, lens: &Name, revision: Option<u32>) -> ApiError {
    let detail = match revision {
        None => {
            // without them the error is still complete
            let keys = app.store.metadata.profile_keys(MAX_SEARCHED).await.unwrap_or_default();
            let near = near::sentence(&near::near(rig, lens, &keys));
            format!(
                "there is no profile for rig '{rig}' and lens '{lens}'{near}; calibrate it, or PUT /v1/profiles/{rig}/{lens} \
                 first"
            )
        }
        Some(revision) => format!(
            "the profile of rig '{rig}' and lens '{lens}' has no revision {revision}; GET /v1/profiles/{rig}/{lens}/revisions lists them"
        ),
    };
    ApiError::new(Code::ProfileNotFound, detail)
}

/// The response with a profile and its `ETag`, or 304 when the copy of the client is current.
fn response(headers: &HeaderMap, profile: &Profile) -> Response {
    let tag = profile.revision.to_string();
    let headers_out = [(header::ETAG, etag(&tag)), (header::CACHE_CONTROL, HeaderValue::from_static("no-cache"))];
    if not_modified(headers, &tag) {
        return (axum::http::StatusCode::NOT_MODIFIED, headers_out).into_response();
    }
    (headers_out, Json(profile)).into_response()
}

/// The condition of a write in `If-Match` and `If-None-Match`. `If-Match` holds if one of its tags is that of the
/// current revision.
async fn precondition(app: &App, key: &ProfileKey, headers: &HeaderMap) -> ApiResult<Precondition> {
    let revision = async { Ok(app.store.metadata.profile(&key.rig, &key.lens, None).await?.map(|p| p.revision)) };
    let condition = conditional::precondition(headers, revision).await?;
    condition.map_err(|current| precondition_failed(key, current, &header::IF_MATCH))
}

/// The error for a condition that does not hold.
fn precondition_failed(key: &ProfileKey, current: Option<u32>, header: &HeaderName) -> ApiError {
    let ProfileKey { rig, lens } = key;
    let now = match current {
        Some(revision) => format!("is at revision {revision}"),
        None => "does not exist".to_owned(),
    };
    let detail = format!(
        "the profile of rig '{rig}' and lens '{lens}' {now}, which does not satisfy {header}; read the profile again and \
         retry"
    );
    ApiError::new(Code::PreconditionFailed, detail)
}
