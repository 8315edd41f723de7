//! `GET /v1/optics/plan`

use axum::{Json, http::Uri};

use crate::http::{ApiResult, extract::params};
use pinstack_science::optics::plan::{CapturePlan, PlanInput, plan as plan_capture};

/// Plan a capture
///
/// Depth of focus and of field, the number of slices that an object needs, and the rail position, predicted scale and
/// brightness of each. The rail positions can be given to a calibration as `rail_positions_mm`. `warnings` names what
/// limits the capture: diffraction, or steps that are too small for the rail.
#[utoipa::path(
    get,
    path = "/v1/optics/plan",
    operation_id = "plan_capture",
    tag = "optics",
    params(PlanInput),
    responses(
        (status = 200, description = "The plan", body = CapturePlan),
        (status = 400, description = "`invalid_request`: a parameter that is missing, unknown or outside its range; an object that reaches the lens, or needs more slices than a stack has"),
    )
)]
pub async fn plan(uri: Uri) -> ApiResult<Json<CapturePlan>> {
    let input: PlanInput = params::from_uri(&uri)?;
    Ok(Json(plan_capture(&input)?))
}
