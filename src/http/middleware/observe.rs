//! One log line and two metrics per request, by route (not by URL: ids would make a series each).

use std::time::Instant;

use axum::{
    extract::{MatchedPath, Request},
    middleware::Next,
    response::Response,
};

use crate::{http::waiting, model::Problem, telemetry::events};

/// The layer.
pub async fn requests(request: Request, next: Next) -> Response {
    let route = match request.extensions().get::<MatchedPath>() {
        Some(path) => path.as_str().to_owned(),
        None => "unmatched".to_owned(),
    };
    let method = known(request.method());
    let path = request.uri().path().to_owned();
    let started = Instant::now();
    let (response, waits) = waiting::measured(next.run(request)).await;
    let elapsed = started.elapsed();
    let status = response.status().as_u16();
    // until the headers leave: the body of an event stream may go on for hours
    tracing::info!(%method, %path, status, ms = (elapsed.as_secs_f64() * 1000.0).round(), "answered");
    if let Some(problem) = response.extensions().get::<Problem>() {
        events::refused(problem.code);
    }
    let waited = waits.iter().map(|(_, time)| *time).sum();
    events::answered(method, &route, status, elapsed.saturating_sub(waited), &waits);
    response
}

fn known(method: &axum::http::Method) -> &'static str {
    const KNOWN: [&str; 7] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"];
    KNOWN.into_iter().find(|known| *known == method.as_str()).unwrap_or("other")
}
