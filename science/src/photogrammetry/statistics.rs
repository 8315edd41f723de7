//! Medians, 0 of nothing.

use crate::imaging::statistics;

/// The middle value, or the mean of the two middle values.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    statistics::median_midpoint(&mut values).unwrap_or(0.0)
}

/// The middle value, or the upper of the two middle values.
pub(super) fn upper_median(mut values: Vec<f64>) -> f64 {
    statistics::median(&mut values).unwrap_or(0.0)
}
