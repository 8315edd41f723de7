//! `DELETE /v1/profiles/{rig}/{lens}`

use axum::{
    extract::State,
    http::{HeaderMap, StatusCode, header},
};

use super::{lost_race, not_found, precondition};
use crate::http::{extract::ProfileKey, problem::ApiResult, state::App};

/// Delete a profile
///
/// Stacks already made keep their own copy of what they used; stacks that wait still use the revision they name.
#[utoipa::path(
    delete,
    path = "/v1/profiles/{rig}/{lens}",
    operation_id = "delete_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("If-Match" = Option<String>, Header, description = "Only when this is the current revision"),
    ),
    responses(
        (status = 204, description = "It is gone"),
        (status = 400, description = "`invalid_request`: a name that breaks its rule"),
        (status = 404, description = "`profile_not_found`"),
        (status = 412, description = "`precondition_failed`: somebody else was faster"),
    )
)]
pub async fn delete(State(app): State<App>, key: ProfileKey, headers: HeaderMap) -> ApiResult<StatusCode> {
    let condition = precondition(&app, &key, &headers).await?;
    match app.store.metadata.delete_profile(&key.rig, &key.lens, condition).await? {
        Ok(true) => Ok(StatusCode::NO_CONTENT),
        Ok(false) => Err(not_found(&app, &key.rig, &key.lens, None).await),
        Err(current) => Err(lost_race(&key, current, &header::IF_MATCH)),
    }
}
