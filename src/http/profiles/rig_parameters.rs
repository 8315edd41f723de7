//! `POST /v1/profiles/{rig}/{lens}/rig-parameters`

use axum::{extract::State, response::Response};

use super::write;
use crate::{
    contract::{Code, profile::Profile},
    http::{
        ApiResult, App,
        extract::{Conditional, ProfileKey, Sent, json},
    },
};
use pinstack_science::types::{Warning, WarningCode, profile::HomographyModel, rig_parameters::RigParameters};

fn assumed() -> Warning {
    Warning::new(
        WarningCode::PupilRatioAssumed,
        "pupil_ratio is not given, so 1 is assumed, which few macro lenses have: between 0.6 and 1.8 the principal distance \
         is wrong by up to 45 %; give the ratio of the diameters of exit and entrance pupil, or calibrate",
    )
}

/// Compute a profile from rig parameters
///
/// Computes homographies and gains from focal length `f`, magnification `M`, pupil ratio `P` and rail positions, for
/// rigs without a dot target. Rail positions increase towards the object: with `fixed_lens` the sensor then moves
/// towards the lens and the image shrinks; with `moving_lens` the camera, and with `lens_alone` the lens, moves towards
/// the object and the image grows.
///
/// The size of the image at distance `dz` from the reference is `1 - dz / E` with `fixed_lens`, `1 / (1 - dz / D)` with
/// `moving_lens`, and `(1 + dz / E) / (1 - dz / D)` with `lens_alone`, where `E = f (M + P)` and `D = f (1/M + 1/P)`.
/// The first is exact for all depths, the others for the plane in focus in the reference slice; parallax remains for
/// other depths. The principal distance is `E / P`. Without `pupil_ratio`, 1 is assumed, and the response has the
/// warning `pupil_ratio_assumed`. Real lenses differ from their nominal values; a calibration measures them. The
/// response is that of `PUT`.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/rig-parameters",
    operation_id = "compute_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens; use one name per setting of a zoom or macro lens"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the current revision; the request fails if the profile has changed"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only if the profile does not exist yet"),
    ),
    request_body(content = RigParameters, content_type = "application/json", example = json!({
        "image_width": 5760, "image_height": 3840, "reference_index": 10, "slice_count": 21, "rail_step_mm": -0.5,
        "focal_mm": 65, "magnification": 1.0, "pixel_pitch_mm": 0.00625, "capture_mode": "fixed_lens"
    })),
    responses(
        (status = 200, description = "A new revision", body = Profile, headers(("ETag" = String, description = "The revision number"))),
        (status = 201, description = "The profile was created, at revision 1", body = Profile, headers(
            ("ETag" = String, description = "The revision number"), ("Location" = String, description = "URL of the profile"))),
        (status = 400, description = "`invalid_request`: an invalid name, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out"),
        (status = 412, description = "`precondition_failed`: the profile was changed in the meantime; read it again and retry"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_profile`: impossible values; `errors` lists their locations"),
    )
)]
pub async fn rig_parameters(State(app): State<App>, key: Conditional<ProfileKey>, sent: Sent) -> ApiResult<Response> {
    json::require_json(&sent.headers)?;
    sent.refuse_query("the body contains all data")?;
    let condition = key.precondition(&app).await?;
    let parameters: RigParameters =
        json::parse(&json::read(&app, &sent.headers, sent.body).await?, Code::InvalidProfile)?;
    let warnings = if parameters.pupil_ratio.is_none() { vec![assumed()] } else { Vec::new() };
    let draft = write::draft(parameters.profile()?, HomographyModel::RigParameters, warnings);
    write::store(&app, &key, &draft, condition).await
}
