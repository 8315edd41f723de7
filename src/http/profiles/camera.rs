//! `POST /v1/profiles/{rig}/{lens}/camera`

use axum::{extract::State, response::Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{find, write};
use crate::{
    contract::{Code, profile::Profile, ranges::check_calibration},
    http::{
        ApiResult, App,
        artifacts::outcome::of_calibration,
        extract::{Conditional, ProfileKey, Sent, json},
    },
    store::{Precondition, ProfileDraft},
};
use pinstack_science::{
    calibration::add_camera,
    types::{calibration_options::CalibrationOptions, capture_mode::CaptureMode},
};

/// Body of `POST /v1/profiles/{rig}/{lens}/camera`. A number that is missing is taken from the profile.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CameraNumbers {
    /// Size of one pixel on the sensor, mm, 0.00001 to 1.
    pub pixel_pitch_mm: Option<f64>,
    /// Distance between neighbouring dots of the target that was photographed, mm.
    pub target_pitch_mm: Option<f64>,
    /// Rail step from slice to slice, mm, counted towards the object; negative for a movement away from it.
    pub rail_step_mm: Option<f64>,
    /// Focal length of the lens, mm.
    pub focal_mm: Option<f64>,
    /// Pupil ratio: diameter of the exit pupil over that of the entrance pupil.
    pub pupil_ratio: Option<f64>,
    /// Image size over object size in the reference slice, 0.0001 to 1000; needed where no target of known pitch gives
    /// it.
    pub magnification: Option<f64>,
    /// What moves between slices.
    pub capture_mode: Option<CaptureMode>,
}

impl CameraNumbers {
    /// As options of a calibration, within their ranges.
    fn options(&self) -> ApiResult<CalibrationOptions> {
        let options = CalibrationOptions {
            pixel_pitch_mm: self.pixel_pitch_mm,
            target_pitch_mm: self.target_pitch_mm,
            rail_step_mm: self.rail_step_mm,
            focal_mm: self.focal_mm,
            pupil_ratio: self.pupil_ratio,
            capture_mode: self.capture_mode,
            ..CalibrationOptions::default()
        };
        check_calibration(&options)?;
        Ok(options)
    }
}

/// Give a profile its camera
///
/// Computes the principal distance from numbers that were not given to the calibration, and stores the next revision
/// with it. Homographies, gains and what was measured of each slice stay as they are; no picture is needed. The
/// numbers have the meaning that they have in a calibration, and the camera is the same; the pictures of a moved target
/// are not read again. If the numbers do not tell the principal distance, nothing is stored, and the error says what is
/// missing.
#[utoipa::path(
    post,
    path = "/v1/profiles/{rig}/{lens}/camera",
    operation_id = "add_profile_camera",
    tag = "profiles",
    params(
        ("rig" = String, Path, description = "Name of the rig"),
        ("lens" = String, Path, description = "Name of the lens"),
        ("If-Match" = Option<String>, Header, description = "`ETag` of the current revision; the request fails if the profile has changed"),
    ),
    request_body(content = CameraNumbers, content_type = "application/json", example = json!({
        "target_pitch_mm": 2.0, "pixel_pitch_mm": 0.00414, "rail_step_mm": 0.25, "focal_mm": 65
    })),
    responses(
        (status = 200, description = "A new revision, or the current one if the camera is the same", body = Profile, headers(("ETag" = String, description = "The revision number"))),
        (status = 400, description = "`invalid_request`: an invalid name, a body that is not JSON, or a value outside its range; `upload_incomplete`: the connection closed or timed out"),
        (status = 404, description = "`profile_not_found`"),
        (status = 412, description = "`precondition_failed`: the profile was changed in the meantime; read it again and retry"),
        (status = 413, description = "`upload_too_large`: the body exceeds 4 MiB"),
        (status = 415, description = "`unsupported_media_type`: not JSON"),
        (status = 422, description = "`invalid_profile`: the principal distance is still unknown, or the numbers contradict the profile"),
    )
)]
pub async fn add(State(app): State<App>, key: Conditional<ProfileKey>, sent: Sent) -> ApiResult<Response> {
    json::require_json(&sent.headers)?;
    sent.refuse_query("the body contains all data")?;
    let condition = key.precondition(&app).await?;
    let numbers: CameraNumbers = json::parse(&json::read(&app, &sent.headers, sent.body).await?, Code::InvalidRequest)?;
    let options = numbers.options()?;
    let current = find(&app, &key.of.rig, &key.of.lens, None).await?;
    if !condition.holds(Some(current.revision)) {
        return Err(key.failed(Some(current.revision)));
    }
    let pitch = dot_pitch_px(&app, &current).await?;
    let (input, found) = add_camera(&current.input, &current.slices, pitch, numbers.magnification, &options)?;
    if input == current.input {
        return Ok(key.written(false, current.revision, &current));
    }
    let mut warnings = current.warnings;
    warnings.retain(|warning| found.iter().all(|other| other.code != warning.code));
    warnings.extend(found);
    let draft = ProfileDraft {
        input,
        source: current.source,
        calibration_id: current.calibration_id,
        model: current.model,
        slices: current.slices,
        origin: current.origin,
        warnings,
    };
    // what was read is what is replaced
    write::store(&app, &key, &draft, Precondition::Revision(current.revision)).await
}

/// The dot pitch in the reference slice, if a calibration that is still stored measured it.
async fn dot_pitch_px(app: &App, profile: &Profile) -> ApiResult<Option<f64>> {
    let Some(id) = profile.calibration_id else { return Ok(None) };
    let Some(job) = app.store.metadata.job(id).await? else { return Ok(None) };
    Ok(of_calibration(&job).ok().and_then(|outcome| outcome.dot_pitch_px))
}
