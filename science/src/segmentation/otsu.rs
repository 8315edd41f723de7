//! Otsu's threshold: N. Otsu, *A threshold selection method from gray-level histograms*, IEEE Trans. SMC 9(1), 1979.
//!
//! The threshold maximises the between-class variance `s_B^2 = p_0 p_1 (m_0 - m_1)^2` of dark and bright pixels, with
//! `p` the share and `m` the mean of each class. The separability is `s_B^2 / s^2`, with `s^2` the total variance.

use rayon::prelude::*;

/// Pixels that a thread takes at a time.
pub(super) const PART: usize = 1 << 16;

/// Bins over full scale: so many that the rounding (1/8190 of full scale) is far below noise.
const BINS: usize = 4096;

/// A histogram of grey values, shares of full scale.
#[derive(Debug, Clone)]
pub(super) struct Histogram {
    counts: Vec<u64>,
}

/// A threshold and how well it separates the two classes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Otsu {
    /// Share of full scale.
    pub threshold: f64,
    /// Variance between the two classes over the variance of all, 0 to 1.
    pub separability: f64,
}

impl Histogram {
    /// Counts values in 0..=1; values outside are counted at the nearer end.
    pub(super) fn of(values: impl Iterator<Item = f32>) -> Self {
        let mut counts = vec![0u64; BINS];
        for value in values {
            // saturates at 0; NaN counts as 0
            let bin = (value * (BINS - 1) as f32 + 0.5) as usize;
            counts[bin.min(BINS - 1)] += 1;
        }
        Self { counts }
    }

    /// Counts the values of the pixels for whose index `counts` is true.
    pub(super) fn of_pixels(values: &[f32], counts: impl Fn(usize) -> bool + Sync) -> Self {
        let parts = values.par_chunks(PART).enumerate().map(|(part, values)| {
            Self::of((part * PART..).zip(values).filter(|&(at, _)| counts(at)).map(|(_, &value)| value))
        });
        parts.reduce(
            || Self { counts: vec![0; BINS] },
            |mut sum, part| {
                sum.counts.iter_mut().zip(part.counts).for_each(|(sum, count)| *sum += count);
                sum
            },
        )
    }

    /// The threshold with the largest between-class variance, in the middle when a range of thresholds has it; none
    /// when there is a single value.
    pub(super) fn otsu(&self) -> Option<Otsu> {
        let between = self.between();
        let best = between.iter().copied().fold(0.0, f64::max);
        if best <= 0.0 {
            return None;
        }
        let as_good = |value: &f64| *value >= best * (1.0 - 1e-12);
        let (first, last) = (between.iter().position(as_good)?, between.iter().rposition(as_good)?);
        // `first` and `last` are the last dark bins; the threshold is half a bin above
        let threshold = ((first + last) as f64 / 2.0 + 0.5) / (BINS - 1) as f64;
        Some(Otsu { threshold, separability: best / self.variance() })
    }

    /// Separability by `threshold`; none when there is a single value.
    pub(super) fn separability(&self, threshold: f64) -> Option<f64> {
        let variance = self.variance();
        let dark = (threshold * (BINS - 1) as f64 - 0.5).ceil();
        let between = if dark < 0.0 { 0.0 } else { self.between().get(dark as usize).copied().unwrap_or(0.0) };
        (variance > 0.0).then(|| between / variance)
    }

    /// The quantile `share` of the values in `from..to`; none when there are no values in that range.
    pub(super) fn quantile(&self, from: f64, to: f64, share: f64) -> Option<f64> {
        let bin = |value: f64| ((value * (BINS - 1) as f64 + 0.5).max(0.0) as usize).min(BINS);
        let counts = self.counts.get(bin(from)..bin(to))?;
        let wanted = share * counts.iter().map(|&n| n as f64).sum::<f64>();
        let mut below = 0.0;
        let at = counts.iter().position(|&n| {
            below += n as f64;
            n > 0 && below >= wanted
        })?;
        Some((bin(from) + at) as f64 / (BINS - 1) as f64)
    }

