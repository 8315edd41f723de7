//! Order statistics of measurements, with 0 for an empty slice.

use crate::imaging::{Plane, statistics};

/// The quantile `q` (0..1) by nearest rank; 0 for an empty slice. Reorders `values`.
pub(super) fn quantile(values: &mut [f64], q: f64) -> f64 {
    statistics::quantile_nearest(values, q).unwrap_or(0.0)
}

/// The upper median; 0 for an empty slice. Reorders `values`.
pub(super) fn median(values: &mut [f64]) -> f64 {
    statistics::median(values).unwrap_or(0.0)
}

/// The upper median; 0 without values.
pub(super) fn median_of(values: impl Iterator<Item = f64>) -> f64 {
    median(&mut values.collect::<Vec<_>>())
}

/// The upper median of each coordinate.
pub(super) fn median_point(points: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|a| median_of(points.iter().map(|p| p[a])))
}

/// Standard deviation of normal residuals from their median absolute value, which outliers hardly change.
pub(super) fn mad_sigma(residuals: impl Iterator<Item = f64>) -> f64 {
    1.4826 * median_of(residuals.map(f64::abs))
}

/// Least and largest value; `(f64::MAX, f64::MIN)` without values.
pub(super) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)))
}

/// Evenly spread samples of a plane: 33,000 to 100,000, or all of a smaller one.
pub(super) fn thinned(plane: &Plane<f32>) -> Vec<f64> {
    let stride = (plane.data.len() / 50_000).max(1) | 1;
    plane.data.iter().step_by(stride).map(|&v| f64::from(v)).collect()
}
