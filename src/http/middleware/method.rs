//! Refuses methods that HTTP does not have.

use axum::{
    extract::Request,
    http::Method,
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::{Code, one_line},
    http::problem::ApiError,
};

/// Characters of an unknown method that the answer repeats.
const SHOWN: usize = 40;

/// The layer: a method that is not in RFC 9110, RFC 5789 (PATCH) or the HTTP QUERY draft gets 501 before any other
/// check.
pub async fn refuse_unknown(request: Request, next: Next) -> Response {
    if known(request.method()).is_some() {
        return next.run(request).await;
    }
    let shown: String = request.method().as_str().chars().take(SHOWN).collect();
    let detail = format!("'{}' is not an HTTP method that this service supports", one_line(&shown));
    ApiError::new(Code::MethodNotImplemented, detail).into_response()
}

/// The name of a known method. Only these may be labels of a metric; a client could invent any number of others.
pub fn known(method: &Method) -> Option<&'static str> {
    const KNOWN: [&str; 10] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "QUERY"];
    KNOWN.into_iter().find(|name| *name == method.as_str())
}
