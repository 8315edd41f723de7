//! `POST /v1/stacks/{id}/cancel`

use axum::{Json, extract::State, http::StatusCode};

use crate::{
    contract::{Code, JobKind, JobState},
    http::{
        extract::JobId,
        problem::{ApiError, ApiResult},
        state::App,
        views::Stack,
        watch::load::load,
    },
    store::CancelRequest,
};

/// Cancel a stack
///
/// One that waits is cancelled at once, one that runs within seconds. Asking twice does no harm.
#[utoipa::path(
    post,
    path = "/v1/stacks/{id}/cancel",
    operation_id = "cancel_stack",
    tag = "stacks",
    params(("id" = String, Path, description = "Id of the stack")),
    responses(
        (status = 202, description = "It is cancelled, or will be soon", body = Stack),
        (status = 404, description = "`not_found`"),
        (status = 409, description = "`conflict`: it had ended before"),
    )
)]
pub async fn cancel(State(app): State<App>, JobId(id): JobId) -> ApiResult<(StatusCode, Json<Option<Stack>>)> {
    load(&app, id, JobKind::Stack).await?;
    if let Some(CancelRequest::AlreadyEnded(state)) = app.rows.cancel(id).await?
        && state != JobState::Cancelled
    {
        let detail = format!("the stack has ended already: it is {}", state.as_str());
        return Err(ApiError::new(Code::Conflict, detail));
    }
    let job = load(&app, id, JobKind::Stack).await?;
    Ok((StatusCode::ACCEPTED, Json(Stack::of(&job))))
}
