//! Order statistics of measurements, with 0 for an empty slice.

use crate::imaging::statistics;

/// The quantile `q` (0..1) by nearest rank; 0 for an empty slice. Reorders `values`.
pub(super) fn quantile(values: &mut [f64], q: f64) -> f64 {
    statistics::quantile_nearest(values, q).unwrap_or(0.0)
}

/// The upper median; 0 for an empty slice. Reorders `values`.
pub(super) fn median(values: &mut [f64]) -> f64 {
    statistics::median(values).unwrap_or(0.0)
}
