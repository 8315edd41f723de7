//! `HEAD /v1/uploads/{id}`

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode},
    response::{IntoResponse, Response},
};

use super::{
    complete::complete_if_whole,
    hold::{hold, not_refused},
    protocol::{UPLOAD_LENGTH, UPLOAD_METADATA, require_version, tell},
};
use crate::http::{
    background,
    extract::UploadId,
    problem::{ApiError, ApiResult},
    state::App,
};

/// Where is an upload?
///
/// Ends a request that still writes to the upload, so that the offset stays what it is. When all bytes are here and the job could not be
/// made before (the queue was full, the server went down), it is made now.
#[utoipa::path(
    head,
    path = "/v1/uploads/{id}",
    operation_id = "get_upload_offset",
    tag = "uploads",
    params(
        ("id" = String, Path, description = "Id of the upload"),
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
    ),
    responses(
        (status = 200, description = "There", headers(
            ("Upload-Offset" = u64, description = "Bytes on stable storage"),
            ("Upload-Length" = u64, description = "Bytes in all"),
            ("Upload-Metadata" = String, description = "As it came"),
            ("Upload-Expires" = String, description = "When it goes unless something comes before"),
            ("Pinstack-Job" = String, description = "The job, when the upload is complete"))),
        (status = 404, description = "`not_found`: no such upload, or its time is over"),
        (status = 412, description = "`precondition_failed`: another version of tus"),
        (status = 422, description = "What arrived was refused: `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light)"),
        (status = 423, description = "`locked`: another request does not let go; with `Retry-After`"),
        (status = 503, description = "`queue_full`: all bytes are here, ask again for the job"),
    )
)]
pub async fn head(State(app): State<App>, UploadId(id): UploadId, headers: HeaderMap) -> ApiResult<Response> {
    require_version(&headers)?;
    // to its end also when the client goes away meanwhile
    let asking = background::spawn(async move {
        let (mut held, _) = hold(&app, id).await?;
        not_refused(&held.upload)?;
        complete_if_whole(&app, &mut held).await?;
        ApiResult::Ok(held.upload)
    });
    let upload = asking.await.map_err(ApiError::internal)??;
    let mut response = StatusCode::OK.into_response();
    let headers = response.headers_mut();
    tell(headers, &upload);
    headers.insert(UPLOAD_LENGTH, HeaderValue::from(upload.length));
    if !upload.metadata.is_empty()
        && let Ok(metadata) = HeaderValue::from_str(&upload.metadata)
    {
        headers.insert(UPLOAD_METADATA, metadata);
    }
    Ok(response)
}
