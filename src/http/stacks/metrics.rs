//! `GET /v1/stacks/{id}/metrics`

use axum::{Json, extract::State};

use crate::{
    contract::JobKind,
    http::{ApiResult, App, artifacts::outcome, extract::JobId, job_resource::load},
};
use pinstack_science::types::metrics::Metrics;

/// Get the metrics of a stack
///
/// A metric that could not be computed is null. `mask` is null without a back-light stack.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}/metrics",
    operation_id = "get_stack_metrics",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 200, description = "The metrics", body = Metrics),
        (status = 404, description = "`not_found`; `no_result`: the stack failed or was cancelled"),
        (status = 409, description = "`not_finished`: the stack is queued or running"),
    )
)]
pub async fn metrics(State(app): State<App>, JobId(id): JobId) -> ApiResult<Json<Metrics>> {
    let job = load(&app, id, JobKind::Stack).await?;
    Ok(Json(outcome::of_stack(&job)?.metrics.clone()))
}
