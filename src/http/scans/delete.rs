//! `DELETE /v1/scans/{scan}`

use axum::{
    extract::State,
    http::{StatusCode, Uri},
};
use serde::Deserialize;
use utoipa::ToSchema;

use super::{ScanName, find, has_stacks, not_found, table::jobs_of};
use crate::{
    contract::JobKind,
    http::{
        ApiResult, App,
        auth::Caller,
        extract::{Conditional, params},
        job_resource,
    },
    store::scans::DeleteScan,
};

/// What happens to the stacks of a scan that is deleted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StacksOfScan {
    /// A scan with stacks is not deleted.
    #[default]
    Keep,
    /// They are deleted first, with their uploads and results.
    Delete,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Query {
    #[serde(default)]
    stacks: StacksOfScan,
}

/// Delete a scan
///
/// A scan with stacks is deleted only with `stacks=delete`, which deletes their uploads and results too. Running stacks
/// are cancelled. The reconstructions of the scan are deleted with it.
#[utoipa::path(
    delete,
    path = "/v1/scans/{scan}",
    operation_id = "delete_scan",
    tag = "scans",
    params(
        ("scan" = String, Path, description = "Name of the scan"),
        ("stacks" = inline(Option<StacksOfScan>), Query, description = "`keep` (default): a scan with stacks is not deleted; `delete`: its stacks are deleted too"),
        ("If-Match" = Option<String>, Header, description = "Only if this is the current version"),
    ),
    responses(
        (status = 204, description = "The scan is deleted"),
        (status = 400, description = "`invalid_request`: an invalid name or parameter"),
        (status = 404, description = "`scan_not_found`"),
        (status = 409, description = "`conflict`: the scan has stacks"),
        (status = 412, description = "`precondition_failed`: the scan was changed in the meantime; read it again and retry"),
    )
)]
pub async fn delete(
    State(app): State<App>,
    caller: Caller,
    scan: Conditional<ScanName>,
    uri: Uri,
) -> ApiResult<StatusCode> {
    let Query { stacks } = params::from_uri(&uri)?;
    let name = &scan.of.0;
    find(&app, &caller, name).await?;
    let condition = scan.precondition(&app).await?;
    if stacks == StacksOfScan::Delete {
        for id in jobs_of(&app, &caller, name, JobKind::Stack).await? {
            job_resource::delete_job_of_scan(&app, id, JobKind::Stack).await?;
        }
    }
    // they are of no use without the scan
    let reconstructions = jobs_of(&app, &caller, name, JobKind::Reconstruction).await?;
    match app.store.metadata.delete_scan(name, condition).await? {
        DeleteScan::Deleted => {
            for id in reconstructions {
                job_resource::delete_job_of_scan(&app, id, JobKind::Reconstruction).await?;
            }
            Ok(StatusCode::NO_CONTENT)
        }
        DeleteScan::NotFound => Err(not_found(&app, &caller, name).await),
        DeleteScan::PreconditionFailed(current) => Err(scan.failed(current)),
        DeleteScan::HasStacks(stacks) => Err(has_stacks(name, stacks, "it cannot be deleted")),
    }
}
