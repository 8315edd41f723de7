//! How a profile becomes a revision, whatever it was made from.

use axum::{
    Json,
    http::{StatusCode, header},
    response::{IntoResponse, Response},
};

use super::lost_race;
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

/// What follows from numbers that were not measured here.
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

/// Stores the next revision and shows it: 201 for the first, 200 after.
///
/// # Errors
/// `precondition_failed` when the condition does not hold any more.
pub(super) async fn store(
    app: &App,
    key: &ProfileKey,
    draft: &ProfileDraft,
    condition: Precondition,
) -> ApiResult<Response> {
    let (status, profile) = match app.store.metadata.put_profile(&key.rig, &key.lens, draft, condition).await? {
        PutProfile::Created(profile) => (StatusCode::CREATED, profile),
        PutProfile::Updated(profile) => (StatusCode::OK, profile),
        PutProfile::PreconditionFailed(current) => return Err(lost_race(key, current, &demanding(condition))),
    };
    Ok(written(key, status, &profile))
}

/// The answer to a write.
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

/// The header that makes this demand.
pub(super) fn demanding(condition: Precondition) -> header::HeaderName {
    if condition == Precondition::Absent { header::IF_NONE_MATCH } else { header::IF_MATCH }
}
