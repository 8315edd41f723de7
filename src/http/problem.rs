//! The only place where an error becomes a status.
//!
//! Handlers return [`ApiResult`]; every [`ApiError`] becomes `application/problem+json` (RFC 9457). What the
//! client reads is the fault's own sentence; what only the log may know (SQL, paths, causes) goes to the log
//! here and nowhere else.

use axum::{
    body::Body,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};

use crate::{
    contract::{Code, Fault, Problem},
    store::StoreError,
};

/// Media type of every error.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// What a handler returns.
pub type ApiResult<T> = Result<T, ApiError>;

/// A fault on its way to the client, with the headers that belong to it.
#[derive(Debug)]
pub struct ApiError {
    fault: Fault,
    // boxed: it travels in every Result, and is hardly ever there
    headers: Box<HeaderMap>,
}

impl ApiError {
    /// A fault with a code and a sentence.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        Fault::new(code, detail).into()
    }

    /// Our own fault: the cause goes to the log, the client learns the request id only.
    pub fn internal(cause: impl std::fmt::Display) -> Self {
        tracing::error!(%cause, "internal error");
        Self::new(
            Code::Internal,
            "something went wrong on the server; the request id in X-Request-Id finds the details in its log",
        )
    }

    /// Adds a header to the answer.
    #[must_use]
    pub fn with_header(mut self, name: HeaderName, value: impl TryInto<HeaderValue>) -> Self {
        if let Ok(value) = value.try_into() {
            self.headers.insert(name, value);
        }
        self
    }

    /// The fault.
    pub fn fault(&self) -> &Fault {
        &self.fault
    }
}

impl From<pinstack_science::types::Error> for ApiError {
    fn from(error: pinstack_science::types::Error) -> Self {
        Fault::from(error).into()
    }
}

impl From<Fault> for ApiError {
    fn from(fault: Fault) -> Self {
        let mut headers = HeaderMap::new();
        match fault.code {
            Code::QueueFull => _ = headers.insert(header::RETRY_AFTER, HeaderValue::from_static("30")),
            Code::Locked | Code::TooManyRequests => {
                _ = headers.insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
            }
            Code::Unavailable => _ = headers.insert(header::RETRY_AFTER, HeaderValue::from_static("5")),
            Code::Unauthorized => _ = headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer")),
            _ => {}
        }
        Self { fault, headers: Box::new(headers) }
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::DiskFull(cause) => {
                tracing::error!(%cause, "no room left");
                Self::new(Code::InsufficientStorage, "no room is left on the disk of the server; nothing was stored")
            }
            StoreError::InvalidCursor => Self::new(
                Code::InvalidRequest,
                "the cursor is none of this list; take next_cursor of the page before, or leave it away",
            ),
            StoreError::Other(cause) => Self::internal(format!("{cause:#}")),
        }
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let mut response = render(problem(&self.fault, None));
        response.headers_mut().extend(*self.headers);
        response
    }
}

/// The problem that a fault is shown as; `instance` is the request or the job that it happened to.
pub fn problem(fault: &Fault, instance: Option<String>) -> Problem {
    Problem {
        kind: format!("/problems/{}", code_name(fault.code)),
        title: title(fault.code).to_owned(),
        status: status(fault.code).as_u16(),
        detail: fault.detail.clone(),
        instance,
        code: fault.code,
        errors: fault.locations.clone(),
    }
}

