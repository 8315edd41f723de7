//! Gradient preservation of Xydeas & Petrovic (Electronics Letters 36(4), 2000), with the constants of the
//! corrected public implementation (Liu et al. 2024); other tables use other constants and differ by 0.04.

use std::f32::consts::FRAC_PI_2;

/// Upper bound of [`preservation`]: even an identical gradient does not score 1.
pub const UPPER_BOUND: f64 = 0.974_8;

const STRENGTH: Sigmoid = Sigmoid { top: 0.999_4, slope: -15.0, middle: 0.5 };
const ORIENTATION: Sigmoid = Sigmoid { top: 0.987_9, slope: -22.0, middle: 0.8 };

struct Sigmoid {
    top: f32,
    slope: f32,
    middle: f32,
}

impl Sigmoid {
    #[inline]
    fn at(&self, x: f32) -> f32 {
        self.top / (1.0 + (self.slope * (x - self.middle)).exp())
    }
}

/// How well the gradient `fused` keeps the gradient `source`, both Sobel (x, y) of luma 0..255:
/// 0 lost, [`UPPER_BOUND`] kept whole.
#[inline]
pub fn preservation(source: (f32, f32), fused: (f32, f32)) -> f32 {
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

/// Orientation of a gradient in -pi/2..pi/2; the published guard for a vertical one.
#[inline]
fn orientation((gx, gy): (f32, f32)) -> f32 {
    (gy / if gx == 0.0 { 1e-5 } else { gx }).atan()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gradient_kept_whole_scores_the_upper_bound() {
        let kept = f64::from(preservation((30.0, -12.0), (30.0, -12.0)));
        assert!((kept - UPPER_BOUND).abs() < 2e-4, "{kept}");
    }

    #[test]
    fn a_lost_or_turned_gradient_scores_almost_nothing() {
        assert!(preservation((30.0, 0.0), (0.5, 0.0)) < 0.01);
        assert!(preservation((30.0, 5.0), (-5.0, 30.0)) < 0.01);
    }

    #[test]
    fn ringing_is_punished_like_blur() {
        let weaker = preservation((10.0, 0.0), (5.0, 0.0));
        let stronger = preservation((10.0, 0.0), (20.0, 0.0));
        assert!((weaker - stronger).abs() < 1e-6);
    }
}
