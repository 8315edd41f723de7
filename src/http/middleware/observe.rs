//! One log line and two metrics per request, by route (not by URL: ids would make a series each).

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

/// The layer. Labels come from fixed lists: the routes of this service, known methods, statuses.
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
    // until the headers leave: the body of an event stream may go on for hours
    let ms = (elapsed.as_secs_f64() * 1000.0).round();
    match response.extensions().get::<Problem>() {
        None => tracing::info!(method, %path, status, ms, "answered"),
        Some(told) => {
            let (code, detail) = (told.code.name(), one_line(&told.detail));
            if response.status().is_server_error() {
                tracing::warn!(method, %path, status, ms, %code, %detail, "refused");
            } else {
                tracing::info!(method, %path, status, ms, %code, %detail, "refused");
            }
            events::refused(told.code);
        }
    }
    let waited = waits.iter().map(|(_, time)| *time).sum();
    events::answered(method, &route, status, elapsed.saturating_sub(waited), &waits);
    response
}
