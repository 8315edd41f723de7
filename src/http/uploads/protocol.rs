//! The headers of tus 1.0.0, and those that every response of it carries.

use axum::{
    extract::Request,
    http::{HeaderMap, HeaderName, HeaderValue, header},
    middleware::Next,
    response::Response,
};
use jiff::{Timestamp, fmt::rfc2822::DateTimePrinter};
use uuid::Uuid;

use super::metadata::Metadata;
use crate::{
    contract::{Code, JobKind, UploadPurpose},
    http::{ApiError, ApiResult, ingest::body::media_type, views::job::url_of},
    store::uploads::{PartialUpload, UploadState},
};

/// Version of the protocol, in every request and response.
pub const TUS_RESUMABLE: HeaderName = HeaderName::from_static("tus-resumable");
/// Supported versions.
pub const TUS_VERSION: HeaderName = HeaderName::from_static("tus-version");
/// Supported extensions.
pub const TUS_EXTENSION: HeaderName = HeaderName::from_static("tus-extension");
/// Largest upload, bytes.
pub const TUS_MAX_SIZE: HeaderName = HeaderName::from_static("tus-max-size");
/// Supported checksum algorithms.
pub const TUS_CHECKSUM_ALGORITHM: HeaderName = HeaderName::from_static("tus-checksum-algorithm");
/// Bytes on stable storage.
pub const UPLOAD_OFFSET: HeaderName = HeaderName::from_static("upload-offset");
/// Size of the upload, bytes.
pub const UPLOAD_LENGTH: HeaderName = HeaderName::from_static("upload-length");
/// When the upload expires unless more bytes arrive.
pub const UPLOAD_EXPIRES: HeaderName = HeaderName::from_static("upload-expires");
/// Checksum of the body of one request.
pub const UPLOAD_CHECKSUM: HeaderName = HeaderName::from_static("upload-checksum");
/// Marks a part of a parallel upload, or joins the parts; not supported.
pub const UPLOAD_CONCAT: HeaderName = HeaderName::from_static("upload-concat");
/// Announces that the length comes later; not supported.
pub const UPLOAD_DEFER_LENGTH: HeaderName = HeaderName::from_static("upload-defer-length");
/// For clients behind proxies that pass only GET and POST.
pub const METHOD_OVERRIDE: HeaderName = HeaderName::from_static("x-http-method-override");
/// URL of the job, or of the scan, that was made from the upload.
pub const PINSTACK_JOB: HeaderName = HeaderName::from_static("pinstack-job");

/// The supported version.
pub const VERSION: HeaderValue = HeaderValue::from_static("1.0.0");
/// Media type of a body that carries bytes of an upload.
pub const PIECE: &str = "application/offset+octet-stream";

/// Middleware: every response under `/v1/uploads` names the version.
pub async fn name_version(request: Request, next: Next) -> Response {
    let is_upload = request.uri().path().starts_with("/v1/uploads");
    let mut response = next.run(request).await;
    if is_upload {
        response.headers_mut().insert(TUS_RESUMABLE, VERSION);
    }
    response
}

/// Refuses a request that does not name the supported version.
///
/// # Errors
/// `precondition_failed` with the supported version.
pub fn require_version(headers: &HeaderMap) -> ApiResult<()> {
    if headers.get(TUS_RESUMABLE).is_some_and(|version| *version == VERSION) {
        return Ok(());
    }
    let detail = "this URL implements tus 1.0.0: send the header Tus-Resumable: 1.0.0, or use a tus client; to send a \
                  zip in one request, use POST /v1/stacks";
    Err(ApiError::new(Code::PreconditionFailed, detail).with_header(TUS_VERSION, VERSION))
}

/// The value of a header that is a number of bytes.
///
/// # Errors
/// `invalid_request` when it is missing or not a whole number.
pub fn bytes(headers: &HeaderMap, name: &HeaderName) -> ApiResult<u64> {
    let refuse = |what: String| Err(ApiError::new(Code::InvalidRequest, what));
    let Some(value) = headers.get(name) else {
        return refuse(format!("the header {name} is missing; send a number of bytes"));
    };
    match value.to_str().ok().filter(|text| text.bytes().all(|b| b.is_ascii_digit())).and_then(|text| text.parse().ok())
    {
        Some(number) => Ok(number),
        None => refuse(format!("the header {name} is {value:?}; it must be a number of bytes")),
    }
}

/// True when the body carries bytes of an upload.
pub fn is_piece(headers: &HeaderMap) -> bool {
    media_type(headers).is_some_and(|kind| kind == PIECE)
}

/// URL of an upload.
pub fn url(id: Uuid) -> String {
    link!("/v1/uploads/{id}")
}

/// URL of what was made from an upload: the job, or the scan. `None` before.
pub fn job_url(upload: &PartialUpload) -> Option<String> {
    let id = upload.id;
    let UploadState::Complete(purpose) = upload.state else { return None };
    Some(match purpose {
        UploadPurpose::Stack => url_of(JobKind::Stack, id),
        UploadPurpose::Calibration => url_of(JobKind::Calibration, id),
        UploadPurpose::Scan => link!("/v1/scans/{}", Metadata::parse(&upload.metadata).ok()?.scan().ok()?),
    })
}

/// Writes the headers that describe the state of an upload.
pub fn write_headers(headers: &mut HeaderMap, upload: &PartialUpload) {
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(UPLOAD_OFFSET, HeaderValue::from(upload.offset));
    if let Some(date) = http_date(upload.expires_at) {
        headers.insert(UPLOAD_EXPIRES, date);
    }
    if let Some(Ok(job)) = job_url(upload).map(|url| HeaderValue::from_str(&url)) {
        headers.insert(PINSTACK_JOB, job);
    }
}

fn http_date(time: Timestamp) -> Option<HeaderValue> {
    let text = DateTimePrinter::new().timestamp_to_rfc9110_string(&time).ok()?;
    HeaderValue::from_str(&text).ok()
}
