//! Medians and quantiles of slices of floats.
//!
//! Four definitions are in use. They differ in the rank they take, for `n` values and a fraction `q`:
//!
//! | function | value returned |
//! |---|---|
//! | [`quantile_interpolated`] | linear between the neighbours of rank `q (n - 1)` |
//! | [`quantile_nearest`], [`median`] | rank `round(q (n - 1))` |
//! | [`quantile_floor`] | rank `floor(q n)`, at most `n - 1` |
//! | [`median_midpoint`] | the middle value, or the mean of the two middle values |
//!
//! Results of the service depend on the choice, so call sites keep the definition they were tuned with. All functions
//! reorder their argument, expect finite values (a NaN sorts above infinity or, with its sign bit set, below minus
//! infinity), and return `None` for an empty slice. Interpolation sorts, in O(n log n); the others select, in O(n).

use std::cmp::Ordering;

/// `f32` or `f64`.
pub trait Float: Copy {
    /// IEEE 754 total order.
    fn total_order(&self, other: &Self) -> Ordering;
}

impl Float for f32 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

impl Float for f64 {
    fn total_order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }
}

/// The upper median: rank `n / 2`. The same as [`quantile_nearest`] and [`quantile_floor`] with `q = 0.5`.
pub fn median<T: Float>(values: &mut [T]) -> Option<T> {
    let rank = values.len() / 2;
    select(values, rank)
}

/// The value of rank `round(q (n - 1))`; halves round up. `q` is clamped to 0..=1.
pub fn quantile_nearest<T: Float>(values: &mut [T], q: f64) -> Option<T> {
    let rank = (q.clamp(0.0, 1.0) * values.len().saturating_sub(1) as f64).round() as usize;
    select(values, rank)
}

/// The value of rank `floor(q n)`, at most `n - 1`. `q` is clamped to 0..=1.
pub fn quantile_floor<T: Float>(values: &mut [T], q: f64) -> Option<T> {
    let rank = ((values.len() as f64 * q.clamp(0.0, 1.0)) as usize).min(values.len().saturating_sub(1));
    select(values, rank)
}

/// Quantile `q`, interpolated linearly between the two values around rank `q (n - 1)`. `q` is clamped to 0..=1.
pub fn quantile_interpolated(values: &mut [f32], q: f64) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    values.sort_unstable_by(f32::total_cmp);
    let rank = q.clamp(0.0, 1.0) * (values.len() - 1) as f64;
    let (low, fraction) = (rank as usize, (rank - rank.floor()) as f32);
    let high = (low + 1).min(values.len() - 1);
    Some(values[low] + fraction * (values[high] - values[low]))
}

/// The middle value, or the mean of the two middle values when their number is even.
pub fn median_midpoint(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    let odd = !values.len().is_multiple_of(2);
    let upper = select(values, middle)?;
    if odd {
        return Some(upper);
    }
    // selection leaves the lower half before the middle
    let lower = values[..middle].iter().copied().max_by(f64::total_cmp)?;
    Some(f64::midpoint(lower, upper))
}

/// The value of rank `rank`.
fn select<T: Float>(values: &mut [T], rank: usize) -> Option<T> {
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(rank, T::total_order).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_definition_takes_its_rank() {
        let values = || [4.0_f32, 1.0, 3.0, 2.0];
        assert_eq!(median(&mut values()), Some(3.0));
        assert_eq!(quantile_nearest(&mut values(), 0.5), Some(3.0));
        assert_eq!(quantile_nearest(&mut values(), 0.4), Some(2.0));
        assert_eq!(quantile_floor(&mut values(), 0.4), Some(2.0));
        assert_eq!(quantile_floor(&mut values(), 1.0), Some(4.0));
        assert_eq!(quantile_interpolated(&mut values(), 0.5), Some(2.5));
        assert_eq!(quantile_interpolated(&mut values(), 0.0), Some(1.0));
        assert_eq!(quantile_interpolated(&mut values(), 1.0), Some(4.0));
        assert_eq!(median_midpoint(&mut values().map(f64::from)), Some(2.5));
        assert_eq!(median_midpoint(&mut [5.0, 1.0, 2.0]), Some(2.0));
    }

    #[test]
    fn three_definitions_agree_on_the_upper_median() {
        for count in 1..9_u16 {
            let values: Vec<f64> = (0..count).map(|i| f64::from(i * 37 % 11)).collect();
            let of = |f: &dyn Fn(&mut [f64]) -> Option<f64>| f(&mut values.clone());
            let expected = of(&|values| median(values));
            assert_eq!(of(&|values| quantile_nearest(values, 0.5)), expected, "{count} values");
            assert_eq!(of(&|values| quantile_floor(values, 0.5)), expected, "{count} values");
        }
    }

    #[test]
    fn no_values_have_no_quantile() {
        assert_eq!(median::<f32>(&mut []), None);
        assert_eq!(quantile_nearest::<f64>(&mut [], 0.3), None);
        assert_eq!(quantile_floor::<f64>(&mut [], 0.3), None);
        assert_eq!(quantile_interpolated(&mut [], 0.3), None);
        assert_eq!(median_midpoint(&mut []), None);
    }
}
