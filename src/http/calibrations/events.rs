//! `GET /v1/calibrations/{id}/events`

use axum::{extract::State, http::HeaderMap, response::Response};

use crate::{
    contract::JobKind,
    http::{
        extract::JobId,
        problem::ApiResult,
        state::App,
        views::Calibration,
        watch::{events::answer, load::load},
    },
};

/// Watch a calibration
///
/// Server-sent events: `state` (data: the whole calibration) now and whenever its state changes, `progress` (data: the
/// progress) whenever that does. The stream ends with the calibration. A client that comes back with `Last-Event-ID` hears
/// only what is newer.
#[utoipa::path(
    get,
    path = "/v1/calibrations/{id}/events",
    operation_id = "watch_calibration",
    tag = "calibrations",
    params(
        ("id" = String, Path, description = "Id of the calibration"),
        ("Last-Event-ID" = Option<String>, Header, description = "Id of the last event that was heard"),
    ),
    responses(
        (status = 200, description = "The events", body = String, content_type = "text/event-stream"),
        (status = 204, description = "It has ended, and the client has heard that"),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn events(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    let job = load(&app, id, JobKind::Calibration).await?;
    Ok(answer(&app, &headers, job, Calibration::of))
}
