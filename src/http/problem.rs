//! The only place where an error becomes an HTTP answer.
//!
//! Handlers return [`ApiResult`]. Every [`ApiError`] becomes `application/problem+json` (RFC 9457); its status and
//! title come from the table in [`super::problem_types`]. The client reads the sentence of the fault. Internal causes
//! (SQL, paths) are written to the log here and nowhere else.

use axum::{
    body::Body,
    http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::problem_types::{INTERNAL, Retry, problem_type};
use crate::{
    contract::{Code, Fault, Problem},
    store::StoreError,
};

/// Media type of every error.
pub const PROBLEM_JSON: &str = "application/problem+json";

/// The result of a handler.
pub type ApiResult<T> = Result<T, ApiError>;

/// A fault that is sent to the client, with additional headers.
#[derive(Debug)]
pub struct ApiError {
    fault: Fault,
    // boxed, because every Result carries it and it is mostly empty
    headers: Box<HeaderMap>,
}

impl ApiError {
    /// An error with a code and a sentence.
    pub fn new(code: Code, detail: impl Into<String>) -> Self {
        Fault::new(code, detail).into()
    }

    /// An internal error: the cause goes to the log, the client gets only the request id.
    pub fn internal(cause: impl std::fmt::Display) -> Self {
        tracing::error!(%cause, "internal error");
        Self::new(Code::Internal, INTERNAL)
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
        if let Retry::AfterSeconds(seconds) = problem_type(fault.code).retry {
            headers.insert(header::RETRY_AFTER, seconds.into());
        }
        if fault.code == Code::Unauthorized {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        Self { fault, headers: Box::new(headers) }
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::DiskFull(cause) => {
                tracing::error!(%cause, "disk full");
                Self::new(
                    Code::InsufficientStorage,
                    "the disk of the server is full; nothing was stored; free some space (for example delete old stacks), then send it \
                     again",
                )
            }
            StoreError::InvalidCursor => Self::new(
                Code::InvalidRequest,
                "invalid cursor for this list; use `next_cursor` of the previous page, or omit it",
            ),
            StoreError::Unavailable(cause) => {
                tracing::error!(cause = %format!("{cause:#}"), "the storage is not available");
                Self::new(
                    Code::Unavailable,
                    "the storage of the service does not answer at the moment; try again later",
                )
            }
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

/// The problem document of a fault. `instance` is the request or the job that it belongs to.
pub fn problem(fault: &Fault, instance: Option<String>) -> Problem {
    let problem_type = problem_type(fault.code);
    Problem {
        kind: link!("/problems/{}", fault.code.name()),
        title: problem_type.title.to_owned(),
        status: problem_type.status.as_u16(),
        detail: fault.detail.clone(),
        instance,
        code: fault.code,
        errors: fault.locations.clone(),
    }
}

/// The answer that carries a problem. The problem is also an extension of the answer, so that the outermost layer can
/// fill in the instance.
pub fn render(problem: Problem) -> Response {
    let status = StatusCode::from_u16(problem.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let body = serde_json::to_vec(&problem).unwrap_or_default();
    let mut response = Response::new(Body::from(body));
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    response.extensions_mut().insert(problem);
    response
}

/// The HTTP status of a code.
pub fn status(code: Code) -> StatusCode {
    problem_type(code).status
}

/// True when the same request would be refused again whatever happens in between: an upload that gets such a code is
/// refused for good.
pub fn is_permanent(code: Code) -> bool {
    problem_type(code).retry == Retry::Never
}

/// The code for a bare status, for answers made by libraries.
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
