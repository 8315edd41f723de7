//! Gradient preservation of Xydeas and Petrovic (Electronics Letters 36(4), 2000).
//!
//! With the strengths `g_A`, `g_F` and orientations `a_A`, `a_F` of two Sobel gradients,
//! `G = min(g_A, g_F) / max(g_A, g_F)` and `D = 1 - |a_A - a_F| / (pi / 2)`:
//!
//! `Q = 0.9994 / (1 + exp(-15 (G - 0.5))) * 0.9879 / (1 + exp(-22 (D - 0.8)))`.
//!
//! The constants are those of the corrected public implementation (Liu et al., TPAMI 2024). Tables with other constants
//! differ by up to 0.04.

use std::f32::consts::FRAC_PI_2;

/// Upper bound of [`preservation`]: even an identical gradient does not reach 1.
#[cfg(test)]
pub(super) const UPPER_BOUND: f64 = 0.974_8;

const STRENGTH: Sigmoid = Sigmoid { top: 0.999_4, slope: -15.0, middle: 0.5 };
const ORIENTATION: Sigmoid = Sigmoid { top: 0.987_9, slope: -22.0, middle: 0.8 };

struct Sigmoid {
    top: f32,
    slope: f32,
    middle: f32,
}

impl Sigmoid {
    #[cfg(test)]
    fn at(&self, x: f32) -> f32 {
        self.top / (1.0 + (self.slope * (x - self.middle)).exp())
    }

    #[inline(always)]
    fn fast(&self, x: f32) -> f32 {
        self.top / (1.0 + exp(self.slope * (x - self.middle)))
    }
}

/// How well the gradient `fused` preserves the gradient `source`, both Sobel (x, y) of luma 0..255: 0 lost,
/// [`UPPER_BOUND`] preserved.
#[cfg(test)]
pub(super) fn preservation(source: (f32, f32), fused: (f32, f32)) -> f32 {
    let strength = |(gx, gy): (f32, f32)| (gx * gx + gy * gy).sqrt();
    let (a, f) = (strength(source), strength(fused));
    let ratio = if a > f {
        f / a
    } else if f > 0.0 {
        a / f
    } else {
        1.0
    };
    let angle = (orientation(source) - orientation(fused)).abs();
    STRENGTH.at(ratio) * ORIENTATION.at(1.0 - angle / FRAC_PI_2)
}

/// How well gradients `fused` preserve gradients `source`, `(gx, gy)` each, Sobel of luma 0..255: from 0 (lost) to
/// 0.9748. To within 1e-5 of the formula, without branches and calls, so that the compiler vectorises it.
pub(super) fn preservations(source: (&[f32], &[f32]), fused: (&[f32], &[f32]), out: &mut [f32]) {
    let count = out.len();
    let (ax, ay, fx, fy) = (&source.0[..count], &source.1[..count], &fused.0[..count], &fused.1[..count]);
    for i in 0..count {
        let (a, f) = (ax[i] * ax[i] + ay[i] * ay[i], fx[i] * fx[i] + fy[i] * fy[i]);
        let (low, high) = (if a < f { a } else { f }, if a < f { f } else { a });
        // two zero gradients have the ratio 1
        let ratio = ((low + f32::MIN_POSITIVE) / (high + f32::MIN_POSITIVE)).sqrt();
        // the guard of the published code against division by zero; it makes a zero gradient horizontal
        let (ax, fx) = (if ax[i] == 0.0 { 1e-5 } else { ax[i] }, if fx[i] == 0.0 { 1e-5 } else { fx[i] });
        // orientations lie in -pi/2..pi/2: point both gradients to the right and take the angle between them
        let (a_right, f_right) = (if ax < 0.0 { -1.0 } else { 1.0 }, if fx < 0.0 { -1.0 } else { 1.0 });
        let turned = a_right * f_right;
        let dot = turned * (ax * fx + ay[i] * fy[i]);
        let cross = (ax * fy[i] - ay[i] * fx).abs();
        let angle = angle(cross, dot);
        out[i] = STRENGTH.fast(ratio) * ORIENTATION.fast(1.0 - angle / FRAC_PI_2);
    }
}

/// `atan2(y, x)` for `y` >= 0, to within 2e-6 rad; 0 at the origin.
#[inline(always)]
fn angle(y: f32, x: f32) -> f32 {
    let size = x.abs();
    let (low, high) = (if y < size { y } else { size }, if y < size { size } else { y });
    let t = low / (high + f32::MIN_POSITIVE);
    let s = t * t;
    // Abramowitz and Stegun 4.4.49, with coefficients rounded to f32
    let even = 1.0
        + s * (-0.333_331_45
            + s * (0.199_935_5
                + s * (-0.142_089
                    + s * (0.106_562_64
                        + s * (-0.075_289_64 + s * (0.042_909_61 + s * (-0.016_165_737 + s * 0.002_866_226)))))));
    let base = t * even;
    let steep = if y > size { FRAC_PI_2 - base } else { base };
    if x < 0.0 { 2.0 * FRAC_PI_2 - steep } else { steep }
}

/// `exp(x)` for |x| < 80, to within 3e-6 of its value.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the lowest bits
    const MAGIC: f32 = 12_582_912.0;
    let t = x * std::f32::consts::LOG2_E;
    let shifted = t + MAGIC;
    let f = (t - (shifted - MAGIC)) * std::f32::consts::LN_2;
    let power = 1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0 + f / 720.0)))));
    f32::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// Orientation of a gradient in -pi/2..pi/2, with the guard of the published code for a vertical one.
#[cfg(test)]
fn orientation((gx, gy): (f32, f32)) -> f32 {
    (gy / if gx == 0.0 { 1e-5 } else { gx }).atan()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preserved_gradient_scores_the_upper_bound() {
        let kept = f64::from(preservation((30.0, -12.0), (30.0, -12.0)));
        assert!((kept - UPPER_BOUND).abs() < 2e-4, "{kept}");
    }

    #[test]
    fn a_lost_or_rotated_gradient_scores_almost_zero() {
        assert!(preservation((30.0, 0.0), (0.5, 0.0)) < 0.01);
        assert!(preservation((30.0, 5.0), (-5.0, 30.0)) < 0.01);
    }

    #[test]
    fn the_vectorised_form_agrees_with_the_scalar_one() {
        let values = [-255.0f32, -80.5, -3.0, -0.1, 0.0, 0.1, 1.0, 3.3, 80.25, 255.0];
        for &ax in &values {
            for &ay in &values {
                let (fx, fy): (Vec<f32>, Vec<f32>) = values.iter().flat_map(|&x| values.map(|y| (x, y))).unzip();
                let source = (vec![ax; fx.len()], vec![ay; fx.len()]);
                let mut out = vec![0.0; fx.len()];
                preservations((&source.0, &source.1), (&fx, &fy), &mut out);
                for ((x, y), found) in fx.into_iter().zip(fy).zip(out) {
                    let expected = preservation((ax, ay), (x, y));
                    assert!((found - expected).abs() < 2e-5, "({ax}, {ay}), ({x}, {y}): {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn ringing_costs_as_much_as_blur() {
        let weaker = preservation((10.0, 0.0), (5.0, 0.0));
        let stronger = preservation((10.0, 0.0), (20.0, 0.0));
        assert!((weaker - stronger).abs() < 1e-6);
    }
}
