//! `POST /v1/profiles/{rig}/{lens}/calibrations`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};
use serde::Deserialize;
use utoipa::ToSchema;

use super::order::CalibrationOrder;
use crate::{
    contract::Code,
    http::{
        auth::Caller,
        extract::{ProfileKey, params},
        intake::{accept::upload, order::Fields},
        problem::{ApiError, ApiResult},
        state::App,
        views::Calibration,
    },
};
use pinstack_science::types::calibration_options::{CalibrationOptions, ModelChoice};

/// The same by a form.
#[derive(Debug, Deserialize, ToSchema)]
#[allow(dead_code)]
pub struct CalibrationForm {
    /// Options, JSON; every one has a default.
    #[schema(value_type = CalibrationOptions, required = false)]
    options: Option<CalibrationOptions>,
    /// The zip.
    #[schema(value_type = String, format = Binary)]
    stack: Vec<u8>,
}

/// Calibrate from a dot-target stack
///
/// The body is a zip of the dot target at every rail position, bare or as the part `stack` of a form. When the
/// calibration succeeds, its homographies and gains become the next revision of the profile.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/calibrations",
    operation_id = "calibrate",
    tag = "calibrations",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("reference_index" = Option<u32>, Query, description = "0-based index of the reference slice; default: the middle one"),
        ("target_pitch_mm" = Option<f64>, Query, description = "Distance between neighbouring dots; gives the magnification"),
        ("pixel_pitch_mm" = Option<f64>, Query, description = "Size of one pixel on the sensor; kept in the profile"),
        ("focal_mm" = Option<f64>, Query, description = "Focal length engraved on the lens, mm"),
        ("rail_step_mm" = Option<f64>, Query, description = "Distance from slice to slice on the rail, mm; negative when it moves away from the object. Uneven positions: `rail_positions_mm` in the part `options` of a form"),
        ("capture_mode" = Option<pinstack_science::types::profile::CaptureMode>, Query, description = "What moves between slices; a disagreement with what the pictures show is a warning"),
        ("model" = Option<ModelChoice>, Query, description = "Transform model; default `auto`: the simplest that explains the dots"),
        ("allow_new_size" = Option<bool>, Query, description = "The slices may have another size than the profile that this calibration replaces; default false"),
        ("note" = Option<String>, Query, description = "Free text kept in the profile, at most 4,000 characters"),
        ("Idempotency-Key" = Option<String>, Header, description = "A repeat with the same key answers the first calibration"),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: wait up to N seconds for the end, at most 60"),
    ),
    request_body(description = "The zip, bare or in a form; it is streamed to disk", content(
        (Vec<u8> = "application/zip"),
        (Vec<u8> = "application/octet-stream"),
        (CalibrationForm = "multipart/form-data"),
    )),
    responses(
        (status = 200, description = "It has ended within `Prefer: wait`", body = Calibration),
        (status = 202, description = "It is accepted", body = Calibration, headers(("Location" = String, description = "The calibration"))),
        (status = 400, description = "`invalid_request`: a name or parameter that breaks its rule; `upload_incomplete`"),
        (status = 413, description = "`upload_too_large`: the body is over the limit"),
        (status = 415, description = "`unsupported_media_type`: neither a zip nor a form"),
        (status = 422, description = "`invalid_archive`, `unsupported_archive`, `archive_too_large`, `invalid_image`, `size_mismatch`, \
            `slice_count_mismatch`, `idempotency_key_reused`"),
        (status = 503, description = "`queue_full`, with `Retry-After`"),
        (status = 507, description = "`insufficient_storage`, with figures"),
    )
)]
pub async fn create(
    State(app): State<App>,
    caller: Caller,
    key: ProfileKey,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    let mut fields = Fields { pairs: params::pairs(&uri)?, options: None };
    if let Some(name) = ["rig", "lens"].into_iter().find(|name| fields.get(name).is_some()) {
        return Err(ApiError::new(Code::InvalidRequest, format!("the {name} is in the path already")));
    }
    fields.set("rig", key.rig.to_string());
    fields.set("lens", key.lens.to_string());
    upload::<CalibrationOrder, Calibration>(&app, &caller, &headers, body, fields, Calibration::of).await
}
