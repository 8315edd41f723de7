//! The span of a request in the traces of OpenTelemetry, from the head of the request to the head of its answer.

use axum::{
    extract::{MatchedPath, Request},
    middleware::Next,
    response::Response,
};

use super::{method, request_id::X_REQUEST_ID};
use crate::{
    contract::{Problem, one_line},
    http::log,
    telemetry::traces,
};

/// Requests of programs that watch the service, several per second for ever.
const PROBES: [&str; 3] = ["/healthz", "/readyz", "/metrics"];

/// The layer. It does nothing without a collector.
pub async fn requests(request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("unmatched", MatchedPath::as_str);
    if PROBES.contains(&route) {
        return next.run(request).await;
    }
    let method = method::known(request.method()).unwrap_or("other");
    let Some(span) = traces::request(method, route, one_line(request.uri().path()), request.headers()) else {
        return next.run(request).await;
    };
    log::note("trace_id", span.trace_id());
    if let Some(id) = request.headers().get(&X_REQUEST_ID).and_then(|id| id.to_str().ok()) {
        span.set("pinstack.request.id", one_line(id));
    }
    let response = traces::within(Some(&span), next.run(request)).await;
    span.set("http.response.status_code", i64::from(response.status().as_u16()));
    if let Some(problem) = response.extensions().get::<Problem>() {
        span.set("error.type", problem.code.name());
        if response.status().is_server_error() {
            span.fail(one_line(&problem.detail));
        }
    }
    span.end();
    response
}
