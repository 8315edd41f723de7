//! Stored calibration profiles: the data of a profile under a rig, a lens and a revision.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use pinstack_science::types::{
    Warning,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
};

use super::Name;

/// How a profile was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ProfileSource {
    /// Homographies from elsewhere, sent by a client.
    Upload,
    /// Calibrated by this service from a dot target.
    Calibration,
}

/// The profile of another server, or of another name, that was exported and imported here.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ProfileOrigin {
    /// Name of the rig there.
    pub rig: Name,
    /// Name of the lens there.
    pub lens: Name,
    /// Number of the revision there.
    pub revision: u32,
    /// Digest of geometry and gains.
    pub digest: String,
    /// When it was stored there.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// The calibration there that measured it; null otherwise.
    #[serde(default)]
    pub calibration_id: Option<Uuid>,
}

/// A calibration profile at one revision. A revision never changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Profile {
    /// Name of the rig.
    pub rig: Name,
    /// Name of the lens; one name per setting of a zoom or macro lens.
    pub lens: Name,
    /// Number of the revision: 1 for the first; each write makes the next.
    pub revision: u32,
    /// SHA-256 of geometry and gains, hex. Results name it.
    pub digest: String,
    /// SHA-256 of the camera data, hex: principal distance, principal point, pixel pitch, magnification, capture mode,
    /// rail positions. EXIF and intrinsics are derived from these. Results name it.
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
    #[serde(default)]
    pub origin: Option<ProfileOrigin>,
    /// Transform model of the homographies.
    pub model: HomographyModel,
    /// Changes made to the data when it was stored, and limits of its use.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// `principal_distance_mm` in px, called focal length in photogrammetry; null unless `pixel_pitch_mm` is known.
    #[serde(default)]
    pub principal_distance_px: Option<f64>,
    /// Number of slices.
    pub slice_count: u32,
    /// The data as given or measured, in the form accepted by `PUT`.
    #[serde(flatten)]
    pub input: ProfileInput,
    /// The same data per slice, with measurements of each slice.
    pub slices: Vec<ProfileSlice>,
}
