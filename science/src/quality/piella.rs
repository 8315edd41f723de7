//! Universal image quality index of one window (Wang and Bovik 2002), as used by Piella and Heijmans (ICIP 2003).
//!
//! `Q = (2 ma mb + c) / (ma^2 + mb^2 + c) * (2 cov + c) / (va + vb + c)` with means `ma`, `mb`, variances `va`, `vb`,
//! the covariance `cov` and the stabiliser `c`.

use super::score::same_shape;
use crate::imaging::Plane;

/// Stabiliser against division by zero in flat windows: (1e-6 * 255)^2.
const STABILISER: f64 = 2.55e-4 * 2.55e-4;

/// Mean (0..255) and population variance of one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moments {
    /// Mean.
    pub(super) mean: f64,
    /// Population variance.
    pub(super) variance: f64,
}

/// One window of two images.
pub(super) struct WindowPair {
    pub(super) source: Moments,
    pub(super) fused: Moments,
    pub(super) covariance: f64,
}

/// Side of a window, px.
pub(super) const SIDE: usize = 8;

/// Moments of every 8x8 window, in two passes: slow, and numerically safe for any content.
pub(super) fn moments(source: &Plane<f32>, fused: &Plane<f32>) -> Option<Vec<WindowPair>> {
    if !same_shape(source, fused) || fused.width < SIDE || fused.height < SIDE {
        return None;
    }
    let samples = (SIDE * SIDE) as f64;
    let mut windows = Vec::with_capacity((fused.width + 1 - SIDE) * (fused.height + 1 - SIDE));
    for y in 0..=fused.height - SIDE {
        for x in 0..=fused.width - SIDE {
            let rows = (y..y + SIDE).flat_map(|y| source.row(y)[x..x + SIDE].iter().zip(&fused.row(y)[x..x + SIDE]));
            let pairs = rows.map(|(&s, &f)| (f64::from(s), f64::from(f)));
            let (s, f) = pairs.clone().fold((0.0, 0.0), |(s, f), (vs, vf)| (s + vs, f + vf));
            let (s, f) = (s / samples, f / samples);
            let squares = pairs.fold((0.0, 0.0, 0.0), |(ss, ff, sf), (vs, vf)| {
                (ss + (vs - s) * (vs - s), ff + (vf - f) * (vf - f), sf + (vs - s) * (vf - f))
            });
            windows.push(WindowPair {
                source: Moments { mean: s, variance: squares.0 / samples },
                fused: Moments { mean: f, variance: squares.1 / samples },
                covariance: squares.2 / samples,
            });
        }
    }
    Some(windows)
}

/// The index of two windows: 1 for equal windows, always within -1..=1.
#[cfg(test)]
pub(super) fn index(a: Moments, b: Moments, covariance: f64) -> f64 {
    // rounding may give a flat window a larger covariance than its variances allow
    let bound = (a.variance * b.variance).max(0.0).sqrt();
    let covariance = covariance.clamp(-bound, bound);
    let brightness = (2.0 * a.mean * b.mean + STABILISER) / (a.mean * a.mean + b.mean * b.mean + STABILISER);
    let structure = (2.0 * covariance + STABILISER) / (a.variance + b.variance + STABILISER);
    brightness * structure
}

/// The index of two windows, each as (mean, variance), in single precision: for many windows at once.
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
