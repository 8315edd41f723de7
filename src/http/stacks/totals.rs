//! `GET /v1/stack-totals`

use axum::{Json, extract::State, http::Uri};
use serde::Serialize;
use utoipa::ToSchema;

use crate::{
    contract::JobKind,
    http::{ApiResult, App, auth::Caller, extract::params},
    store::search::FoundStacks,
};

/// Numbers of stacks. Each is counted up to 10,000, which stands for that many or more.
#[derive(Debug, Serialize, ToSchema)]
pub struct StackTotals {
    /// All that match.
    pub stacks: u64,
    /// Those with the verdict `use`.
    #[serde(rename = "use")]
    pub good: u64,
    /// Those with the verdict `look`.
    pub look: u64,
    /// Those with the verdict `do_not_use`.
    pub do_not_use: u64,
    /// Those that failed.
    pub failed: u64,
}

impl From<FoundStacks> for StackTotals {
    fn from(FoundStacks { all, verdicts: [good, look, do_not_use], failed }: FoundStacks) -> Self {
        Self { stacks: all, good, look, do_not_use, failed }
    }
}

/// Count stacks
///
/// How many stacks match a search, by verdict. The parameters are those of the list of stacks.
#[utoipa::path(
    get,
    path = "/v1/stack-totals",
    operation_id = "count_stacks",
    tag = "stacks",
    params(
        ("q" = Option<String>, Query, description = "Words, as in the list of stacks"),
        ("rig" = Option<String>, Query, description = "Only stacks of this rig"),
        ("lens" = Option<String>, Query, description = "Only stacks of this lens"),
        ("scan" = Option<String>, Query, description = "Only stacks of this scan"),
        ("since" = Option<String>, Query, description = "Accepted on this day (UTC) or later, or at this time or later", example = "2026-11-27"),
        ("until" = Option<String>, Query, description = "Accepted on this day (UTC) or before, or before this time", example = "2026-11-27"),
    ),
    responses(
        (status = 200, description = "The numbers", body = StackTotals),
        (status = 400, description = "`invalid_request`: an unknown parameter, or a value outside its range"),
    )
)]
pub async fn totals(State(app): State<App>, caller: Caller, uri: Uri) -> ApiResult<Json<StackTotals>> {
    let mut filter = params::job_filter(JobKind::Stack, &params::pairs(&uri)?)?;
    filter.owner = caller.sees_only(&app);
    Ok(Json(app.store.metadata.found(&filter).await?.into()))
}
