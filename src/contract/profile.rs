//! Stored calibration profiles: the numbers of a profile under a rig, a lens and a revision.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use pinstack_science::types::{
    Warning,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
};

use super::Name;

/// Where a profile comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ProfileSource {
    /// Homographies measured elsewhere, sent by PUT.
    Upload,
    /// Measured here from a dot target.
    Calibration,
}

/// The profile that an imported one is a copy of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ProfileOrigin {
    /// The rig's name there.
    pub rig: Name,
    /// The lens's name there.
    pub lens: Name,
    /// Its revision there.
    pub revision: u32,
    /// Its digest.
    pub digest: String,
    /// When it was stored there.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// The calibration that measured it there, when one did.
    #[serde(default)]
    pub calibration_id: Option<Uuid>,
}

/// A calibration profile at one revision. A revision never changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Profile {
    /// The rig's name.
    pub rig: Name,
    /// The lens's name (one per setting of a zoom or variable macro lens).
    pub lens: Name,
    /// 1 for the first; every write makes the next.
    pub revision: u32,
    /// SHA-256 of what defines the geometry and the gains, hex; results name it.
    pub digest: String,
    /// SHA-256 of what describes the camera and not the pixels, hex: principal distance, principal point, pixel pitch,
    /// magnification, capture mode, rail positions. EXIF and intrinsics are made from these; results name it too.
    #[serde(default)]
    pub optics_digest: String,
    /// When this revision was stored.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// Uploaded or measured.
    pub source: ProfileSource,
    /// The calibration that measured it, when one did on this server.
    pub calibration_id: Option<Uuid>,
    /// The profile that this one was imported from.
    #[serde(default)]
    pub origin: Option<ProfileOrigin>,
    /// Family of maps the homographies belong to.
    pub model: HomographyModel,
    /// What was done to the numbers on their way in, and what else whoever uses them should know.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// `principal_distance_mm` in px, what photogrammetry calls the focal length; only where `pixel_pitch_mm` is known.
    #[serde(default)]
    pub principal_distance_px: Option<f64>,
    /// Number of slices.
    pub slice_count: u32,
    /// What was given or measured, in the form in which it can be sent again.
    #[serde(flatten)]
    pub input: ProfileInput,
    /// The same per slice, with what is known about each.
    pub slices: Vec<ProfileSlice>,
}
