//! `POST /v1/profiles/{rig}/{lens}/rig-parameters`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};

use super::{precondition, write};
use crate::{
    contract::{Code, profile::Profile},
    http::{
        extract::{ProfileKey, json, params},
        problem::ApiResult,
        state::App,
    },
};
use pinstack_science::types::{profile::HomographyModel, rig_parameters::RigParameters};

/// Make a profile from rig parameters
///
/// Computes homographies and gains from focal length, magnification and rail positions, where no target can be measured.
/// The rail is counted towards the object. With `fixed_lens` the sensor so comes nearer to the lens and the image gets
/// smaller, with `moving_lens` the camera comes nearer to the object and the image gets larger.
///
/// With a fixed lens one scale per slice, `s = d2 / (d2 - dz)` with `d2 = f (1 + M)`, is exact for every depth. With a
/// moving lens the scale `s = (d1 - dz) / d1` with `d1 = f (1 + 1/M)` is right for a flat thing in the plane that is in
/// focus in the reference slice; the parallax of other depths remains. What a lens really does differs from its engraved
/// numbers: a calibration measures it. The answer is as that of `PUT`.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/rig-parameters",
    operation_id = "compute_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens, one per setting of a zoom or macro lens"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the revision that this one replaces"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only when there is no profile yet"),
    ),
    request_body(content = RigParameters, content_type = "application/json", example = json!({
        "image_width": 5760, "image_height": 3840, "reference_index": 10, "slice_count": 21, "rail_step_mm": -0.5,
        "focal_mm": 65, "magnification": 1.0, "pixel_pitch_mm": 0.00625, "capture_mode": "fixed_lens"
    })),
    responses(
        (status = 200, description = "A new revision", body = Profile, headers(("ETag" = String, description = "The revision"))),
        (status = 201, description = "The first revision", body = Profile, headers(
            ("ETag" = String, description = "The revision"), ("Location" = String, description = "The profile"))),
        (status = 400, description = "`invalid_request`: a name that breaks its rule, or a body that is not JSON; `upload_incomplete`"),
        (status = 412, description = "`precondition_failed`: somebody else was faster"),
        (status = 413, description = "`upload_too_large`: over 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_profile`: numbers that cannot be; `errors` names the place"),
    )
)]
pub async fn rig_parameters(
    State(app): State<App>,
    key: ProfileKey,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    json::require_json(&headers)?;
    params::refuse_rest(&params::pairs(&uri)?, "none, everything is in the body")?;
    let condition = precondition(&app, &key, &headers).await?;
    let told: RigParameters = json::parse(&json::read(&app, &headers, body).await?, Code::InvalidProfile)?;
    let draft = write::draft(told.profile()?, HomographyModel::RigParameters, Vec::new());
    write::store(&app, &key, &draft, condition).await
}
