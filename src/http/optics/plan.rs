//! `GET /v1/optics/plan`

use axum::{Json, http::Uri};

use crate::http::{extract::params, problem::ApiResult};
use pinstack_science::{
    optics::plan::{CapturePlan, PlanInput, plan as plan_capture},
    types::profile::CaptureMode,
};

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
    params(
        ("focal_mm" = f64, Query, description = "Focal length of the lens at its setting, mm", example = 65.0),
        ("f_number" = f64, Query, description = "f-number that is set on the lens", example = 5.6),
        ("magnification" = Option<f64>, Query, description = "Magnification of the middle of the object. Give this or `object_distance_mm`", example = 1.0),
        ("object_distance_mm" = Option<f64>, Query, description = "Distance from the lens to the middle of the object, mm"),
        ("pixel_pitch_um" = f64, Query, description = "Size of one pixel on the sensor, micrometres", example = 4.14),
        ("object_depth_mm" = f64, Query, description = "Depth of the object along the optical axis, mm", example = 5.0),
        ("mode" = inline(CaptureMode), Query, description = "What moves between slices", example = "fixed_lens"),
        ("image_width" = Option<u32>, Query, description = "Width of the image, px; with `image_height` for the field of view"),
        ("image_height" = Option<u32>, Query, description = "Height of the image, px"),
        ("pupil_ratio" = Option<f64>, Query, description = "Diameter of the exit pupil over that of the entrance pupil; default 1"),
        ("overlap" = Option<f64>, Query, description = "Share of the depth of field that neighbouring slices have in common; default 0.5"),
        ("wavelength_nm" = Option<f64>, Query, description = "Wavelength of the light, nm; default 550"),
        ("coc_um" = Option<f64>, Query, description = "Diameter of the circle of confusion, micrometres; default: 2.5 pixels"),
        ("rail_resolution_um" = Option<f64>, Query, description = "Smallest step of the rail, micrometres"),
        ("slice_count" = Option<u32>, Query, description = "Number of slices, if it is given rather than wanted"),
    ),
    responses(
        (status = 200, description = "The plan", body = CapturePlan),
        (status = 400, description = "`invalid_request`: a parameter that is missing, unknown or outside its range; an object that reaches the lens, or needs more slices than a stack has"),
    )
)]
pub async fn plan(uri: Uri) -> ApiResult<Json<CapturePlan>> {
    let input: PlanInput = params::from_uri(&uri)?;
    Ok(Json(plan_capture(&input)?))
}
