//! `GET /metrics`

use std::sync::OnceLock;

use axum::{
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};

use crate::http::{
    problem::{ApiError, ApiResult},
    state::App,
};

/// Upper bounds of the buckets of request times, seconds: from a health check to a large upload.
const SECONDS: [f64; 12] = [0.001, 0.005, 0.02, 0.1, 0.5, 1.0, 5.0, 20.0, 60.0, 300.0, 1800.0, 7200.0];

/// The recorder of this process; installed when it is first asked for.
///
/// # Errors
/// When another recorder is installed already.
pub fn recorder() -> Result<&'static PrometheusHandle, &'static str> {
    static HANDLE: OnceLock<Option<PrometheusHandle>> = OnceLock::new();
    let handle = HANDLE.get_or_init(|| {
        let handle = PrometheusBuilder::new().set_buckets(&SECONDS).ok()?.install_recorder().ok()?;
        metrics::describe_counter!("pinstack_http_requests_total", "Requests answered, by method, route and status");
        metrics::describe_histogram!("pinstack_http_request_seconds", "Time to the headers of the answer");
        metrics::describe_counter!("pinstack_upload_bytes_total", "Bytes of uploads received");
        metrics::describe_gauge!("pinstack_jobs", "Jobs by state");
        metrics::describe_gauge!("pinstack_disk_free_bytes", "Bytes that can still be written");
        metrics::describe_gauge!("pinstack_disk_reserved_bytes", "Bytes reserved and not written yet");
        metrics::describe_gauge!(
            "pinstack_upload_awaited_bytes",
            "Bytes that open resumable uploads have still to bring"
        );
        Some(handle)
    });
    handle.as_ref().ok_or("the metrics recorder could not be installed")
}

/// For Prometheus
///
/// Requests and their times by route, jobs by state, bytes uploaded, room on the disk.
#[utoipa::path(
    get,
    path = "/metrics",
    operation_id = "get_service_metrics",
    tag = "service",
    responses((status = 200, description = "Prometheus text", body = String, content_type = "text/plain; version=0.0.4"))
)]
pub async fn metrics(State(app): State<App>) -> ApiResult<Response> {
    let recorder = recorder().map_err(ApiError::internal)?;
    let counts = app.rows.counts().await?;
    let by_state = [
        ("queued", counts.queued),
        ("running", counts.running),
        ("succeeded", counts.succeeded),
        ("failed", counts.failed),
        ("cancelled", counts.cancelled),
    ];
    for (state, count) in by_state {
        ::metrics::gauge!("pinstack_jobs", "state" => state).set(count as f64);
    }
    if let Ok(disk) = app.disk.state().await {
        ::metrics::gauge!("pinstack_disk_free_bytes").set(disk.free as f64);
        ::metrics::gauge!("pinstack_disk_reserved_bytes").set(disk.reserved as f64);
    }
    ::metrics::gauge!("pinstack_upload_awaited_bytes").set(app.rows.awaited_bytes().await? as f64);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], recorder.render()).into_response())
}
