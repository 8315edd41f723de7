//! The ground around the dots: per sample the nearest dot, and what the rendered dots do not explain.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::{radial_profile::PlacedDot, working_image::pixels_within};
use crate::imaging::Plane;

/// Marks samples whose nearest dot is present.
pub(super) const PRESENT_DOT: u32 = u32::MAX;
/// Marks samples far from every dot.
pub(super) const NO_DOT: u32 = u32::MAX - 1;

/// Per sample: [`PRESENT_DOT`], [`NO_DOT`], or the index of the one of `others` that is nearest.
pub(super) fn nearest_dots(
    others: &[PlacedDot],
    present: &[PlacedDot],
    pitch: f64,
    width: usize,
    height: usize,
) -> Plane<u32> {
    let reach = 0.75 * pitch;
    let mut nearest = Plane::filled(width, height, (f32::MAX, NO_DOT));
    let present = present.iter().map(|dot| (dot, PRESENT_DOT));
    for (dot, which) in present.chain(others.iter().zip(0..)) {
        for y in pixels_within(dot.at[1], reach, 0..height) {
            for x in pixels_within(dot.at[0], reach, 0..width) {
                let far = ((x as f64 - dot.at[0]).powi(2) + (y as f64 - dot.at[1]).powi(2)) as f32;
                let here = &mut nearest.data[y * width + x];
                if far < here.0 {
                    *here = (far, which);
                }
            }
        }
    }
    nearest.map(|(_, which)| which)
}

/// Mean residual around each dot over the samples that are not 0 in `ground`: what the rendered dots do not explain.
pub(super) fn mean_residuals(
    contrast: &Plane<f32>,
    rendered: &Plane<f32>,
    ground: &Plane<u8>,
    dots: &[PlacedDot],
    reach: f64,
) -> Vec<([f64; 2], f64)> {
    let mean = |dot: &PlacedDot| {
        let (mut sum, mut count) = (0.0_f64, 0.0_f64);
        for y in pixels_within(dot.at[1], reach, 0..contrast.height) {
            for x in pixels_within(dot.at[0], reach, 0..contrast.width) {
                let k = y * contrast.width + x;
                if ground.data[k] != 0 {
                    sum += f64::from(contrast.data[k] - rendered.data[k]);
                    count += 1.0;
                }
            }
        }
        (count > 0.25 * reach * reach).then(|| (dot.at, sum / count))
    };
    dots.iter().filter_map(mean).collect()
}

/// The residual near a position as a plane `c0 + c1 x + c2 y`.
pub(super) struct ResidualPlane {
    at: [f64; 2],
    numbers: Vector3<f64>,
}

impl ResidualPlane {
    /// Weighted least squares through the mean residuals of the dots within `reach` px.
    pub(super) fn near(at: [f64; 2], means: &[([f64; 2], f64)], reach: f64) -> Self {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for (p, mean) in means {
            let [x, y] = [0, 1].map(|a| (p[a] - at[a]) / reach);
            let weight = 1.0 - x * x - y * y;
            if weight > 0.0 {
                let row = Vector3::new(1.0, x, y);
                normal += weight * row * row.transpose();
                right += weight * *mean * row;
            }
        }
        // ridge: a slope that the dots do not determine is 0
        let slope = 0.05 * normal[(0, 0)];
        normal += Matrix3::from_diagonal(&Vector3::new(1e-9, slope, slope));
        let numbers = normal.try_inverse().map_or_else(Vector3::zeros, |inverse| inverse * right);
        Self { at, numbers: Vector3::new(numbers[0], numbers[1] / reach, numbers[2] / reach) }
    }

    /// The residual at `p`.
    pub(super) fn at(&self, p: [f64; 2]) -> f64 {
        self.numbers.dot(&Vector3::new(1.0, p[0] - self.at[0], p[1] - self.at[1]))
    }
}
