//! Median and quantiles of values without NaN.

/// Quantile `q` (0..=1), linearly interpolated between neighbours; none without values. Sorts `values`.
pub(super) fn quantile(values: &mut [f32], q: f64) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    values.sort_unstable_by(f32::total_cmp);
    let place = q.clamp(0.0, 1.0) * (values.len() - 1) as f64;
    let (low, share) = (place as usize, (place - place.floor()) as f32);
    let high = (low + 1).min(values.len() - 1);
    Some(values[low] + share * (values[high] - values[low]))
}

/// Quantile `q` (0..=1) without interpolation: much faster than [`quantile`] for many values. Reorders `values`.
pub(super) fn nth(values: &mut [f32], q: f64) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    let place = (q.clamp(0.0, 1.0) * (values.len() - 1) as f64).round() as usize;
    Some(*values.select_nth_unstable_by(place, f32::total_cmp).1)
}

/// The median; none without values. Sorts `values`.
pub(super) fn median(values: &mut [f32]) -> Option<f32> {
    quantile(values, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_neighbours() {
        let mut values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&mut values), Some(2.5));
        assert_eq!(quantile(&mut values, 0.0), Some(1.0));
        assert_eq!(quantile(&mut values, 1.0), Some(4.0));
        assert_eq!(median(&mut []), None);
    }
}