/// The answer that carries a problem. The problem also travels as an extension, so that the outermost layer
/// can fill in the instance.
pub fn render(problem: Problem) -> Response {
    let status = StatusCode::from_u16(problem.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let body = serde_json::to_vec(&problem).unwrap_or_default();
    let mut response = Response::new(Body::from(body));
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    response.extensions_mut().insert(problem);
    response
}

/// The code as the contract spells it.
pub fn code_name(code: Code) -> String {
    code.name()
}

/// The status that each code is answered with.
pub fn status(code: Code) -> StatusCode {
    match code {
        Code::InvalidRequest | Code::UploadIncomplete => StatusCode::BAD_REQUEST,
        Code::Unauthorized => StatusCode::UNAUTHORIZED,
        Code::Forbidden | Code::CrossOriginRequest => StatusCode::FORBIDDEN,
        Code::MisdirectedRequest => StatusCode::MISDIRECTED_REQUEST,
        Code::TooManyRequests => StatusCode::TOO_MANY_REQUESTS,
        Code::NotFound | Code::ProfileNotFound | Code::NoResult => StatusCode::NOT_FOUND,
        Code::MethodNotAllowed => StatusCode::METHOD_NOT_ALLOWED,
        Code::MethodNotImplemented => StatusCode::NOT_IMPLEMENTED,
        Code::NotAcceptable => StatusCode::NOT_ACCEPTABLE,
        Code::UploadRemoved => StatusCode::GONE,
        Code::NotFinished | Code::Conflict => StatusCode::CONFLICT,
        Code::PreconditionFailed => StatusCode::PRECONDITION_FAILED,
        Code::UploadTooLarge => StatusCode::PAYLOAD_TOO_LARGE,
        Code::UnsupportedMediaType => StatusCode::UNSUPPORTED_MEDIA_TYPE,
        Code::Locked => StatusCode::LOCKED,
        Code::ChecksumMismatch => checksum_mismatch(),
        Code::RangeNotSatisfiable => StatusCode::RANGE_NOT_SATISFIABLE,
        Code::IdempotencyKeyReused
        | Code::InvalidArchive
        | Code::UnsupportedArchive
        | Code::ArchiveTooLarge
        | Code::InvalidImage
        | Code::SizeMismatch
        | Code::SliceCountMismatch
        | Code::InvalidProfile
        | Code::TargetNotFound
        | Code::MaskFailed => StatusCode::UNPROCESSABLE_ENTITY,
        Code::QueueFull | Code::Unavailable => StatusCode::SERVICE_UNAVAILABLE,
        Code::InsufficientStorage => StatusCode::INSUFFICIENT_STORAGE,
        Code::WorkerLost | Code::Internal => StatusCode::INTERNAL_SERVER_ERROR,
    }
}

/// tus has a status of its own for a wrong checksum.
fn checksum_mismatch() -> StatusCode {
    StatusCode::from_u16(460).unwrap_or(StatusCode::BAD_REQUEST)
}

/// The code that fits a bare status, for answers that libraries make without asking us.
pub fn code_of(status: StatusCode) -> Code {
    match status {
        StatusCode::UNAUTHORIZED => Code::Unauthorized,
        StatusCode::FORBIDDEN => Code::Forbidden,
        StatusCode::NOT_FOUND => Code::NotFound,
        StatusCode::METHOD_NOT_ALLOWED => Code::MethodNotAllowed,
        StatusCode::NOT_IMPLEMENTED => Code::MethodNotImplemented,
        StatusCode::NOT_ACCEPTABLE => Code::NotAcceptable,
        StatusCode::PAYLOAD_TOO_LARGE => Code::UploadTooLarge,
        StatusCode::UNSUPPORTED_MEDIA_TYPE => Code::UnsupportedMediaType,
        StatusCode::SERVICE_UNAVAILABLE => Code::Unavailable,
        status if status.is_client_error() => Code::InvalidRequest,
        _ => Code::Internal,
    }
}

/// Short, the same for every problem of a code.
pub fn title(code: Code) -> &'static str {
    match code {
        Code::InvalidRequest => "The request breaks a rule of the contract",
        Code::Unauthorized => "A token is needed",
        Code::Forbidden => "The token does not allow this",
        Code::CrossOriginRequest => "Cross-origin request refused",
        Code::MisdirectedRequest => "Misdirected request",
        Code::TooManyRequests => "Too many requests in progress",
        Code::NotFound => "No such thing",
        Code::MethodNotAllowed => "This method is not allowed here",
        Code::MethodNotImplemented => "Method not implemented",
        Code::ProfileNotFound => "No profile for this rig and lens",
        Code::NotFinished => "The job has not ended yet",
        Code::NoResult => "The job has no such result",
        Code::UploadRemoved => "The zip was removed",
        Code::Conflict => "Not possible in this state",
        Code::PreconditionFailed => "Somebody else was faster",
        Code::IdempotencyKeyReused => "This Idempotency-Key belongs to another request",
        Code::UnsupportedMediaType => "This kind of body is not understood",
        Code::NotAcceptable => "No such representation",
        Code::RangeNotSatisfiable => "The range lies outside the file",
        Code::UploadTooLarge => "The upload is too large",
        Code::UploadIncomplete => "The upload did not arrive whole",
        Code::ChecksumMismatch => "The bytes are not those that were promised",
        Code::Locked => "Another request holds it",
        Code::InsufficientStorage => "No room left",
        Code::QueueFull => "The queue is full",
        Code::InvalidArchive => "The archive is not valid",
        Code::UnsupportedArchive => "This kind of archive is not supported",
        Code::ArchiveTooLarge => "The archive would unpack past the limits",
        Code::InvalidImage => "A slice is not a valid image",
        Code::SizeMismatch => "The slices do not have the right size",
        Code::SliceCountMismatch => "The number of slices is not right",
        Code::InvalidProfile => "The profile is not valid",
        Code::TargetNotFound => "The dot target was not found",
        Code::MaskFailed => "The mask could not be made",
        Code::WorkerLost => "The worker died on this job",
        Code::Unavailable => "The service cannot work at the moment",
        Code::Internal => "Internal error",
    }
}
