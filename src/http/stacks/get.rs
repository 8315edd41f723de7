//! `GET /v1/stacks/{id}`

use axum::{Json, extract::State, http::HeaderMap};

use crate::{
    contract::JobKind,
    http::{
        extract::{JobId, prefer},
        problem::ApiResult,
        state::App,
        views::Stack,
        watch::{load::load, wait::until_final},
    },
};

/// Read a stack
///
/// With `Prefer: wait=N` the answer comes when the stack has ended, after N seconds at the latest, and never later than after 60.
#[utoipa::path(
    get,
    path = "/v1/stacks/{id}",
    operation_id = "get_stack",
    tag = "stacks",
    params(
        ("id" = String, Path, description = "Id of the stack"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds for the end, at most 60"),
    ),
    responses(
        (status = 200, description = "The stack", body = Stack),
        (status = 404, description = "`not_found`"),
    )
)]
pub async fn get(State(app): State<App>, JobId(id): JobId, headers: HeaderMap) -> ApiResult<Json<Option<Stack>>> {
    let mut job = load(&app, id, JobKind::Stack).await?;
    if let Some(patience) = prefer::wait(&headers) {
        job = until_final(&app, id, patience).await?.unwrap_or(job);
    }
    Ok(Json(Stack::of(&job)))
}
