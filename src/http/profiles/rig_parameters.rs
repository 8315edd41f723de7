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
use pinstack_science::types::{profile::HomographyModel, rig_parameters::RigParameters};

/// Compute a profile from rig parameters
///
/// Computes homographies and gains from focal length `f`, magnification `M` and rail positions, for rigs without a dot
/// target. Rail positions increase towards the object: with `fixed_lens` the sensor then moves towards the lens and the
/// image shrinks; with `moving_lens` the camera moves towards the object and the image grows.
///
/// `fixed_lens`: the scale of a slice at distance `dz` from the reference is `s = d2 / (d2 - dz)` with `d2 = f (1 +
/// M)`, exact for all depths. `moving_lens`: `s = (d1 - dz) / d1` with `d1 = f (1 + 1/M)`, exact for the plane in focus
/// in the reference slice; parallax remains for other depths. Real lenses differ from their nominal values; a
/// calibration measures them. The response is that of `PUT`.
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
    let draft = write::draft(parameters.profile()?, HomographyModel::RigParameters, Vec::new());
    write::store(&app, &key, &draft, condition).await
}
