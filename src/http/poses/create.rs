//! `POST /v1/poses`

use axum::{extract::State, response::Response};

use super::{KnownViews, PoseQuery, report};
use crate::http::{ApiResult, App, auth::Caller, extract::Sent};
use pinstack_science::photogrammetry::poses::PoseReport;

/// Report on camera poses
///
/// Measures how well a reconstruction program registered the views of a turntable scan: registered of expected, the
/// sphere through the centres of projection (centre, radius, standard deviation), the steps of pan and tilt, and the
/// residual of each view. Commanded angles come from the names of the views (`pan020_tilt06`) or from the columns
/// `pan_deg` and `tilt_deg` of a CSV file. Nothing is stored.
///
/// The body is a file as the program writes it: COLMAP `images.txt` or `images.bin`, or a zip of the folder of the
/// model, of which `images` and `cameras` are read; AliceVision or Meshroom `cameras.sfm`, Metashape XML, OpenMVG
/// `sfm_data.json`, or CSV with the columns `name`, `x`, `y`, `z`. Lengths are in mm if `radius_mm` or a pair of views
/// gives the scale; otherwise they are shares of the radius.
#[utoipa::path(
    post,
    path = "/v1/poses",
    operation_id = "report_poses",
    tag = "optics",
    params(PoseQuery),
    request_body(description = "The file", content((Vec<u8> = "application/octet-stream"))),
    responses(
        (status = 200, description = "The report", content(
            (PoseReport = "application/json"),
            (String = "text/plain"),
            (String = "application/x-latex"),
            (String = "text/html"),
        )),
        (status = 400, description = "`invalid_request`: a parameter that is unknown or outside its range; `upload_incomplete`: the connection closed or timed out"),
        (status = 413, description = "`upload_too_large`: the file exceeds 128 MiB"),
        (status = 422, description = "`invalid_poses`: not a file of camera poses, or one without a registered view"),
        (status = 507, description = "`insufficient_storage`: no room for the file while it is read"),
    )
)]
pub async fn create(State(app): State<App>, caller: Caller, sent: Sent) -> ApiResult<Response> {
    report(&app, &caller, PoseQuery::of(&sent.uri)?, &sent.headers, sent.body, KnownViews::default()).await
}
