//! How reliable the decision map is: label noise, and the lead of the sharpest slice over the second.

use crate::imaging::{Plane, statistics};

/// Radius of the square neighbourhood, px.
const REACH: usize = 2;
/// At most about this many pixels are examined.
const MOST: usize = 10_000;

/// Share of the pixels `at` whose label is not the most frequent one of their 5x5 neighbourhood; none without pixels.
pub(super) fn fraction(index: &Plane<u16>, at: &[(usize, usize)]) -> Option<f64> {
    let step = at.len().div_ceil(MOST).max(1);
    let (mut odd, mut count) = (0, 0);
    let mut around = Vec::with_capacity((2 * REACH + 1).pow(2));
    for &(x, y) in at.iter().step_by(step) {
        let (left, right) = (x.saturating_sub(REACH), (x + REACH + 1).min(index.width));
        around.clear();
        for row in y.saturating_sub(REACH)..(y + REACH + 1).min(index.height) {
            around.extend_from_slice(&index.row(row)[left..right]);
        }
        around.sort_unstable();
        let own = index.at(x, y);
        let of_own = around.iter().filter(|&&slice| slice == own).count();
        let most = around.chunk_by(|a, b| a == b).map(<[u16]>::len).max().unwrap_or(0);
        odd += usize::from(of_own < most);
        count += 1;
    }
    (count > 0).then(|| odd as f64 / f64::from(count))
}

/// Median over pixels of the lead `(s1 - s2) / s1` of the largest saliency over the second largest: 0 (none) to 1.
pub(super) fn median_lead<'a>(saliency: impl Iterator<Item = &'a [f32]>) -> Option<f64> {
    let lead = |values: &[f32]| {
        let (first, second) = values.iter().fold((0.0f32, 0.0f32), |(first, second), &value| match value {
            value if value > first => (value, first),
            value => (first, second.max(value)),
        });
        (first - second) / first.max(f32::MIN_POSITIVE)
    };
    statistics::quantile_interpolated(&mut saliency.map(lead).collect::<Vec<f32>>(), 0.5).map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_pixel_is_noise_and_a_straight_border_is_not() {
        let halves = Plane::from_fn(40, 40, |x, _| u16::from(x >= 20));
        let all: Vec<(usize, usize)> = (0..40).flat_map(|y| (0..40).map(move |x| (x, y))).collect();
        assert_eq!(fraction(&halves, &all), Some(0.0));
        let mut single = halves;
        single.row_mut(7)[9] = 5;
        assert_eq!(fraction(&single, &[(9, 7), (30, 30)]), Some(0.5));
        assert_eq!(fraction(&single, &[]), None);
    }

    #[test]
    fn the_lead_of_the_sharpest_slice_is_a_share_of_it() {
        let saliency: [&[f32]; 3] = [&[8.0, 6.0, 1.0], &[2.0, 4.0, 1.0], &[9.0, 9.0, 9.0]];
        assert_eq!(median_lead(saliency.into_iter()), Some(0.25));
        assert_eq!(median_lead(std::iter::empty()), None);
    }
}
