//! The common camera of a bundle.

use super::types::BundleScan;

/// A pinhole camera with radial distortion. The centre of the top-left pixel is (0, 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Camera {
    /// Principal distance, px.
    pub focal: f64,
    /// Principal point, px. With a distortion, the centre of the distortion: programs have one centre for both.
    pub centre: [f64; 2],
    /// Whether the principal point was measured; otherwise it is the centre of the uncropped image.
    pub centre_is_known: bool,
    /// Coefficients of `r^2` and `r^4` (OpenCV); both are 0 without a distortion.
    pub radial: [f64; 2],
    /// Width and height, px.
    pub size: [f64; 2],
    /// Principal distance, mm.
    pub focal_mm: f64,
    /// Size of a pixel, mm.
    pub pixel_mm: f64,
    /// Relative standard deviation of the principal distance; `None` when it is not stated.
    pub sigma: Option<f64>,
}

/// Relative standard deviation from which a principal distance is only a start: a bundle adjustment of a whole scan
/// finds it to about as much.
const FIXED: f64 = 0.005;

impl Camera {
    /// The camera of a scan; `None` when the profile lacks the principal distance or the pixel pitch.
    pub(super) fn of(scan: &BundleScan) -> Option<Self> {
        let intrinsics = scan.intrinsics?;
        let distortion = intrinsics.distortion;
        let centre = distortion.map(|lens| lens.centre_px).or(intrinsics.principal_point_px);
        Some(Self {
            focal: intrinsics.principal_distance_px,
            centre: centre.unwrap_or(scan.canvas_centre_px),
            centre_is_known: centre.is_some(),
            radial: distortion.map_or([0.0; 2], |lens| [lens.k1, lens.k2]),
            size: [scan.width, scan.height].map(f64::from),
            focal_mm: intrinsics.principal_distance_mm,
            pixel_mm: intrinsics.pixel_pitch_mm,
            sigma: intrinsics.principal_distance_sigma_mm.map(|sigma| sigma / intrinsics.principal_distance_mm),
        })
    }

    /// The principal point for programs that count from the corner of the top-left pixel.
    pub(super) fn centre_by_corner(&self) -> [f64; 2] {
        self.centre.map(|c| c + 0.5)
    }

    /// The principal point relative to the middle of the image, px.
    pub(super) fn centre_by_middle(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.centre[axis] + 0.5 - self.size[axis] / 2.0)
    }

    /// The longer side, px.
    pub(super) fn longer_side(&self) -> f64 {
        self.size[0].max(self.size[1])
    }

    /// True when the principal distance is known so well that the program must not change it; otherwise it is a start.
    pub(super) fn is_fixed(&self) -> bool {
        self.sigma.is_some_and(|sigma| sigma < FIXED)
    }

    /// True when there is a distortion.
    pub(super) fn is_distorted(&self) -> bool {
        self.radial != [0.0; 2]
    }
}
