//! `PUT /v1/scans/{scan}`

use axum::{body::Body, extract::State, http::HeaderMap, response::Response};

use super::{ScanName, has_stacks, is_of_another};
use crate::{
    contract::{Code, Scan, ScanInput, scan::Reconstruct},
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        extract::{Conditional, json},
        reconstructions::create::require_colmap,
    },
    store::scans::PutScan,
};

/// Create or change a scan
///
/// A scan is a named set of stacks of one rig and lens, one per view. Create it before its stacks are sent: a stack
/// that names an unknown scan is refused, so that a misspelt name is noticed. A `PUT` replaces all members; an absent
/// one gets its default. Rig and lens cannot change while the scan has stacks.
#[utoipa::path(
    put,
    path = "/v1/scans/{scan}",
    operation_id = "put_scan",
    tag = "scans",
    params(
        ("scan" = String, Path, description = "Name of the scan: 1 to 64 characters of `A-Z a-z 0-9 . _ -`, not beginning with a dot", example = "bee-0042"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the current version; the request fails if the scan has changed"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only if the scan does not exist yet"),
    ),
    request_body(content(
        (ScanInput = "application/json", example = json!({
            "rig": "turntable-1", "lens": "mpe65-2x", "expected_views": 90,
            "specimen": "ZMB-0042", "taxon": "Apis mellifera", "operator": "K. Okafor"
        })),
    )),
    responses(
        (status = 200, description = "The scan was changed", body = Scan, headers(("ETag" = String, description = "The version"))),
        (status = 201, description = "The scan was created", body = Scan, headers(
            ("ETag" = String, description = "The version"), ("Location" = String, description = "URL of the scan"))),
        (status = 400, description = "`invalid_request`: an invalid name or member, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out"),
        (status = 409, description = "`conflict`: rig or lens would change, and the scan has stacks; the scan belongs to another token; or `reconstruct` is `auto`, and the server has no COLMAP"),
        (status = 412, description = "`precondition_failed`: the scan was changed in the meantime; read it again and retry"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
    )
)]
pub async fn put(
    State(app): State<App>,
    caller: Caller,
    scan: Conditional<ScanName>,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    json::require_json(&headers)?;
    let name = &scan.of.0;
    if is_of_another(&app, &caller, name).await? {
        let detail = format!("the name '{name}' is that of a scan of another token; choose another name");
        return Err(ApiError::new(Code::Conflict, detail));
    }
    let condition = scan.precondition(&app).await?;
    let input: ScanInput = json::parse(&json::read(&app, &headers, body).await?, Code::InvalidRequest)?;
    input.check()?;
    if input.reconstruct == Reconstruct::Auto {
        require_colmap(&app)?;
    }
    match app.store.metadata.put_scan(name, &input, caller.id(), condition).await? {
        PutScan::Created(stored) => Ok(scan.written(true, stored.version, &stored)),
        PutScan::Updated(stored) => Ok(scan.written(false, stored.version, &stored)),
        PutScan::PreconditionFailed(current) => Err(scan.failed(current)),
        PutScan::HasStacks(stacks) => Err(has_stacks(name, stacks, "its rig and lens cannot change")),
    }
}
