//! Radial lens distortion that stays with the sensor.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Radial distortion of the pixels of every slice, the same for all slices.
///
/// A point `p` of the ideal image (of a camera without distortion) is seen in the slice at
///
/// `D(p) = c + (p - c) (1 + k1 rho^2 + k2 rho^4)`, with `rho = |p - c| / radius_px`
///
/// in px, where `c` is `centre_px`. Positive `k1` is pincushion distortion. The direction is that of OpenCV and COLMAP
/// (Brown's model): with a principal point `c` and a focal length `f` px, their coefficients are
/// `k1 (f / radius_px)^2` and `k2 (f / radius_px)^4`.
///
/// With a distortion, the homographies of a profile map ideal pixels of a slice to ideal pixels of the reference slice:
/// the pixel `x` of the reference slice is at `D(H^-1 D^-1(x))` in the slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Distortion {
    /// Centre of the distortion, `[x, y]` px.
    pub centre_px: [f64; 2],
    /// Coefficient of `rho^2`.
    pub k1: f64,
    /// Coefficient of `rho^4`.
    #[serde(default)]
    pub k2: f64,
    /// The distance from the centre at which `rho` is 1, px.
    pub radius_px: f64,
}

/// Least slope of the distorted radius over the ideal radius, within the image.
const MIN_SLOPE: f64 = 0.2;
/// Largest ratio of the ideal radius to the distorted radius, and of the distorted to the ideal.
const MAX_RATIO: f64 = 2.0;

impl Distortion {
    /// Ideal px to px of the slice.
    pub fn distort(&self, p: [f64; 2]) -> [f64; 2] {
        let d = self.centred(p);
        let square = (d[0] * d[0] + d[1] * d[1]) / (self.radius_px * self.radius_px);
        let factor = 1.0 + square * (self.k1 + square * self.k2);
        [0, 1].map(|a| self.centre_px[a] + factor * d[a])
    }

    /// Px of the slice to ideal px: the inverse of [`Distortion::distort`] within the image.
    pub fn undistort(&self, x: [f64; 2]) -> [f64; 2] {
        let d = self.centred(x);
        let distorted = d[0].hypot(d[1]) / self.radius_px;
        if distorted < 1e-12 {
            return x;
        }
        let factor = self.ideal_radius(distorted) / distorted;
        [0, 1].map(|a| self.centre_px[a] + factor * d[a])
    }

    /// Newton iteration for the ideal radius; both radii relative to `radius_px`.
    fn ideal_radius(&self, distorted: f64) -> f64 {
        let mut rho = distorted;
        for _ in 0..20 {
            let square = rho * rho;
            let miss = rho * (1.0 + square * (self.k1 + square * self.k2)) - distorted;
            let slope = 1.0 + square * (3.0 * self.k1 + 5.0 * square * self.k2);
            let step = miss / slope.max(0.5 * MIN_SLOPE);
            rho = (rho - step).clamp(0.0, MAX_RATIO * distorted);
            if step.abs() < 1e-14 * distorted {
                break;
            }
        }
        rho
    }

