//! `GET /v1/stacks/{id}`

use axum::{Json, extract::State, http::HeaderMap};

use crate::{
    contract::JobKind,
    http::{
        extract::JobId,
        job_resource,
        problem::ApiResult,
        state::App,
        views::{JobDocument, Stack},
    },
};

/// Get a stack
///
/// With `Prefer: wait=N` the response is sent when the stack has ended, or after N seconds (at most 60).
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}",
    operation_id = "get_stack",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds (at most 60) for the job to end"),
    ),
    responses(
        (status = 200, description = "The stack", body = Stack),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Json<JobDocument>> {
    job_resource::get(&app, id, JobKind::Stack, &headers).await
}
