//! `POST /v1/scans/{scan}/poses`

use axum::{extract::State, response::Response};

use super::{ScanName, find, table::views};
use crate::{
    contract::Code,
    http::{
        ApiError, ApiResult, App,
        auth::Caller,
        extract::Sent,
        poses::{KnownViews, PoseQuery, report},
    },
};
use pinstack_science::photogrammetry::poses::{Commanded, Distance, PoseReport};

/// Report on the camera poses of a scan
///
/// As `POST /v1/poses`. The commanded angles are those of the views of the scan, the number of expected views is its
/// `expected_views` or the number of its views, and its `radius_mm` gives the scale. The focal length of the file (of
/// COLMAP, of a zip of the folder of the model), or `focal_px`, is compared with the principal distance of the profile
/// that the views were fused with. Views of the file that the scan does not have are named.
#[utoipa::path(
    post,
    path = "/v1/scans/{scan}/poses",
    operation_id = "report_scan_poses",
    tag = "scans",
    params(("scan" = String, Path, description = "Name of the scan"), PoseQuery),
    request_body(description = "The file", content((Vec<u8> = "application/octet-stream"))),
    responses(
        (status = 200, description = "The report", content(
            (PoseReport = "application/json"),
            (String = "text/plain"),
            (String = "application/x-latex"),
            (String = "text/html"),
        )),
        (status = 400, description = "`invalid_request`: an invalid name, or a parameter that is unknown or outside its range; `upload_incomplete`: the connection closed or timed out"),
        (status = 404, description = "`scan_not_found`"),
        (status = 413, description = "`upload_too_large`: the file exceeds 128 MiB"),
        (status = 422, description = "`invalid_poses`: not a file of camera poses, one without a registered view, or one without a view of the scan; or the scan has no views yet"),
        (status = 507, description = "`insufficient_storage`: no room for the file while it is read"),
    )
)]
pub async fn poses(
    State(app): State<App>,
    caller: Caller,
    ScanName(name): ScanName,
    sent: Sent,
) -> ApiResult<Response> {
    let query = PoseQuery::of(&sent.uri)?;
    let scan = find(&app, &caller, &name).await?;
    let views = views(&app, &caller, &name).await?;
    if views.is_empty() {
        let detail = format!(
            "the scan '{name}' has no views yet; send its stacks first, or ask for a report without a scan (POST \
             /v1/poses)"
        );
        return Err(ApiError::new(Code::InvalidPoses, detail));
    }
    let commanded = views.iter().map(|view| Commanded {
        name: view.stem.clone(),
        angles_deg: view.angles().map(|angles| [angles.pan_deg, angles.tilt_deg]),
    });
    let known = KnownViews {
        commanded: commanded.collect(),
        expected: scan.input.expected_views.or(u32::try_from(views.len()).ok()),
        radius_mm: scan.input.radius_mm,
        principal_distance: views.iter().find_map(|view| {
            let camera = view.stack.result.as_ref()?.image_info.intrinsics?;
            let to_px = camera.principal_distance_px / camera.principal_distance_mm;
            let sigma_px = camera.principal_distance_sigma_mm.map(|sigma| to_px * sigma);
            Some(Distance { px: camera.principal_distance_px, sigma_px })
        }),
    };
    report(&app, &caller, query, &sent.headers, sent.body, known).await
}
