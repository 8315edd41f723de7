//! CORS for pages of other origins. Off unless their origins are configured. A page of a configured origin may send
//! every request, with a token like any other client. Cookies are never used.

use axum::{
    extract::{Request, State},
    http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::Next,
    response::{IntoResponse, Response},
};

use crate::http::App;

/// Headers of an answer that a page may read, besides the CORS-safelisted ones.
const EXPOSED: &str = "location, etag, retry-after, x-request-id, content-disposition, idempotency-replayed, \
                       preference-applied, tus-resumable, tus-version, tus-extension, tus-max-size, \
                       tus-checksum-algorithm, upload-offset, upload-length, upload-metadata, upload-expires, pinstack-job";
/// How long a browser may cache a preflight answer, seconds.
const MAX_AGE: HeaderValue = HeaderValue::from_static("600");

/// The layer.
pub async fn answer(State(app): State<App>, request: Request, next: Next) -> Response {
    if app.policy.cors_origins.is_empty() {
        return next.run(request).await;
    }
    let asked = request.headers();
    let origin = asked.get(header::ORIGIN).filter(|origin| is_allowed(&app, origin)).cloned();
    let is_preflight = request.method() == Method::OPTIONS && asked.contains_key(header::ACCESS_CONTROL_REQUEST_METHOD);
    let mut response = match &origin {
        Some(_) if is_preflight => preflight(asked),
        _ => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.append(header::VARY, HeaderValue::from_static("origin"));
    if let Some(origin) = origin {
        headers.insert(header::ACCESS_CONTROL_ALLOW_ORIGIN, origin);
        headers.insert(header::ACCESS_CONTROL_EXPOSE_HEADERS, HeaderValue::from_static(EXPOSED));
        headers
            .insert(HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("cross-origin"));
    }
    response
}

fn is_allowed(app: &App, origin: &HeaderValue) -> bool {
    app.policy.cors_origins.iter().any(|allowed| allowed.as_bytes() == origin.as_bytes())
}

/// Answers a preflight request: allows the method and headers that it names.
fn preflight(asked: &HeaderMap) -> Response {
    let mut response = StatusCode::NO_CONTENT.into_response();
    let headers = response.headers_mut();
    for (asks, allows) in [
        (header::ACCESS_CONTROL_REQUEST_METHOD, header::ACCESS_CONTROL_ALLOW_METHODS),
        (header::ACCESS_CONTROL_REQUEST_HEADERS, header::ACCESS_CONTROL_ALLOW_HEADERS),
    ] {
        if let Some(value) = asked.get(asks) {
            headers.insert(allows, value.clone());
        }
    }
    headers.insert(header::ACCESS_CONTROL_MAX_AGE, MAX_AGE);
    response
}
