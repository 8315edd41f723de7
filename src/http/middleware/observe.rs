//! One log line and two metrics per request, by route (not by URL: ids would make a series each).

use std::time::Instant;

use axum::{
    extract::{MatchedPath, Request},
    middleware::Next,
    response::Response,
};

/// The layer.
pub async fn requests(request: Request, next: Next) -> Response {
    let route = match request.extensions().get::<MatchedPath>() {
        Some(path) => path.as_str().to_owned(),
        None => "unmatched".to_owned(),
    };
    let method = request.method().as_str().to_owned();
    let path = request.uri().path().to_owned();
    let started = Instant::now();
    let response = next.run(request).await;
    let seconds = started.elapsed().as_secs_f64();
    let status = response.status().as_u16();
    // until the headers leave: the body of an event stream may go on for hours
    tracing::info!(%method, %path, status, ms = (seconds * 1000.0).round(), "answered");
    let labels = [("method", method), ("route", route), ("status", status.to_string())];
    metrics::counter!("pinstack_http_requests_total", &labels).increment(1);
    metrics::histogram!("pinstack_http_request_seconds", &labels[..2]).record(seconds);
    response
}
