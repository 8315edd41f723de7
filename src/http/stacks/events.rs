//! `GET /v1/stacks/{id}/events`

use axum::{extract::State, http::HeaderMap, response::Response};

use crate::{
    contract::JobKind,
    http::{extract::JobId, job_resource, problem::ApiResult, state::App},
};

/// Stream the events of a stack
///
/// Server-sent events. `state` (data: the whole stack) is sent first and on each change of state. `progress` (data: the
/// progress) is sent on each change of progress. The stream closes when the stack has ended. A client that reconnects
/// with `Last-Event-ID` receives only newer events.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/events",
    operation_id = "watch_stack",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Last-Event-ID" = Option<String>, Header, description = "Id of the last event received"),
    ),
    responses(
        (status = 200, description = "The events", body = String, content_type = "text/event-stream"),
        (status = 204, description = "The stack has ended and the client has received its last event: do not reconnect"),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn events(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Response> {
    job_resource::events(&app, id, JobKind::Stack, &headers).await
}
