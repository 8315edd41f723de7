//! `PUT /v1/profiles/{rig}/{lens}`

use axum::{
    body::Body,
    extract::State,
    http::{HeaderMap, Uri},
    response::Response,
};

use super::{numbers, precondition, write};
use crate::{
    contract::profile::Profile,
    http::{
        extract::{ProfileKey, json},
        problem::ApiResult,
        state::App,
    },
};
use pinstack_science::types::{
    matrices::Direction,
    profile::{CaptureMode, HomographyModel, ProfileInput},
};

/// Store homographies measured elsewhere
///
/// Every write makes a new revision. With `If-Match` only when the current revision is that one, with
/// `If-None-Match: *` only when there is none.
///
/// The body is a JSON object, or matrices alone: an array N x 3 x 3 or N x 9 saved by numpy (`.npy`; `.npz` with the array
/// `homographies`, or only one array of that shape, or the one that `array` names), or the same as a bare JSON list. Query
/// parameters then say what matrices do not. Matrices are divided by their last element, turned round where they map from
/// the reference to the slice, and based on the reference slice when its matrix is not the identity (the profile's
/// `warnings` says so). Gains, `principal_distance_mm`, `principal_point_px` and `magnification` only come in a JSON object.
#[utoipa::path(
    put,
    path = "/v1/profiles/{rig}/{lens}",
    operation_id = "put_profile",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig: 1 to 64 of `A-Z a-z 0-9 . _ -`, not beginning with a dot"),
        ("lens" = String, Path, description = "Name of the lens, one per setting of a zoom or macro lens; the same rule"),
        ("image_width" = Option<u32>, Query, description = "Matrices only, and then required: width of the slices, px"),
        ("image_height" = Option<u32>, Query, description = "Matrices only, and then required: height of the slices, px"),
        ("reference_index" = Option<u32>, Query, description = "Matrices only: the reference slice; else the one whose matrix is the identity, else the middle one"),
        ("direction" = inline(Option<Direction>), Query, description = "Matrices only: which way they map; default `slice_to_reference`"),
        ("array" = Option<String>, Query, description = "`.npz` only: the array with the matrices"),
        ("pixel_pitch_mm" = Option<f64>, Query, description = "Matrices only: size of one pixel, mm"),
        ("capture_mode" = inline(Option<CaptureMode>), Query, description = "Matrices only: what moves between slices"),
        ("rail_positions_mm" = Option<String>, Query, description = "Matrices only: position of the rail per slice, mm, with commas between"),
        ("rail_step_mm" = Option<f64>, Query, description = "Matrices only, instead: from one slice to the next, mm"),
        ("note" = Option<String>, Query, description = "Matrices only: free text"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the revision that this one replaces"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only when there is no profile yet"),
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
        (status = 200, description = "A new revision", body = Profile, headers(("ETag" = String, description = "The revision"))),
        (status = 201, description = "The first revision", body = Profile, headers(
            ("ETag" = String, description = "The revision"), ("Location" = String, description = "The profile"))),
        (status = 400, description = "`invalid_request`: a name that breaks its rule, a parameter that breaks its rule or is missing, or a body that is not JSON; `upload_incomplete`"),
        (status = 412, description = "`precondition_failed`: somebody else was faster"),
        (status = 413, description = "`upload_too_large`: over 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: neither JSON nor a numpy file"),
        (status = 422, description = "`invalid_profile`: singular, mirrored, not finite, zeros, wrong counts, or no numpy file of matrices; `errors` names every place"),
    )
)]
pub async fn put(
    State(app): State<App>,
    key: ProfileKey,
    uri: Uri,
    headers: HeaderMap,
    body: Body,
) -> ApiResult<Response> {
    let kind = numbers::kind(&headers)?;
    let condition = precondition(&app, &key, &headers).await?;
    let (input, warnings) = numbers::read(kind, json::read(&app, &headers, body).await?, &uri)?;
    let draft = write::draft(input, HomographyModel::Given, warnings);
    write::store(&app, &key, &draft, condition).await
}
