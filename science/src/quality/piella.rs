//! Universal image quality index of one window (Wang and Bovik 2002), as used by Piella and Heijmans (ICIP 2003).
//!
//! `Q = (2 ma mb + c) / (ma^2 + mb^2 + c) * (2 cov + c) / (va + vb + c)` with means `ma`, `mb`, variances `va`, `vb`,
//! the covariance `cov` and the stabiliser `c`.

/// Stabiliser against division by zero in flat windows: (1e-6 * 255)^2.
pub const STABILISER: f64 = 2.55e-4 * 2.55e-4;

/// Mean (0..255) and population variance of one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Mean.
    pub mean: f64,
    /// Population variance.
    pub variance: f64,
}

/// The index of two windows: 1 for equal windows, always within -1..=1.
#[inline]
pub fn index(a: Moments, b: Moments, covariance: f64) -> f64 {
    // rounding may give a flat window a larger covariance than its variances allow
    let bound = (a.variance * b.variance).max(0.0).sqrt();
    let covariance = covariance.clamp(-bound, bound);
    let brightness = (2.0 * a.mean * b.mean + STABILISER) / (a.mean * a.mean + b.mean * b.mean + STABILISER);
    let structure = (2.0 * covariance + STABILISER) / (a.variance + b.variance + STABILISER);
    brightness * structure
}

/// [`index`] in single precision, each window as (mean, variance): for many windows at once.
#[inline(always)]
pub(super) fn index_of_many(a: (f32, f32), b: (f32, f32), covariance: f32) -> f32 {
    const C: f32 = STABILISER as f32;
    let bound = (a.1 * b.1).sqrt();
    let covariance = if covariance > bound { bound } else { covariance };
    let covariance = if covariance < -bound { -bound } else { covariance };
    let brightness = (2.0 * a.0 * b.0 + C) / (a.0 * a.0 + b.0 * b.0 + C);
    let structure = (2.0 * covariance + C) / (a.1 + b.1 + C);
    brightness * structure
}
