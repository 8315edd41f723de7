//! A profile as lists show it: without the data per slice.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use pinstack_science::types::{
    Warning,
    profile::{CaptureMode, HomographyModel},
    pupils::{PrincipalDistanceSource, Pupils},
};

use super::{
    Name,
    profile::{Profile, ProfileOrigin, ProfileSource},
};

/// A calibration profile at one revision, without its data per slice (`homographies`, `gains`, `rail_positions_mm` and
/// `slices`). `GET /v1/profiles/{rig}/{lens}?revision=N` returns those.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ProfileSummary {
    /// Name of the rig.
    pub rig: Name,
    /// Name of the lens; one name per setting of a zoom or macro lens.
    pub lens: Name,
    /// Number of the revision: 1 for the first; each write makes the next.
    pub revision: u32,
    /// SHA-256 of geometry and gains, hex. Results name it.
    pub digest: String,
    /// SHA-256 of the camera data, hex. Results name it.
    #[serde(default)]
    pub optics_digest: String,
    /// When this revision was stored.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// How the revision was made.
    pub source: ProfileSource,
    /// The calibration on this server that measured it; null otherwise.
    pub calibration_id: Option<Uuid>,
    /// The exported profile that it was imported from; null otherwise.
    pub origin: Option<ProfileOrigin>,
    /// Transform model of the homographies.
    pub model: HomographyModel,
    /// Changes made to the data when it was stored, and limits of its use.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// Number of slices.
    pub slice_count: u32,
    /// Width of every slice, px.
    pub image_width: u32,
    /// Height of every slice, px.
    pub image_height: u32,
    /// 0-based index of the reference slice.
    pub reference_index: u32,
    /// Size of one pixel on the sensor, mm.
    pub pixel_pitch_mm: Option<f64>,
    /// What moves between slices.
    pub capture_mode: Option<CaptureMode>,
    /// Principal distance of the reference slice, mm.
    pub principal_distance_mm: Option<f64>,
    /// What it is known from; null when it was not stated.
    #[serde(default)]
    pub principal_distance_source: Option<PrincipalDistanceSource>,
    /// What is known of the two pupils of the lens.
    #[serde(flatten)]
    pub pupils: Pupils,
    /// The same in px, called focal length in photogrammetry; null unless `pixel_pitch_mm` is known.
    pub principal_distance_px: Option<f64>,
    /// Where the optical axis meets the reference slice, `[x, y]` px.
    pub principal_point_px: Option<[f64; 2]>,
    /// Magnification (image size / object size) in the plane of focus of the reference slice.
    pub magnification: Option<f64>,
    /// Free text.
    pub note: Option<String>,
}

impl From<&Profile> for ProfileSummary {
    fn from(profile: &Profile) -> Self {
        let input = &profile.input;
        Self {
            rig: profile.rig.clone(),
            lens: profile.lens.clone(),
            revision: profile.revision,
            digest: profile.digest.clone(),
            optics_digest: profile.optics_digest.clone(),
            created_at: profile.created_at,
            source: profile.source,
            calibration_id: profile.calibration_id,
            origin: profile.origin.clone(),
            model: profile.model,
            warnings: profile.warnings.clone(),
            slice_count: profile.slice_count,
            image_width: input.image_width,
            image_height: input.image_height,
            reference_index: input.reference_index,
            pixel_pitch_mm: input.pixel_pitch_mm,
            capture_mode: input.capture_mode,
            principal_distance_mm: input.principal_distance_mm,
            principal_distance_source: input.principal_distance_source,
            pupils: input.pupils,
            principal_distance_px: profile.principal_distance_px,
            principal_point_px: input.principal_point_px,
            magnification: input.magnification,
            note: input.note.clone(),
        }
    }
}
