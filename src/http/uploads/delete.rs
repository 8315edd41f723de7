//! `DELETE /v1/uploads/{id}`

use axum::{
    extract::State,
    http::{HeaderMap, StatusCode},
};

use super::{hold::hold, protocol::require_version};
use crate::{
    http::{
        background,
        extract::UploadId,
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::gc::gc_upload,
};

/// End an upload
///
/// Its bytes go. A job that it became stays: `DELETE` that.
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
        (status = 204, description = "It is gone"),
        (status = 404, description = "`not_found`: no such upload, or its time is over"),
        (status = 412, description = "`precondition_failed`: another version of tus"),
        (status = 423, description = "`locked`: another request does not let go; with `Retry-After`"),
    )
)]
pub async fn delete(State(app): State<App>, UploadId(id): UploadId, headers: HeaderMap) -> ApiResult<StatusCode> {
    require_version(&headers)?;
    let ending = background::spawn(async move {
        let (_held, _) = hold(&app, id).await?;
        app.rows.delete_upload(id).await?;
        if let Err(error) = gc_upload(&*app.rows, &*app.blobs, id).await {
            tracing::warn!(?error, %id, "what an upload left cannot be removed now; the next sweep will");
        }
        ApiResult::Ok(StatusCode::NO_CONTENT)
    });
    ending.await.map_err(ApiError::internal)?
}
