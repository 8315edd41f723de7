//! The pinhole camera model of a fused image.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::profile::ProfileInput;

/// Intrinsics of the image, from the profile. They are those of the reference slice, to which all slices are mapped. A
/// crop moves only the principal point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Intrinsics {
    /// `principal_distance_mm / pixel_pitch_mm`, which photogrammetry programs call the focal length in px.
    pub principal_distance_px: f64,
    /// Distance from the centre of projection to the sensor, mm.
    pub principal_distance_mm: f64,
    /// Size of one pixel of the image on the sensor, mm.
    pub pixel_pitch_mm: f64,
    /// Intersection of the optical axis with the image, `[x, y]` px, after the crop. The centre of the top-left pixel
    /// is (0, 0); COLMAP counts from its corner: add 0.5. Null when unknown.
    pub principal_point_px: Option<[f64; 2]>,
}

impl Intrinsics {
    /// The intrinsics of an image whose top-left pixel is at `offset` px of the reference slice; `None` when the
    /// profile lacks the principal distance or the pixel pitch.
    pub fn of(profile: &ProfileInput, offset: [u32; 2]) -> Option<Self> {
        let [x, y] = offset.map(f64::from);
        Some(Self {
            principal_distance_px: profile.principal_distance_px()?,
            principal_distance_mm: profile.principal_distance_mm?,
            pixel_pitch_mm: profile.pixel_pitch_mm?,
            principal_point_px: profile.principal_point_px.map(|point| [point[0] - x, point[1] - y]),
        })
    }
}
