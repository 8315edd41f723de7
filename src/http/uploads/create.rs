//! `POST /v1/uploads`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};
use uuid::Uuid;

use super::{
    checksum::Checksum,
    delete,
    digest::RunningDigest,
    metadata::Metadata,
    patch::receive_piece,
    protocol::{
        UPLOAD_CONCAT, UPLOAD_DEFER_LENGTH, UPLOAD_LENGTH, UPLOAD_OFFSET, bytes, is_piece, require_version, url,
        write_headers,
    },
    receive::require_fit,
};
use crate::{
    contract::{Code, JobKind, UploadPurpose},
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        background,
        ingest::{
            admission::require_admissible,
            body::too_large,
            quota::over_quota,
            receivable::Receivable,
            submission::{Submission, scan::ScanSubmission},
        },
    },
    store::{
        tokens::Scope,
        uploads::{CreateUpload, NewUpload, OpenUploadLimits, PartialUpload},
    },
};

/// Begin a resumable upload
///
/// tus 1.0.0: `creation`, and `creation-with-upload` when the request has a body. `Upload-Metadata` describes the
/// upload: `rig`, `lens`, `options` (JSON, as in a form), `filename`, and `purpose`: `stack` (the default),
/// `calibration` for a dot target, or `scan` for a zip with all views of the scan that `scan` names. Names, options,
/// profile, length, quota, disk space and queue are checked now. Send the bytes with `PATCH` to the URL in `Location`.
///
/// If the body of the request is refused and the upload can be continued, or the reason of its refusal read, the error
/// has `Location` and `Upload-Offset` too.
#[utoipa::path(
    post,
    path = "/v1/uploads",
    operation_id = "begin_upload",
    tag = "uploads",
    params(
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Length" = u64, Header, description = "Size of the zip, bytes"),
        ("Upload-Metadata" = Option<String>, Header, description = "`name base64,name base64`: rig, lens, options, filename, purpose, scan; for a scan also x, x_degrees_per_unit, x_zero, y, y_degrees_per_unit, y_zero"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha1` or `sha256` and the checksum of the body in base64"),
    ),
    request_body(description = "Empty, or the first bytes of the zip", content((Vec<u8> = "application/offset+octet-stream"))),
    responses(
        (status = 201, description = "The upload is created", headers(
            ("Location" = String, description = "URL of the upload"),
            ("Upload-Offset" = u64, description = "Bytes on stable storage"),
            ("Upload-Expires" = String, description = "When the upload expires unless more bytes arrive"),
            ("Pinstack-Job" = String, description = "URL of the job, if the body was the whole zip"))),
        (status = 400, description = "`invalid_request`: an invalid header, name or option; `upload_incomplete`: \
            the connection closed or timed out (what arrived is kept; continue at `Location`)"),
        (status = 404, description = "`profile_not_found`, `scan_not_found`"),
        (status = 409, description = "`conflict`: a newer request took over the upload"),
        (status = 412, description = "`precondition_failed`: `Tus-Resumable` is missing or names another version"),
        (status = 413, description = "`upload_too_large`: `Upload-Length` exceeds the limit, or the body extends \
            beyond it; there is no upload"),
        (status = 415, description = "`unsupported_media_type`: a body that is not `application/offset+octet-stream`"),
        (status = 422, description = "The body was the whole zip and is refused, as by `POST /v1/stacks`: `invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `mask_failed` (required without a back light). `scan_mismatch`: the scan is of \
            another rig or lens"),
        (status = 460, description = "`checksum_mismatch`: none of the body was stored; send it again to `Location`"),
        (status = 503, description = "`queue_full`: too many waiting jobs or open uploads; `unavailable`: the server is shutting down"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn create(State(app): State<App>, caller: Caller, headers: HeaderMap, body: Body) -> ApiResult<Response> {
    require_version(&headers)?;
    if headers.contains_key(UPLOAD_CONCAT) {
        let detail = "Upload-Concat (concatenation) is not supported: the parts of a parallel upload cannot be joined; \
                      switch off parallel uploads in the client (tus-js-client, Uppy: parallelUploads = 1)";
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    let checksum = Checksum::of_request(&headers)?;
    let brings_piece = is_piece(&headers);
    if !brings_piece && has_body(&headers) {
        let detail =
            "the body of a new upload must be empty, or the first bytes of the zip as application/offset+octet-stream";
        return Err(ApiError::new(Code::UnsupportedMediaType, detail));
    }
    let length = length(&headers)?;
    if brings_piece {
        require_fit(&headers, 0, length)?;
    }
    let mut upload = begin(&app, &caller, &headers, length).await?;
    if brings_piece {
        let id = upload.id;
        upload = match receive_piece(&app, &caller, &headers, id, body, 0, checksum).await {
            Ok(upload) => upload,
            Err(error) => return Err(refused(&app, id, error).await),
        };
    }
    let mut response = (StatusCode::CREATED, [(header::LOCATION, url(upload.id))]).into_response();
    write_headers(response.headers_mut(), &upload);
    Ok(response)
}

/// `Upload-Length`.
fn length(headers: &HeaderMap) -> ApiResult<u64> {
    if headers.contains_key(UPLOAD_DEFER_LENGTH) {
        let detail = "Upload-Defer-Length is not supported; send Upload-Length, the size of the zip in bytes";
        return Err(ApiError::new(Code::InvalidRequest, detail));
    }
    let length = bytes(headers, &UPLOAD_LENGTH)?;
    if length == 0 {
        return Err(ApiError::new(
            Code::InvalidRequest,
            "Upload-Length is 0, but an empty file is not a zip; send its size in bytes",
        ));
    }
    Ok(length)
}

/// The error for the first bytes of an upload that exists by now. The client learns its URL and offset. An upload whose
/// length is wrong cannot be continued: it is deleted, so that it does not count as open.
async fn refused(app: &App, id: Uuid, error: ApiError) -> ApiError {
    if error.fault().code == Code::UploadTooLarge {
        let (app, deleted) = (app.clone(), id);
        let deleting = background::to_the_end(async move { delete::remove(&app, deleted).await });
        if let Err(left) = deleting.await {
            tracing::warn!(detail = left.fault().detail, %id, "an upload of a wrong length is left until it expires");
        }
        return error;
    }
    match app.store.metadata.upload(id).await {
        Ok(None) => error,
        Ok(Some(upload)) => {
            error.with_header(header::LOCATION, url(id)).with_header(UPLOAD_OFFSET, upload.offset.to_string())
        }
        Err(unknown) => {
            tracing::warn!(error = ?unknown, %id, "the offset of an upload is not known");
            error.with_header(header::LOCATION, url(id))
        }
    }
}

async fn begin(app: &App, caller: &Caller, headers: &HeaderMap, length: u64) -> ApiResult<PartialUpload> {
    let (text, metadata) = Metadata::of_request(headers)?;
    let purpose = metadata.purpose()?;
    caller.require(match purpose {
        UploadPurpose::Stack | UploadPurpose::Scan => &[Scope::StacksWrite],
        UploadPurpose::Calibration => &[Scope::ProfilesWrite],
    })?;
    match purpose {
        UploadPurpose::Stack => require::<Submission>(app, caller, &JobKind::Stack, &metadata, length).await?,
        UploadPurpose::Calibration => {
            require::<Submission>(app, caller, &JobKind::Calibration, &metadata, length).await?;
        }
        UploadPurpose::Scan => {
            require::<ScanSubmission>(app, caller, &metadata.scan()?, &metadata, length).await?;
        }
    }
    let new = NewUpload {
        id: Uuid::now_v7(),
        length,
        digest: RunningDigest::default().state(),
        metadata: text,
        keep: app.policy.upload_keep,
        owner: caller.id(),
    };
    let limits = OpenUploadLimits { all: app.policy.queue_limit, of_owner: app.policy.max_open_uploads };
    match app.store.metadata.create_upload(&new, limits).await? {
        CreateUpload::Created(upload) => Ok(upload),
        CreateUpload::OverQuota(over) => Err(over_quota(length, &over)),
        CreateUpload::TooMany { of_owner } => {
            let (limit, whose) = match of_owner {
                true => (limits.of_owner, " of this token"),
                false => (limits.all, ""),
            };
            let detail = format!("{limit} uploads{whose} are open already; finish or delete some, or try again later");
            Err(ApiError::new(Code::QueueFull, detail))
        }
    }
}

/// Checks names, options, length, disk space, quota and queue.
async fn require<S: Receivable>(
    app: &App,
    caller: &Caller,
    target: &S::Target,
    metadata: &Metadata,
    length: u64,
) -> ApiResult<()> {
    if length > S::max_bytes(app) {
        return Err(too_large(S::max_bytes(app)).into());
    }
    let submission = S::read(app, caller, target, &metadata.fields()).await?;
    require_admissible(app, caller, length, submission.disk_need(length)).await
}

fn has_body(headers: &HeaderMap) -> bool {
    let is_empty = headers.get(header::CONTENT_LENGTH).is_none_or(|length| length == "0");
    !is_empty || headers.contains_key(header::TRANSFER_ENCODING)
}
