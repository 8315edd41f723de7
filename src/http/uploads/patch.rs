//! `PATCH /v1/uploads/{id}`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Method, StatusCode, header},
    response::{IntoResponse, Response},
};
use uuid::Uuid;

use super::{
    checksum::Checksum,
    complete::complete_if_whole,
    delete,
    lock::{UploadLock, lock, require_not_refused},
    protocol::{METHOD_OVERRIDE, UPLOAD_OFFSET, bytes, is_piece, require_version, write_headers},
    receive::{receive, require_fit},
};
use crate::{
    contract::Code,
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        background,
        extract::{Sent, UploadId},
        ingest::{
            body::{WatchedBody, content_length},
            quota::QuotaClaim,
            reservation::UploadReservation,
        },
    },
    store::uploads::{PartialUpload, UploadState},
};

/// Methods of the URL of an upload.
const METHODS: &str = "GET,HEAD,PATCH,DELETE,OPTIONS";

/// Continue an upload
///
/// Appends the body at `Upload-Offset`, which must equal the current offset of the upload. A request that is still
/// writing to the same upload is ended. The offset in the response counts bytes on stable storage. The request that
/// completes the upload makes the job, and `Pinstack-Job` names its URL. A zip that is refused, as by `POST
/// /v1/stacks`, is deleted.
#[utoipa::path(
    patch,
    path = "/v1/uploads/{id}",
    operation_id = "continue_upload",
    tag = "uploads",
    params(
        ("id" = String, Path, description = "Id of the upload"),
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Offset" = u64, Header, description = "Offset of the first byte of the body"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha1` or `sha256` and the checksum of the body in base64. With it, the body is stored as a whole or not at all"),
    ),
    request_body(description = "The next bytes of the zip", content((Vec<u8> = "application/offset+octet-stream"))),
    responses(
        (status = 204, description = "The bytes are on stable storage", headers(
            ("Upload-Offset" = u64, description = "Bytes on stable storage"),
            ("Upload-Expires" = String, description = "When the upload expires unless more bytes arrive"),
            ("Pinstack-Job" = String, description = "URL of the job, once the upload is complete"))),
        (status = 400, description = "`invalid_request`: an invalid header, or an option that the zip does not allow; \
            `upload_incomplete`: the connection closed or timed out (what arrived is kept)"),
        (status = 404, description = "`not_found`: no such upload, or it has expired; `profile_not_found`, \
            `scan_not_found`: the profile or the scan was deleted meanwhile"),
        (status = 409, description = "`conflict`: the upload is at another offset, or a newer request took over the upload"),
        (status = 412, description = "`precondition_failed`: `Tus-Resumable` is missing or names another version"),
        (status = 413, description = "`upload_too_large`: the body extends beyond `Upload-Length`"),
        (status = 415, description = "`unsupported_media_type`: the body is not `application/offset+octet-stream`"),
        (status = 422, description = "The zip is refused, as by `POST /v1/stacks`: `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light). `scan_mismatch`: the scan is of \
            another rig or lens by now"),
        (status = 423, description = "`locked`: another request is still writing; try again after `Retry-After`"),
        (status = 460, description = "`checksum_mismatch`: none of the body was stored"),
        (status = 503, description = "`queue_full`: all bytes are stored; `HEAD` makes the job later; `unavailable`: the server is shutting down"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn patch(State(app): State<App>, caller: Caller, UploadId(id): UploadId, sent: Sent) -> ApiResult<Response> {
    let Sent { headers, body, .. } = sent;
    require_version(&headers)?;
    if !is_piece(&headers) {
        let detail = "the Content-Type of PATCH must be application/offset+octet-stream";
        return Err(ApiError::new(Code::UnsupportedMediaType, detail));
    }
    let offset = bytes(&headers, &UPLOAD_OFFSET)?;
    let checksum = Checksum::of_request(&headers)?;
    let upload = receive_piece(&app, &caller, &headers, id, body, offset, checksum).await?;
    let mut response = StatusCode::NO_CONTENT.into_response();
    write_headers(response.headers_mut(), &upload);
    Ok(response)
}

/// `POST` with `X-HTTP-Method-Override`, for clients behind proxies that pass only GET and POST.
///
/// # Errors
/// Those of the method in the header.
pub async fn overridden(app: State<App>, caller: Caller, id: UploadId, sent: Sent) -> ApiResult<Response> {
    let method = sent.headers.get(METHOD_OVERRIDE).and_then(|value| Method::from_bytes(value.as_bytes()).ok());
    match method {
        Some(Method::PATCH) => patch(app, caller, id, sent).await,
        Some(Method::DELETE) => delete::delete(app, id, sent.headers).await.map(IntoResponse::into_response),
        _ => {
            let detail = "POST to an upload needs the header X-HTTP-Method-Override: PATCH or DELETE";
            Err(ApiError::new(Code::MethodNotAllowed, detail).with_header(header::ALLOW, METHODS))
        }
    }
}

/// Appends a body to an upload. What arrived is stored even when the client disconnects.
///
/// # Errors
/// What is wrong with the body, or with the whole zip if this was its end.
pub async fn receive_piece(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    id: Uuid,
    body: Body,
    offset: u64,
    checksum: Option<Checksum>,
) -> ApiResult<PartialUpload> {
    let body = WatchedBody::new(body, headers, u64::MAX, app.policy.body_idle_timeout);
    let (app, caller, headers) = (app.clone(), caller.clone(), headers.clone());
    background::to_the_end(async move {
        let (mut locked, takeover) = lock(&app, id).await?;
        require_not_refused(&locked.upload)?;
        require_offset(&locked, offset)?;
        if locked.upload.state == UploadState::Receiving {
            require_fit(&headers, offset, locked.upload.length)?;
            if offset < locked.upload.length {
                // the store has counted the whole upload since its creation
                let quota = QuotaClaim::default();
                let announced = content_length(&headers).unwrap_or(locked.upload.length - offset);
                let reservation = UploadReservation::admit(&app, caller.id(), Some(announced), 0, quota).await?;
                receive(&app, &mut locked, takeover, body, checksum, reservation).await?;
            }
            complete_if_whole(&app, &mut locked).await?;
        }
        Ok(locked.upload)
    })
    .await
}

fn require_offset(locked: &UploadLock, offset: u64) -> ApiResult<()> {
    let at = locked.upload.offset;
    if offset == at {
        return Ok(());
    }
    let detail = format!(
        "the upload is at byte {at}, but the body begins at byte {offset}; get the offset with HEAD and continue from there"
    );
    Err(ApiError::new(Code::Conflict, detail).with_header(UPLOAD_OFFSET, at.to_string()))
}
