//! `GET /v1/stacks`

use axum::{Json, extract::State, http::Uri};

use crate::{
    contract::{JobKind, JobState},
    http::{
        auth::Caller,
        extract::{PageQuery, params},
        problem::ApiResult,
        state::App,
        views::{Stack, StackList},
    },
    store::JobFilter,
};

/// List stacks
///
/// Newest first. A page ends at `limit` or when the answer would be larger than about 4 MiB.
#[utoipa::path(
    get,
    path = "/v1/stacks",
    operation_id = "list_stacks",
    tag = "stacks",
    params(
        ("state" = Option<JobState>, Query, description = "Only in this state"),
        ("rig" = Option<String>, Query, description = "Only of this rig"),
        ("lens" = Option<String>, Query, description = "Only of this lens"),
        ("scan" = Option<String>, Query, description = "Only of this scan"),
        ("limit" = Option<u32>, Query, description = "Items on a page, 1 to 500, default 50"),
        ("cursor" = Option<String>, Query, description = "`next_cursor` of the page before"),
    ),
    responses(
        (status = 200, description = "A page of stacks", body = StackList),
        (status = 400, description = "`invalid_request`: a parameter that breaks its rule"),
    )
)]
pub async fn list(State(app): State<App>, caller: Caller, uri: Uri) -> ApiResult<Json<StackList>> {
    let mut pairs = params::pairs(&uri)?;
    let page = PageQuery::take(&mut pairs)?;
    let filter = JobFilter { owner: caller.sees_only(&app), ..params::job_filter(JobKind::Stack, &pairs)? };
    let page = app.rows.jobs(&filter, &page).await?;
    let items = page.items.iter().filter_map(Stack::of).collect();
    Ok(Json(StackList { items, next_cursor: page.next_cursor, skipped: page.skipped }))
}
