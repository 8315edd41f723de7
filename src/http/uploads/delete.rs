//! `DELETE /v1/uploads/{id}`

use axum::{
    extract::State,
    http::{HeaderMap, StatusCode},
};

use uuid::Uuid;

use super::{lock::lock, protocol::require_version};
use crate::{
    http::{ApiResult, App, background, extract::UploadId},
    store::gc::gc_upload,
};

/// Delete an upload
///
/// Its bytes are deleted. A job that was made from it is kept; delete the job at its own URL.
#[utoipa::path(
    delete,
    path = "/v1/uploads/{id}",
    operation_id = "delete_upload",
    tag = "uploads",
    params(
        ("id" = String, Path, description = "Id of the upload"),
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
    ),
    responses(
        (status = 204, description = "It is deleted"),
        (status = 404, description = "`not_found`: no such upload, or it has expired"),
        (status = 412, description = "`precondition_failed`: `Tus-Resumable` is missing or names another version"),
        (status = 423, description = "`locked`: another request is still writing; try again after `Retry-After`"),
    )
)]
pub async fn delete(State(app): State<App>, UploadId(id): UploadId, headers: HeaderMap) -> ApiResult<StatusCode> {
    require_version(&headers)?;
    background::to_the_end(async move { remove(&app, id).await }).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Deletes an upload and its bytes.
///
/// # Errors
/// `not_found`; `locked` when another request is still writing to it.
pub async fn remove(app: &App, id: Uuid) -> ApiResult<()> {
    let (_lock, _) = lock(app, id).await?;
    app.store.metadata.delete_upload(id).await?;
    if let Err(error) = gc_upload(&app.store, id).await {
        tracing::warn!(?error, %id, "files of an upload are left to garbage collection");
    }
    Ok(())
}
