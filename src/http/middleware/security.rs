//! Security headers for browsers.

use axum::{
    extract::Request,
    http::{HeaderName, HeaderValue, header},
    middleware::Next,
    response::Response,
};

/// Swagger UI writes style attributes and shows icons as data URIs; everything else comes from this server,
/// and "try it out" talks to this server only.
const DOCS_POLICY: &str = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; \
                           object-src 'none'; base-uri 'none'; frame-ancestors 'none'";
/// Answers of the API are data: they may neither run nor load anything. A page that needs more sets its own policy,
/// which is kept.
const DATA_POLICY: &str = "default-src 'none'; frame-ancestors 'none'";

/// The layer.
pub async fn headers(request: Request, next: Next) -> Response {
    let is_docs = request.uri().path().starts_with("/docs");
    let mut response = next.run(request).await;
    let policy = if is_docs { DOCS_POLICY } else { DATA_POLICY };
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(policy));
    headers.entry(header::REFERRER_POLICY).or_insert(HeaderValue::from_static("no-referrer"));
    headers
        .entry(HeaderName::from_static("cross-origin-resource-policy"))
        .or_insert(HeaderValue::from_static("same-origin"));
    response
}
