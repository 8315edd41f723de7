//! The pinhole camera model of a fused image.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{distortion::Distortion, profile::ProfileInput};

/// Intrinsics of the image, from the profile. They are those of the reference slice, to which all slices are mapped. A
/// crop moves only the principal point.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Intrinsics {
    /// `principal_distance_mm / pixel_pitch_mm`, which photogrammetry programs call the focal length in px.
    pub principal_distance_px: f64,
    /// Principal distance of the profile, mm.
    pub principal_distance_mm: f64,
    /// Its standard deviation, mm; null when the profile does not state it.
    #[serde(default)]
    pub principal_distance_sigma_mm: Option<f64>,
    /// Size of one pixel of the image on the sensor, mm.
    pub pixel_pitch_mm: f64,
    /// Intersection of the optical axis with the image, `[x, y]` px, after the crop. The centre of the top-left pixel
    /// is (0, 0); COLMAP counts from its corner: add 0.5. Null when unknown.
    pub principal_point_px: Option<[f64; 2]>,
    /// Radial lens distortion of the image; null when none was measured.
    #[serde(default)]
    pub distortion: Option<ImageDistortion>,
}

/// Radial distortion in the convention of OpenCV and COLMAP: with `x` and `y` relative to the centre and divided by
/// `principal_distance_px`, and `r^2 = x^2 + y^2`, the distorted point is `(x, y) (1 + k1 r^2 + k2 r^4)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImageDistortion {
    /// Coefficient of `r^2`.
    pub k1: f64,
    /// Coefficient of `r^4`.
    pub k2: f64,
    /// Centre of the distortion in the image, `[x, y]` px, after the crop. Programs that have one centre for distortion
    /// and projection take it as the principal point.
    pub centre_px: [f64; 2],
}

impl ImageDistortion {
    fn of(distortion: &Distortion, principal_distance_px: f64, offset: [f64; 2]) -> Self {
        let square = (principal_distance_px / distortion.radius_px).powi(2);
        Self {
            k1: distortion.k1 * square,
            k2: distortion.k2 * square * square,
            centre_px: [0, 1].map(|a| distortion.centre_px[a] - offset[a]),
        }
    }
}

impl Intrinsics {
    /// The intrinsics of an image whose top-left pixel is at `offset` px of the reference slice; `None` when the
    /// profile lacks the principal distance or the pixel pitch.
    pub fn of(profile: &ProfileInput, offset: [u32; 2]) -> Option<Self> {
        let [x, y] = offset.map(f64::from);
        let principal_distance_px = profile.principal_distance_px()?;
        Some(Self {
            principal_distance_px,
            principal_distance_mm: profile.principal_distance_mm?,
            principal_distance_sigma_mm: profile.pupils.principal_distance_sigma_mm,
            pixel_pitch_mm: profile.pixel_pitch_mm?,
            principal_point_px: profile.principal_point_px.map(|point| [point[0] - x, point[1] - y]),
            distortion: profile.distortion.as_ref().map(|d| ImageDistortion::of(d, principal_distance_px, [x, y])),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distortion_has_the_convention_of_opencv_and_moves_with_the_crop() {
        let lens = Distortion { centre_px: [310.0, 205.0], k1: 0.03, k2: -0.004, radius_px: 360.0 };
        let profile = ProfileInput {
            principal_distance_mm: Some(120.0),
            pixel_pitch_mm: Some(0.05),
            distortion: Some(lens),
            ..ProfileInput::default()
        };
        let image = Intrinsics::of(&profile, [20, 10]).expect("the principal distance is known");
        let found = image.distortion.expect("kept");
        assert_eq!(found.centre_px, [290.0, 195.0]);
        let ideal = [500.0, 60.0];
        let [x, y] = [0, 1].map(|a| (ideal[a] - 310.0 * (1 - a) as f64 - 205.0 * a as f64) / 2400.0);
        let square = x * x + y * y;
        let factor = 1.0 + found.k1 * square + found.k2 * square * square;
        let expected = lens.distort(ideal);
        assert!((310.0 + 2400.0 * factor * x - expected[0]).abs() < 1e-9);
        assert!((205.0 + 2400.0 * factor * y - expected[1]).abs() < 1e-9);
        let none = Intrinsics::of(&ProfileInput { distortion: None, ..profile }, [0, 0]).expect("known");
        assert!(serde_json::to_string(&none).expect("JSON").contains("\"distortion\":null"));
    }
}
