//! `PUT /v1/profiles/{rig}/{lens}`

use axum::{extract::State, response::Response};

use super::{numbers, write};
use crate::{
    contract::profile::Profile,
    http::{
        ApiResult, App,
        extract::{Conditional, ProfileKey, Sent, json},
    },
};
use pinstack_science::types::{
    matrices::Direction,
    profile::{CaptureMode, HomographyModel, ProfileInput},
};

/// Store homographies measured elsewhere
///
/// Each write makes a new revision. With `If-Match`, only if that is the current revision; with `If-None-Match: *`,
/// only if the profile does not exist yet.
///
/// The body is a JSON object, or matrices only: an array of shape (N, 3, 3) or (N, 9) saved by numpy, or the same as a
/// bare JSON list. In an `.npz`, the array is `homographies`, or the only array of that shape, or the one that `array`
/// names. Query parameters then supply the rest.
///
/// Matrices are normalised: divided by their last element, inverted if they map from the reference to the slice, and
/// multiplied so that the matrix of the reference slice is the identity (recorded in `warnings`). Gains,
/// `principal_distance_mm`, `principal_point_px` and `magnification` can only be sent in a JSON object.
#[utoipa::path(
    put,
    path = "/v1/profiles/{rig}/{lens}",
    operation_id = "put_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig: 1 to 64 characters of `A-Z a-z 0-9 . _ -`, not beginning with a dot"),
        ("lens" = String, Path, description = "Name of the lens, by the same rule; use one name per setting of a zoom or macro lens"),
        ("image_width" = Option<u32>, Query, description = "Matrices only, required: width of the slices, px"),
        ("image_height" = Option<u32>, Query, description = "Matrices only, required: height of the slices, px"),
        ("reference_index" = Option<u32>, Query, description = "Matrices only: 0-based index of the reference slice; default: the slice whose matrix is the identity, otherwise the middle one"),
        ("direction" = inline(Option<Direction>), Query, description = "Matrices only: direction of the mapping; default `slice_to_reference`"),
        ("array" = Option<String>, Query, description = "`.npz` only: name of the array with the matrices"),
        ("pixel_pitch_mm" = Option<f64>, Query, description = "Matrices only: size of one pixel on the sensor, mm"),
        ("capture_mode" = inline(Option<CaptureMode>), Query, description = "Matrices only: what moves between slices"),
        ("rail_positions_mm" = Option<String>, Query, description = "Matrices only: rail position of each slice, mm, separated by commas"),
        ("rail_step_mm" = Option<f64>, Query, description = "Matrices only, instead of `rail_positions_mm`: distance from one slice to the next, mm"),
        ("note" = Option<String>, Query, description = "Matrices only: free text"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the current revision; the request fails if the profile has changed"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only if the profile does not exist yet"),
    ),
    request_body(content(
        (ProfileInput = "application/json", example = json!({
        "image_width": 640, "image_height": 480, "reference_index": 1,
        "homographies": [[1.01, 0, -3.2, 0, 1.01, -2.4, 0, 0, 1], [1, 0, 0, 0, 1, 0, 0, 0, 1], [0.99, 0, 3.2, 0, 0.99, 2.4, 0, 0, 1]],
        "rail_positions_mm": [0.0, 0.5, 1.0], "capture_mode": "fixed_lens", "note": "measured with our own target"
    })),
        (Vec<u8> = "application/x-npy"),
        (Vec<u8> = "application/x-npz"),
        (Vec<u8> = "application/octet-stream"),
    )),
    responses(
        (status = 200, description = "A new revision", body = Profile, headers(("ETag" = String, description = "The revision number"))),
        (status = 201, description = "The profile was created, at revision 1", body = Profile, headers(
            ("ETag" = String, description = "The revision number"), ("Location" = String, description = "URL of the profile"))),
        (status = 400, description = "`invalid_request`: an invalid name, an invalid or missing parameter, or a body that is not JSON; `upload_incomplete`: the connection closed or timed out"),
        (status = 412, description = "`precondition_failed`: the profile was changed in the meantime; read it again and retry"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: neither JSON nor a numpy file"),
        (status = 422, description = "`invalid_profile`: matrices that are singular, mirrored, not finite or zero; wrong counts; or not a numpy file of matrices. `errors` lists every location"),
    )
)]
pub async fn put(State(app): State<App>, key: Conditional<ProfileKey>, sent: Sent) -> ApiResult<Response> {
    let kind = numbers::kind(&sent.headers)?;
    let condition = key.precondition(&app).await?;
    let (input, warnings) = numbers::read(kind, json::read(&app, &sent.headers, sent.body).await?, &sent.uri)?;
    let draft = write::draft(input, HomographyModel::Given, warnings);
    write::store(&app, &key, &draft, condition).await
}
