//! One log line and two metrics per request. Metrics are labelled by route, not by URL: each id would be a series of
//! its own.

use std::time::Instant;

use axum::{
    extract::{MatchedPath, Request},
    middleware::Next,
    response::Response,
};

use super::method;
use crate::{
    contract::{Problem, one_line},
    http::wait_times,
    telemetry::events,
};

/// The layer. All labels come from fixed sets: routes, known methods, statuses.
pub async fn requests(request: Request, next: Next) -> Response {
    let route = match request.extensions().get::<MatchedPath>() {
        Some(path) => path.as_str().to_owned(),
        None => "unmatched".to_owned(),
    };
    let method = method::known(request.method()).unwrap_or("other");
    let path = one_line(request.uri().path());
    let started = Instant::now();
    let (response, waits) = wait_times::measured(next.run(request)).await;
    let elapsed = started.elapsed();
    let status = response.status().as_u16();
    // up to the headers of the answer: an event stream may last for hours
    let ms = (elapsed.as_secs_f64() * 1000.0).round();
    match response.extensions().get::<Problem>() {
        None => tracing::info!(method, %path, status, ms, "answered"),
        Some(problem) => {
            let (code, detail) = (problem.code.name(), one_line(&problem.detail));
            if response.status().is_server_error() {
                tracing::warn!(method, %path, status, ms, %code, %detail, "refused");
            } else {
                tracing::info!(method, %path, status, ms, %code, %detail, "refused");
            }
            events::refused(problem.code);
        }
    }
    let waited = waits.iter().map(|(_, time)| *time).sum();
    events::answered(method, &route, status, elapsed.saturating_sub(waited), &waits);
    response
}
