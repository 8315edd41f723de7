//! Stores a profile as the next revision, whatever it was made from.

use axum::{
    Json,
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};

use super::precondition_failed;
use crate::{
    contract::profile::{Profile, ProfileSource},
    http::{
        extract::{ProfileKey, conditional::etag},
        problem::ApiResult,
        state::App,
    },
    store::{Precondition, ProfileDraft, PutProfile},
};
use pinstack_science::types::{
    Warning,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
};

/// The revision to store for numbers that were not measured by this service.
pub(super) fn draft(input: ProfileInput, model: HomographyModel, warnings: Vec<Warning>) -> ProfileDraft {
    ProfileDraft {
        source: ProfileSource::Upload,
        calibration_id: None,
        model,
        slices: ProfileSlice::all_given(&input),
        input,
        origin: None,
        warnings,
    }
}

/// Stores the next revision and returns it: 201 for the first revision, 200 for later ones.
///
/// # Errors
/// `precondition_failed` when the condition no longer holds.
pub(super) async fn store(
    app: &App,
    key: &ProfileKey,
    draft: &ProfileDraft,
    condition: Precondition,
) -> ApiResult<Response> {
    let (status, profile) = match app.store.metadata.put_profile(&key.rig, &key.lens, draft, condition).await? {
        PutProfile::Created(profile) => (StatusCode::CREATED, profile),
        PutProfile::Updated(profile) => (StatusCode::OK, profile),
        PutProfile::PreconditionFailed(current) => {
            return Err(precondition_failed(key, current, &header_of(condition)));
        }
    };
    Ok(written(key, status, &profile))
}

/// The response to a write.
pub(super) fn written(key: &ProfileKey, status: StatusCode, profile: &Profile) -> Response {
    let tag = etag(&profile.revision.to_string());
    let mut response = (status, [(header::ETAG, tag)], Json(profile)).into_response();
    if status == StatusCode::CREATED
        && let Ok(location) = format!("/v1/profiles/{}/{}", key.rig, key.lens).parse()
    {
        response.headers_mut().insert(header::LOCATION, location);
    }
    response
}

/// The header that states this condition.
pub(super) fn header_of(condition: Precondition) -> header::HeaderName {
    if condition == Precondition::Absent { header::IF_NONE_MATCH } else { header::IF_MATCH }
}
