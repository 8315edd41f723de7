//! Light that falls off before the blur: its effect on the phase of strongly blurred slices.
//!
//! A lamp or a lens may light one side of each blur disc more than the other. The image is then the pattern convolved
//! with a disc of tilted brightness, and the phase of the grid's first harmonic is shifted, by
//!
//! `g r J2(k r) / (k J1(k r))`
//!
//! along the gradient, with `g` the relative gradient of the light, `r` the blur radius and `k = 2 pi / pitch`. The
//! shift is small until the harmonic nearly vanishes (`J1(k r) = 0` at 0.61 of the pitch), where it grows without
//! limit. How much of the gradient arises before the blur is unknown (vignetting of the sensor side arises after it).
//! So the dots are not corrected: their uncertainty grows by the shift, and the rail law decides where they say
//! nothing.

use nalgebra::{SMatrix, SVector};

use super::{blur, detected::Detection, statistics::median_of, tracked::Tracked};

/// Share of the strongest modulation below which the shift matters.
const WEAK: f64 = 0.3;
/// Uncertainty of a dot over its shift. All dots of a slice share the error, so their number does not reduce it.
const SHARED: f64 = 1.5;
/// Largest uncertainty, grid steps.
const MOST: f64 = 0.3;

/// Adds the shift to the uncertainty of the dots of slices in which the pattern nearly vanishes.
pub(super) fn widen_weak_slices(tracked: &mut Tracked) {
    let strongest = tracked.strongest();
    for detection in tracked.detections.iter_mut().flatten() {
        let share = detection.modulation / strongest;
        if share < WEAK {
            widen(detection, share);
        }
    }
}

fn widen(detection: &mut Detection, share: f64) {
    let Some(light) = LightSurface::fit(detection) else { return };
    let shift = blur::tilt_shift(blur::radius(share)) * detection.pitch * detection.pitch;
    let most = MOST * detection.pitch;
    let gradients = detection.dots.values().map(|dot| light.gradient(dot.at));
    detection.common_sigma = SHARED * shift * median_of(gradients);
    for dot in detection.dots.values_mut() {
        let sigma = (SHARED * light.gradient(dot.at) * shift).min(most);
        dot.sigma = dot.sigma.hypot(sigma);
        dot.shared_sigma = dot.shared_sigma.hypot(sigma);
    }
}

/// `ln` of the mean light over the image as a polynomial of degree 2.
struct LightSurface {
    centre: [f64; 2],
    coefficients: SVector<f64, 6>,
}

impl LightSurface {
    fn fit(detection: &Detection) -> Option<Self> {
        let lit = detection.dots.values().filter(|d| d.light.mean > 1.0);
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for dot in lit.clone() {
            sum = [sum[0] + dot.at[0], sum[1] + dot.at[1]];
            count += 1.0;
        }
        if count < 12.0 {
            return None;
        }
        let centre = sum.map(|s| s / count);
        let (mut normal, mut right) = (SMatrix::<f64, 6, 6>::identity() * 1e-6, SVector::<f64, 6>::zeros());
        for dot in lit {
            let [x, y] = [0, 1].map(|a: usize| (dot.at[a] - centre[a]) / detection.pitch);
            let row = SVector::<f64, 6>::from([1.0, x, y, x * x, x * y, y * y]);
            normal += row * row.transpose();
            right += row * dot.light.mean.ln();
        }
        let mut coefficients = normal.cholesky()?.solve(&right);
        // per pitch to per px
        let pitch = detection.pitch;
        for (k, power) in [(1, 1), (2, 1), (3, 2), (4, 2), (5, 2)] {
            coefficients[k] /= pitch.powi(power);
        }
        Some(Self { centre, coefficients })
    }

    /// Size of the relative gradient at `p`, per px.
    fn gradient(&self, p: [f64; 2]) -> f64 {
        let [x, y] = [0, 1].map(|a: usize| p[a] - self.centre[a]);
        let c = &self.coefficients;
        (c[1] + 2.0 * c[3] * x + c[4] * y).hypot(c[2] + c[4] * x + 2.0 * c[5] * y)
    }
}
