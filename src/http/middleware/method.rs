//! Refuses methods that HTTP does not have, and removes `Range` from methods that have no ranges.

use axum::{
    extract::Request,
    http::{Method, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::{
    contract::{Code, one_line},
    http::{ApiError, ingest::body::discard},
};

/// Characters of an unknown method that the answer repeats.
const SHOWN: usize = 40;

/// The layer: a method that is not in RFC 9110, RFC 5789 (PATCH) or the HTTP QUERY draft gets 501 before any other
/// check. Only `GET` has ranges (RFC 9110, section 14.2): with another method, such as `HEAD`, `Range` is ignored.
pub async fn refuse_unknown(mut request: Request, next: Next) -> Response {
    if known(request.method()).is_some() {
        if request.method() != Method::GET {
            request.headers_mut().remove(header::RANGE);
        }
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    discard(&parts.headers, body);
    let shown: String = parts.method.as_str().chars().take(SHOWN).collect();
    let detail = format!("'{}' is not an HTTP method that this service supports", one_line(&shown));
    ApiError::new(Code::MethodNotImplemented, detail).into_response()
}

/// The name of a known method. Only these may be labels of a metric; a client could invent any number of others.
pub fn known(method: &Method) -> Option<&'static str> {
    const KNOWN: [&str; 10] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "CONNECT", "QUERY"];
    KNOWN.into_iter().find(|name| *name == method.as_str())
}
