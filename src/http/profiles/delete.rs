//! `DELETE /v1/profiles/{rig}/{lens}`

use axum::{extract::State, http::StatusCode};

use super::not_found;
use crate::{
    http::{
        ApiResult, App,
        extract::{Conditional, ProfileKey},
    },
    store::DeleteProfile,
};

/// Delete a profile
///
/// Finished stacks are not affected: they keep a copy of what they used. Waiting stacks are still fused with the
/// revision they name.
#[utoipa::path(
    delete,
    path = "/v1/profiles/{rig}/{lens}",
    operation_id = "delete_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("If-Match" = Option<String>, Header, description = "Only if this is the current revision"),
    ),
    responses(
        (status = 204, description = "The profile is deleted"),
        (status = 400, description = "`invalid_request`: an invalid name"),
        (status = 404, description = "`profile_not_found`"),
        (status = 412, description = "`precondition_failed`: the profile was changed in the meantime; read it again and retry"),
    )
)]
pub async fn delete(State(app): State<App>, key: Conditional<ProfileKey>) -> ApiResult<StatusCode> {
    let condition = key.precondition(&app).await?;
    let ProfileKey { rig, lens } = &key.of;
    match app.store.metadata.delete_profile(rig, lens, condition).await? {
        DeleteProfile::Deleted => Ok(StatusCode::NO_CONTENT),
        DeleteProfile::NotFound => Err(not_found(&app, rig, lens, None).await),
        DeleteProfile::PreconditionFailed(current) => Err(key.failed(current)),
    }
}
