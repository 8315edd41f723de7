//! `GET /v1/stacks`

use axum::{Json, extract::State, http::Uri};

use crate::{
    contract::{JobKind, JobState},
    http::{
        auth::Caller,
        extract::{PageQuery, params},
        problem::ApiResult,
        state::App,
        views::StackList,
    },
    store::JobFilter,
};

/// List stacks
///
/// Newest first. A page holds at most `limit` items, fewer when the response would exceed about 4 MiB.
#[utoipa::path(
    get,
    path = "/v1/stacks",
    operation_id = "list_stacks",
    tag = "stacks",
    params(
        ("state" = Option<JobState>, Query, description = "Only stacks in this state"),
        ("rig" = Option<String>, Query, description = "Only stacks of this rig"),
        ("lens" = Option<String>, Query, description = "Only stacks of this lens"),
        ("scan" = Option<String>, Query, description = "Only stacks of this scan"),
        ("limit" = Option<u32>, Query, description = "Items per page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` from the previous page"),
    ),
    responses(
        (status = 200, description = "A page of stacks", body = StackList),
        (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
    )
)]
pub async fn list(State(app): State<App>, caller: Caller, uri: Uri) -> ApiResult<Json<StackList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let filter = JobFilter { owner: caller.sees_only(&app), ..params::job_filter(JobKind::Stack, &pairs)? };
    Ok(Json(app.store.metadata.jobs(&filter, &page).await?.into()))
}