    fn centred(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|a| p[a] - self.centre_px[a])
    }

    /// Largest distance of a corner of a `width` x `height` image from the centre, px.
    fn farthest(&self, width: u32, height: u32) -> f64 {
        let corners = super::Homography::corners(width, height);
        corners.into_iter().map(|p| self.centred(p)).map(|d| d[0].hypot(d[1])).fold(0.0, f64::max)
    }

    /// The distance from the centre, in ideal px, beyond which no ideal point is in a `width` x `height` image.
    pub fn max_ideal_radius_px(&self, width: u32, height: u32) -> f64 {
        self.ideal_radius(self.farthest(width, height) / self.radius_px) * self.radius_px
    }

    /// Largest distance, px, between an image corner and its ideal position.
    pub fn max_displacement_px(&self, width: u32, height: u32) -> f64 {
        let moved = |corner: [f64; 2]| {
            let ideal = self.undistort(corner);
            (ideal[0] - corner[0]).hypot(ideal[1] - corner[1])
        };
        super::Homography::corners(width, height).into_iter().map(moved).fold(0.0, f64::max)
    }

    /// Why this cannot be the distortion of a `width` x `height` image, as the predicate of a sentence; `None` when it
    /// can. A valid distortion is finite, its centre is at most one image size outside the image, and within the image
    /// the distorted radius grows with the ideal radius, with a slope of at least 0.2, to between half and twice of it.
    pub fn violation(&self, width: u32, height: u32) -> Option<String> {
        let numbers = [self.centre_px[0], self.centre_px[1], self.k1, self.k2, self.radius_px];
        if numbers.iter().any(|v| !v.is_finite()) {
            return Some("has a number that is not finite".into());
        }
        if !(1.0..=1e6).contains(&self.radius_px) {
            return Some(format!("has the radius_px {}; it must be 1 to 1000000 px", self.radius_px));
        }
        let size = [f64::from(width), f64::from(height)];
        if !(0..2).all(|a| (-size[a]..=2.0 * size[a]).contains(&self.centre_px[a])) {
            return Some(format!(
                "has the centre {:?} px, far outside the image; x must be -{width} to {}, and y -{height} to {}",
                self.centre_px,
                2.0 * size[0],
                2.0 * size[1]
            ));
        }
        let far = self.farthest(width, height) / self.radius_px;
        const STEPS: u32 = 512;
        for step in 1..=STEPS {
            let rho = MAX_RATIO * far * f64::from(step) / f64::from(STEPS);
            let square = rho * rho;
            let factor = 1.0 + square * (self.k1 + square * self.k2);
            let slope = 1.0 + square * (3.0 * self.k1 + 5.0 * square * self.k2);
            if !(slope >= MIN_SLOPE && (1.0 / MAX_RATIO..=MAX_RATIO).contains(&factor)) {
                break;
            }
            if rho * factor >= far {
                return None;
            }
        }
        Some(
            "nearly folds the image, or puts a corner at less than half or more than twice its ideal distance from the \
             centre; check k1, k2 and radius_px (k1 and k2 are for distances in units of radius_px)"
                .into(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(k1: f64, k2: f64) -> Distortion {
        Distortion { centre_px: [310.0, 205.0], k1, k2, radius_px: 360.0 }
    }

    #[test]
    fn undistort_is_the_inverse_of_distort_over_the_image() {
        for lens in [of(0.03, 0.0), of(-0.08, 0.01), of(0.2, -0.05), of(0.0, 0.0)] {
            assert_eq!(lens.violation(600, 400), None, "{lens:?}");
            for corner in super::super::Homography::corners(600, 400).into_iter().chain([[310.0, 205.0], [1.0, 200.0]])
            {
                let back = lens.distort(lens.undistort(corner));
                assert!((back[0] - corner[0]).hypot(back[1] - corner[1]) < 1e-9, "{lens:?} at {corner:?}");
            }
        }
        // 3 % at the radius
        let moved = of(0.03, 0.0).distort([670.0, 205.0]);
        assert!((moved[0] - 680.8).abs() < 1e-9 && moved[1] == 205.0, "{moved:?}");
    }

    #[test]
    fn a_distortion_that_folds_the_image_is_refused() {
        for lens in [of(-0.5, 0.0), of(5.0, 0.0), of(0.1, -0.4), of(f64::NAN, 0.0), of(1e300, -1e300)] {
            assert!(lens.violation(600, 400).is_some(), "{lens:?}");
        }
        assert!(Distortion { radius_px: 0.0, ..of(0.0, 0.0) }.violation(600, 400).is_some());
        assert!(Distortion { centre_px: [1e5, 0.0], ..of(0.0, 0.0) }.violation(600, 400).is_some());
    }

    #[test]
    fn k2_may_be_absent_in_json() {
        let read: Distortion = serde_json::from_str(r#"{"centre_px":[1,2],"k1":0.1,"radius_px":50}"#).expect("valid");
        assert_eq!((read.k2, read.centre_px), (0.0, [1.0, 2.0]));
    }
}