    /// Between-class variance when the bins `0..=i` are one class.
    fn between(&self) -> Vec<f64> {
        let all: f64 = self.counts.iter().map(|&n| n as f64).sum();
        let total: f64 = self.counts.iter().enumerate().map(|(bin, &n)| bin as f64 * n as f64).sum();
        let (mut dark, mut dark_sum) = (0.0, 0.0);
        let parts = self.counts.iter().enumerate().map(|(bin, &n)| {
            dark += n as f64;
            dark_sum += bin as f64 * n as f64;
            let bright = all - dark;
            if dark == 0.0 || bright == 0.0 {
                return 0.0;
            }
            let distance = dark_sum / dark - (total - dark_sum) / bright;
            (dark / all) * (bright / all) * distance * distance
        });
        parts.collect()
    }

    fn variance(&self) -> f64 {
        let all: f64 = self.counts.iter().map(|&n| n as f64).sum();
        let mean = self.counts.iter().enumerate().map(|(bin, &n)| bin as f64 * n as f64).sum::<f64>() / all;
        let squares = self.counts.iter().enumerate().map(|(bin, &n)| (bin as f64 - mean).powi(2) * n as f64);
        squares.sum::<f64>() / all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pixels_of_all_parts_are_counted_once() {
        let values: Vec<f32> = (0..2 * PART + 777).map(|at| (at * 7919 % 1009) as f32 / 1008.0).collect();
        let counts = |at: usize| at % 3 != 1;
        let one_by_one = Histogram::of((0..).zip(&values).filter(|&(at, _)| counts(at)).map(|(_, &value)| value));
        assert_eq!(Histogram::of_pixels(&values, counts).counts, one_by_one.counts);
    }

    #[test]
    fn two_values_are_separated_in_the_middle_and_completely() {
        let otsu = Histogram::of([0.2f32; 30].into_iter().chain([0.8; 10])).otsu().unwrap();
        assert!((otsu.threshold - 0.5).abs() < 0.001, "{otsu:?}");
        assert!((otsu.separability - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_quantile_is_that_of_the_values_in_the_range() {
        let histogram = Histogram::of((0..=100).map(|i| i as f32 / 100.0));
        assert!((histogram.quantile(0.0, 0.5, 0.5).unwrap() - 0.25).abs() < 0.011);
        assert!((histogram.quantile(0.5, 2.0, 0.5).unwrap() - 0.75).abs() < 0.011);
        assert!((histogram.quantile(0.5, 2.0, 1.0).unwrap() - 1.0).abs() < 0.001);
        assert_eq!(Histogram::of([0.9f32; 5].into_iter()).quantile(0.0, 0.5, 0.5), None);
    }

    #[test]
    fn one_value_has_no_threshold() {
        assert_eq!(Histogram::of([0.3f32; 9].into_iter()).otsu(), None);
        assert_eq!(Histogram::of([].into_iter()).otsu(), None);
        assert_eq!(Histogram::of([0.3f32; 9].into_iter()).separability(0.5), None);
    }

    #[test]
    fn no_other_threshold_has_a_larger_separability() {
        let histogram = Histogram::of((0..2000).map(|i| {
            let t = (i * 7919 % 2000) as f32 / 2000.0;
            if i % 3 == 0 { 0.1 + 0.3 * t } else { 0.35 + 0.5 * t * t }
        }));
        let otsu = histogram.otsu().unwrap();
        for i in 0..=1000 {
            let other = histogram.separability(f64::from(i) / 1000.0).unwrap();
            assert!(other <= otsu.separability + 1e-12, "{i} is better");
        }
        let own = histogram.separability(otsu.threshold).unwrap();
        assert!((own - otsu.separability).abs() < 1e-12);
    }
}
