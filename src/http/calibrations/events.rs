//! `GET /v1/calibrations/{id}/events`

use axum::{extract::State, http::HeaderMap, response::Response};

use crate::{
    contract::JobKind,
    http::{extract::JobId, job_resource, problem::ApiResult, state::App},
};

/// Stream the events of a calibration
///
/// Server-sent events. `state` (data: the whole calibration) is sent first and on each change of state. `progress`
/// (data: the progress) is sent on each change of progress. The stream closes when the calibration has ended. A client
/// that reconnects with `Last-Event-ID` receives only newer events.
#[utoipa::path(
    get,
    path = "/v1/calibrations/{id}/events",
    operation_id = "watch_calibration",
    tag = "calibrations",
    params(
        ("id" = String, Path, description = "Id of the calibration"),
        ("Last-Event-ID" = Option<String>, Header, description = "Id of the last event received"),
    ),
    responses(
        (status = 200, description = "The events", body = String, content_type = "text/event-stream"),
        (status = 204, description = "The calibration has ended and the client has received its last event: do not reconnect"),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn events(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    job_resource::events(&app, id, JobKind::Calibration, &headers).await
}
