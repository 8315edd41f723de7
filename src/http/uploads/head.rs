//! `HEAD /v1/uploads/{id}`

use axum::{
    extract::State,
    http::{HeaderMap, HeaderValue, StatusCode},
    response::{IntoResponse, Response},
};

use super::{
    complete::complete_if_whole,
    lock::{lock, require_not_refused},
    metadata::UPLOAD_METADATA,
    protocol::{UPLOAD_LENGTH, require_version, write_headers},
};
use crate::http::{ApiResult, App, background, extract::UploadId};

/// Get the offset of an upload
///
/// Ends a request that is still writing to the upload, so that the offset in the response is final. If all bytes are
/// stored and the job could not be made before (the queue was full, or the server was shut down), it is made now.
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
        (status = 200, description = "Offset and length of the upload", headers(
            ("Upload-Offset" = u64, description = "Bytes on stable storage"),
            ("Upload-Length" = u64, description = "Size of the zip, bytes"),
            ("Upload-Metadata" = String, description = "As the client sent it"),
            ("Upload-Expires" = String, description = "When the upload expires unless more bytes arrive"),
            ("Pinstack-Job" = String, description = "URL of the job, once the upload is complete"))),
        (status = 400, description = "`invalid_request`: an option that the zip does not allow, such as `input_bits` \
            with 8-bit slices"),
        (status = 404, description = "`not_found`: no such upload, or it has expired; `profile_not_found`, \
            `scan_not_found`: the profile or the scan was deleted meanwhile"),
        (status = 412, description = "`precondition_failed`: `Tus-Resumable` is missing or names another version"),
        (status = 422, description = "The zip was refused: `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light). `scan_mismatch`: the scan is of \
            another rig or lens by now"),
        (status = 423, description = "`locked`: another request is still writing; try again after `Retry-After`"),
        (status = 503, description = "`queue_full`: all bytes are stored; ask again later for the job"),
        (status = 507, description = "`insufficient_storage`, with figures: all bytes are stored; ask again later for \
            the job"),
    )
)]
pub async fn head(State(app): State<App>, UploadId(id): UploadId, headers: HeaderMap) -> ApiResult<Response> {
    require_version(&headers)?;
    let asking = background::to_the_end(async move {
        let (mut locked, _) = lock(&app, id).await?;
        require_not_refused(&locked.upload)?;
        complete_if_whole(&app, &mut locked).await?;
        Ok(locked.upload)
    });
    let upload = asking.await?;
    let mut response = StatusCode::OK.into_response();
    let headers = response.headers_mut();
    write_headers(headers, &upload);
    headers.insert(UPLOAD_LENGTH, HeaderValue::from(upload.length));
    if !upload.metadata.is_empty()
        && let Ok(metadata) = HeaderValue::from_str(&upload.metadata)
    {
        headers.insert(UPLOAD_METADATA, metadata);
    }
    Ok(response)
}
