//! `GET /metrics`

use axum::{
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};

use super::gauges;
use crate::{
    http::{ApiError, ApiResult, App},
    telemetry,
};

/// Metrics for Prometheus
///
/// Requests, jobs, workers, disk and process in the text format of Prometheus. `docs/MONITORING.md` lists every series.
#[utoipa::path(
    get,
    path = "/metrics",
    operation_id = "get_service_metrics",
    tag = "service",
    responses((status = 200, description = "Prometheus text", body = String, content_type = "text/plain; version=0.0.4"))
)]
pub async fn metrics(State(app): State<App>) -> ApiResult<Response> {
    let recorder = telemetry::recorder().map_err(ApiError::internal)?;
    let mut text = recorder.render();
    text.push_str(&gauges::measure(&app, recorder.started()).await?);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text).into_response())
}
