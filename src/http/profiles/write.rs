//! Stores a profile as the next revision, whatever it was made from.

use axum::response::Response;

use crate::{
    contract::profile::ProfileSource,
    http::{
        ApiResult, App,
        extract::{Conditional, ProfileKey},
    },
    store::{Precondition, ProfileDraft, PutProfile},
};
use pinstack_science::types::{
    Warning,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
};

/// The revision to store for numbers that were not measured by this service.
pub fn draft(input: ProfileInput, model: HomographyModel, warnings: Vec<Warning>) -> ProfileDraft {
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
    key: &Conditional<ProfileKey>,
    draft: &ProfileDraft,
    condition: Precondition,
) -> ApiResult<Response> {
    match app.store.metadata.put_profile(&key.of.rig, &key.of.lens, draft, condition).await? {
        PutProfile::Created(profile) => Ok(key.written(true, profile.revision, &profile)),
        PutProfile::Updated(profile) => Ok(key.written(false, profile.revision, &profile)),
        PutProfile::PreconditionFailed(current) => Err(key.failed(current)),
    }
}
