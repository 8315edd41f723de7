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
    hold::{Held, hold, not_refused},
    protocol::{METHOD_OVERRIDE, UPLOAD_OFFSET, bytes, is_piece, require_version, tell},
    receive::{receive, require_fit},
};
use crate::{
    contract::Code,
    http::{
        auth::Caller,
        background,
        extract::UploadId,
        intake::{
            admission::{content_length, waits_for_continue},
            body::WatchedBody,
            quota::QuotaClaim,
            reservation::UploadReservation,
        },
        problem::{ApiError, ApiResult},
        state::App,
    },
    store::uploads::{PartialUpload, UploadState},
};

/// What an upload can be asked by.
const METHODS: &str = "GET,HEAD,PATCH,DELETE,OPTIONS";

/// Go on with an upload
///
/// The body is added at `Upload-Offset`, which must be where the upload is. It ends a request that still writes to the same upload. The
/// offset in the answer names bytes on stable storage. The piece that completes the upload makes the job: `Pinstack-Job` names it, and
/// a zip that is refused is refused here, as at `POST /v1/stacks`; it is gone then.
#[utoipa::path(
    patch,
    path = "/v1/uploads/{id}",
    operation_id = "continue_upload",
    tag = "uploads",
    params(
        ("id" = String, Path, description = "Id of the upload"),
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Offset" = u64, Header, description = "Where the body begins"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha1` or `sha256` and the checksum of the body in base64; the body is kept whole or not at all then"),
    ),
    request_body(description = "The piece", content((Vec<u8> = "application/offset+octet-stream"))),
    responses(
        (status = 204, description = "It is on stable storage", headers(
            ("Upload-Offset" = u64, description = "Bytes on stable storage"),
            ("Upload-Expires" = String, description = "When the upload goes unless something comes before"),
            ("Pinstack-Job" = String, description = "The job, when the upload is complete"))),
        (status = 400, description = "`invalid_request`: a header that breaks its rule; `upload_incomplete`: the body broke off (what arrived is kept)"),
        (status = 404, description = "`not_found`: no such upload, or its time is over; `profile_not_found`: deleted meanwhile"),
        (status = 409, description = "`conflict`: the upload is at another offset, or a newer request took it over"),
        (status = 412, description = "`precondition_failed`: another version of tus"),
        (status = 413, description = "`upload_too_large`: the body goes beyond Upload-Length"),
        (status = 415, description = "`unsupported_media_type`: the body is no piece"),
        (status = 422, description = "The zip is refused as at `POST /v1/stacks`: `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light)"),
        (status = 423, description = "`locked`: another request does not let go; with `Retry-After`"),
        (status = 460, description = "`checksum_mismatch`: none of the body was kept"),
        (status = 503, description = "`queue_full`: all bytes are here, the job can be made later: ask by HEAD; `unavailable`: the server goes down"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn patch(
    State(app): State<App>,
    caller: Caller,
    UploadId(id): UploadId,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    require_version(&headers)?;
    if !is_piece(&headers) {
        let detail = "the body of PATCH must be application/offset+octet-stream";
        return Err(ApiError::new(Code::UnsupportedMediaType, detail));
    }
    let offset = bytes(&headers, &UPLOAD_OFFSET)?;
    let checksum = Checksum::of_request(&headers)?;
    let upload = receive_piece(&app, &caller, &headers, id, body, offset, checksum).await?;
    let mut response = StatusCode::NO_CONTENT.into_response();
    tell(response.headers_mut(), &upload);
    Ok(response)
}

/// `POST` with `X-HTTP-Method-Override`, for clients behind proxies that let no other method through.
///
/// # Errors
/// As the method that is meant.
pub async fn overridden(
    app: State<App>,
    caller: Caller,
    id: UploadId,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    let meant = headers.get(METHOD_OVERRIDE).and_then(|value| Method::from_bytes(value.as_bytes()).ok());
    match meant {
        Some(Method::PATCH) => patch(app, caller, id, headers, body).await,
        Some(Method::DELETE) => delete::delete(app, id, headers).await.map(IntoResponse::into_response),
        _ => {
            let detail =
                "POST to an upload must name the method that is meant: X-HTTP-Method-Override: PATCH or DELETE";
            Err(ApiError::new(Code::MethodNotAllowed, detail).with_header(header::ALLOW, METHODS))
        }
    }
}

/// Adds a body to an upload, to its end also when the client goes away meanwhile.
///
/// # Errors
/// Whatever is wrong with the piece, or with the whole when this was the last.
pub async fn receive_piece(
    app: &App,
    caller: &Caller,
    headers: &HeaderMap,
    id: Uuid,
    body: Body,
    offset: u64,
    checksum: Option<Checksum>,
) -> ApiResult<PartialUpload> {
    let body = WatchedBody::new(body, u64::MAX, app.policy.body_idle_timeout, waits_for_continue(headers));
    let (app, caller, headers) = (app.clone(), caller.clone(), headers.clone());
    let receiving = background::spawn(async move {
        let (mut held, rival) = hold(&app, id).await?;
        not_refused(&held.upload)?;
        require_offset(&held, offset)?;
        if held.upload.state == UploadState::Receiving {
            require_fit(&headers, offset, held.upload.length)?;
            if offset < held.upload.length {
                // the store counts the whole upload since it began
                let quota = QuotaClaim::default();
                let announced = content_length(&headers).unwrap_or(held.upload.length - offset);
                let reservation = UploadReservation::admit(&app, caller.id(), Some(announced), 0, quota).await?;
                receive(&app, &mut held, rival, body, checksum, reservation).await?;
            }
            complete_if_whole(&app, &mut held).await?;
        }
        Ok(held.upload)
    });
    receiving.await.map_err(ApiError::internal)?
}

fn require_offset(held: &Held, offset: u64) -> ApiResult<()> {
    let at = held.upload.offset;
    if offset == at {
        return Ok(());
    }
    let detail = format!(
        "the upload is at byte {at}, the body begins at byte {offset}; ask for the offset by HEAD and go on from there"
    );
    Err(ApiError::new(Code::Conflict, detail).with_header(UPLOAD_OFFSET, at.to_string()))
}
