//! `PUT /v1/profiles/{rig}/{lens}`

use axum::{
    Json,
    body::Body,
    extract::State,
    http::{HeaderMap, StatusCode, header},
    response::{IntoResponse, Response},
};

use super::{lost_race, precondition};
use crate::{
    http::{
        extract::{ProfileKey, conditional::etag, json},
        problem::ApiResult,
        state::App,
    },
    model::{
        Code,
        profile::{HomographyModel, Profile, ProfileInput, ProfileSlice, ProfileSource},
    },
    store::{Precondition, ProfileDraft, PutProfile},
};

/// Store homographies measured elsewhere
///
/// Every write makes a new revision. With `If-Match` only when the current revision is that one, with
/// `If-None-Match: *` only when there is none.
#[utoipa::path(
    put,
    path = "/v1/profiles/{rig}/{lens}",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig: 1 to 64 of `A-Z a-z 0-9 . _ -`, not beginning with a dot"),
        ("lens" = String, Path, description = "Name of the lens, one per setting of a zoom or macro lens; the same rule"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the revision that this one replaces"),
        ("If-None-Match" = Option<String>, Header, description = "`*`: only when there is no profile yet"),
    ),
    request_body(content = ProfileInput, content_type = "application/json", example = json!({
        "image_width": 640, "image_height": 480, "reference_index": 1,
        "homographies": [[1.01, 0, -3.2, 0, 1.01, -2.4, 0, 0, 1], [1, 0, 0, 0, 1, 0, 0, 0, 1], [0.99, 0, 3.2, 0, 0.99, 2.4, 0, 0, 1]],
        "rail_positions_mm": [0.0, 0.5, 1.0], "capture_mode": "fixed_lens", "note": "measured with our own target"
    })),
    responses(
        (status = 200, description = "A new revision", body = Profile, headers(("ETag" = String, description = "The revision"))),
        (status = 201, description = "The first revision", body = Profile, headers(
            ("ETag" = String, description = "The revision"), ("Location" = String, description = "The profile"))),
        (status = 400, description = "`invalid_request`: a name that breaks its rule, or a body that is not JSON; `upload_incomplete`"),
        (status = 412, description = "`precondition_failed`: somebody else was faster"),
        (status = 413, description = "`upload_too_large`: over 4 MiB of JSON"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_profile`: singular, mirrored, not finite, wrong counts; `errors` names every place"),
    )
)]
pub async fn put(State(app): State<App>, key: ProfileKey, headers: HeaderMap, body: Body) -> ApiResult<Response> {
    json::require_json(&headers)?;
    let condition = precondition(&app, &key, &headers).await?;
    let input: ProfileInput = json::parse(&json::read(body).await?, Code::InvalidProfile)?;
    input.check()?;

    let draft = draft(input);
    let (status, profile) = match app.rows.put_profile(&key.rig, &key.lens, &draft, condition).await? {
        PutProfile::Created(profile) => (StatusCode::CREATED, profile),
        PutProfile::Updated(profile) => (StatusCode::OK, profile),
        PutProfile::PreconditionFailed(current) => {
            let header = if condition == Precondition::Absent { header::IF_NONE_MATCH } else { header::IF_MATCH };
            return Err(lost_race(&key, current, &header));
        }
    };
    let tag = etag(&profile.revision.to_string());
    let mut response = (status, [(header::ETAG, tag)], Json(&profile)).into_response();
    if status == StatusCode::CREATED
        && let Ok(location) = format!("/v1/profiles/{}/{}", key.rig, key.lens).parse()
    {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// What follows from the numbers of the client alone.
fn draft(input: ProfileInput) -> ProfileDraft {
    let gain = |i: usize| input.gains.as_ref().and_then(|gains| gains.get(i)).copied().unwrap_or(1.0);
    let slices = (0..)
        .zip(input.homographies.iter().enumerate())
        .map(|(index, (i, &h))| ProfileSlice::given(index, h, gain(i), input.image_width, input.image_height))
        .collect();
    ProfileDraft { source: ProfileSource::Upload, calibration_id: None, model: HomographyModel::Given, slices, input }
}
