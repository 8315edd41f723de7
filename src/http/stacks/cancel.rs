//! `POST /v1/stacks/{id}/cancel`

use axum::{Json, extract::State, http::StatusCode};

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

/// Cancel a stack
///
/// A waiting stack is cancelled at once, a running one within seconds. Cancelling it again is not an error.
#[utoipa::path(
    post,
    path = "/v1/stacks/{id}/cancel",
    operation_id = "cancel_stack",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 202, description = "It is cancelled, or will be as soon as its worker stops", body = Stack),
        (status = 404, description = "`not_found`"),
        (status = 409, description = "`conflict`: it has already succeeded or failed"),
    )
)]
pub async fn cancel(State(app): State<App>, JobId(id): JobId) -> ApiResult<(StatusCode, Json<JobDocument>)> {
    job_resource::cancel(&app, id, JobKind::Stack).await
}
