//! Methods that HTTP does not have.

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

/// Longest part of an unknown method that is repeated to its sender.
const SHOWN: usize = 40;

/// The layer: a method that is not one of RFC 9110, RFC 5789 (PATCH) or the HTTP QUERY method gets 501 before anything else is looked at.
pub async fn refuse_unknown(request: Request, next: Next) -> Response {
    if known(request.method()).is_some() {
        return next.run(request).await;
    }
    let shown: String = request.method().as_str().chars().take(SHOWN).collect();
    let detail = format!("'{}' is no method of HTTP that this service knows", one_line(&shown));
    ApiError::new(Code::MethodNotImplemented, detail).into_response()
}

/// The name of a method, from a fixed list: what may be a label of a metric. `None` for what a client made up.
pub fn known(method: &Method) -> Option<&'static str> {
    const KNOWN: [&str; 10] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "QUERY"];
    KNOWN.into_iter().find(|name| *name == method.as_str())
}
