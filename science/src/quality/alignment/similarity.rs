//! The similarity (shift, scale, rotation) that all steps from slice to slice have in common, with its uncertainty.
//!
//! About the centre of the windows a shift is `dx = a x - b y + tx`, `dy = b x + a y + ty`. The fit is least squares
//! over all windows of all pairs; windows more than three standard deviations off are removed, four times.
//!
//! Where the image jumps between two slices, all windows of that pair are off, and a pair that shows much of the object
//! in focus has as many windows as several others. So the fit starts from the median over all pairs, which needs those
//! without windows in focus too, and in the standard deviation a pair counts once, however many windows it has.

use super::shift::{LEAST_SHIFTS, Shift};
use crate::imaging::statistics;

/// Least number of shifts for a fit.
const LEAST: usize = 4;
/// Shifts that differ from the fit by more than this many standard deviations are outliers.
const OUTLIER: f64 = 3.0;
/// The standard deviation is estimated from this share of the shifts, those closest to the fit: in a stack of five
/// slices one displaced slice spoils half of the pairs.
const SETTLED: f64 = 0.4;
/// No shift is more exact than this standard deviation, px: blur of other parts and curved parts move windows.
const LEAST_SIGMA: f64 = 0.05;
/// Variance factor: one window is compared in several pairs of slices and its error repeats, so there are fewer
/// independent shifts than shifts.
const REPEATED: f64 = 2.0;

/// `dx = a x - b y + tx`, `dy = b x + a y + ty` about `centre`, with standard deviations from the scatter of the
/// shifts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Similarity {
    centre: (f64, f64),
    pub(super) a: f64,
    pub(super) b: f64,
    shift: (f64, f64),
    /// Standard deviations of `a` and `b`, and of each component of the shift.
    turn_sigma: f64,
    shift_sigma: f64,
}

impl Similarity {
    /// The best fit to the shifts of all `pairs`, without outliers; none if the shifts are too few or all at one
    /// position. `rough` are the same pairs, with less exact shifts where there are too few: they only tell what is an
    /// outlier.
    pub(super) fn robust(pairs: &[Vec<Shift>], rough: &[Vec<Shift>]) -> Option<Self> {
        Some(Self::start(pairs, rough)?.without_outliers(pairs, rough))
    }

    /// Scale and rotation from the differences within each pair, the shift from the median over the pairs.
    fn start(pairs: &[Vec<Shift>], rough: &[Vec<Shift>]) -> Option<Self> {
        let whole = Self::fit(&pairs.iter().flatten().copied().collect::<Vec<_>>())?;
        let within: Vec<Vec<Shift>> = pairs.iter().map(|pair| about_its_middle(pair)).collect();
        let Some(turn) = Self::fit(&within.concat()) else { return Some(whole) };
        let Self { a, b, .. } = turn.without_outliers(&within, &within);
        let turned = Self { a, b, shift: (0.0, 0.0), ..whole };
        let of_pair = |pair: &Vec<Shift>| own_shift(pair, Some(&turned), 1).map(|(shift, _)| shift);
        let (mut xs, mut ys): (Vec<f64>, Vec<f64>) = rough.iter().filter_map(of_pair).unzip();
        let shift = (statistics::median_midpoint(&mut xs)?, statistics::median_midpoint(&mut ys)?);
        Some(Self { shift, ..turned })
    }

    /// This fit, improved: fitted again to the shifts of `pairs` that it explains, four times. What is an outlier
    /// follows from `rough`.
    fn without_outliers(self, pairs: &[Vec<Shift>], rough: &[Vec<Shift>]) -> Self {
        let mut fit = self;
        for _ in 0..4 {
            let of_pair = |pair: &Vec<Shift>| {
                let weight = 1.0 / pair.len().max(LEAST_SHIFTS) as f64;
                pair.iter().map(|shift| (fit.residual(shift), weight)).collect::<Vec<_>>()
            };
            let Some(length) = weighted_quantile(rough.iter().flat_map(of_pair).collect(), SETTLED) else { break };
            // the quantile of the length of a two-dimensional normal deviation
            let sigma = length / (-2.0 * (1.0 - SETTLED).ln()).sqrt();
            let limit = OUTLIER * sigma.max(LEAST_SIGMA);
            let kept: Vec<Shift> =
                pairs.iter().flatten().filter(|shift| fit.residual(shift) <= limit).copied().collect();
            let Some(better) = Self::fit(&kept) else { break };
            fit = better;
        }
        fit
    }

    /// Scale per step.
    pub(super) fn scale(&self) -> f64 {
        (1.0 + self.a).hypot(self.b)
    }

    /// Rotation per step, degrees, from x to y.
    pub(super) fn rotation_deg(&self) -> f64 {
        self.b.atan2(1.0 + self.a).to_degrees()
    }

    /// Displacement at (x, y), px.
    pub(super) fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let (x, y) = (x - self.centre.0, y - self.centre.1);
        (self.a * x - self.b * y + self.shift.0, self.b * x + self.a * y + self.shift.1)
    }

    /// Standard deviation of each component of the displacement at (x, y), px.
    pub(super) fn sigma_at(&self, (x, y): (f64, f64)) -> f64 {
        let distance = (x - self.centre.0).hypot(y - self.centre.1);
        self.shift_sigma.hypot(distance * self.turn_sigma)
    }

    fn fit(shifts: &[Shift]) -> Option<Self> {
        if shifts.len() < LEAST {
            return None;
        }
        let count = shifts.len() as f64;
        let mean = |value: fn(&Shift) -> f64| shifts.iter().map(value).sum::<f64>() / count;
        let centre = (mean(|s| s.x), mean(|s| s.y));
        let shift = (mean(|s| s.dx), mean(|s| s.dy));
        let (mut spread, mut along, mut across) = (0.0, 0.0, 0.0);
        for s in shifts {
            let (x, y) = (s.x - centre.0, s.y - centre.1);
            spread += x * x + y * y;
            along += x * s.dx + y * s.dy;
            across += x * s.dy - y * s.dx;
        }
        if spread <= count {
            return None;
        }
        let mut fit = Self { centre, a: along / spread, b: across / spread, shift, turn_sigma: 0.0, shift_sigma: 0.0 };
        let squares: f64 = shifts.iter().map(|shift| fit.residual(shift).powi(2)).sum();
        let sigma = (squares / (2.0 * count - 4.0)).sqrt().max(LEAST_SIGMA) * REPEATED.sqrt();
        (fit.turn_sigma, fit.shift_sigma) = (sigma / spread.sqrt(), sigma / count.sqrt());
        Some(fit)
    }

    fn residual(&self, s: &Shift) -> f64 {
        let (dx, dy) = self.at((s.x, s.y));
        (s.dx - dx).hypot(s.dy - dy)
    }
}

/// The shifts of one pair about their mean position and their median shift.
fn about_its_middle(pair: &[Shift]) -> Vec<Shift> {
    let mean = |value: fn(&Shift) -> f64| pair.iter().map(value).sum::<f64>() / pair.len().max(1) as f64;
    let median = |value: fn(&Shift) -> f64| {
        statistics::median_midpoint(&mut pair.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0)
    };
    let (x, y, dx, dy) = (mean(|s| s.x), mean(|s| s.y), median(|s| s.dx), median(|s| s.dy));
    pair.iter().map(|s| Shift { x: s.x - x, y: s.y - y, dx: s.dx - dx, dy: s.dy - dy }).collect()
}

/// Quantile `q` of pairs (value, weight): the smallest value up to which at least the share `q` of the weight lies.
/// None for an empty list.
fn weighted_quantile(mut values: Vec<(f64, f64)>, q: f64) -> Option<f64> {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let least = q * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let at = values.iter().position(|(_, weight)| {
        sum += weight;
        sum >= least
    });
    at.map(|at| values[at].0)
}

/// Median shift of the windows of one pair beyond the `common` similarity, px, with its standard deviation; none with
/// fewer than `least` shifts.
pub(super) fn own_shift(shifts: &[Shift], common: Option<&Similarity>, least: usize) -> Option<((f64, f64), f64)> {
    if shifts.len() < least {
        return None;
    }
    let rest = |shift: &Shift| {
        let (dx, dy) = common.map_or((0.0, 0.0), |common| common.at((shift.x, shift.y)));
        ((shift.dx - dx) as f32, (shift.dy - dy) as f32)
    };
    let (mut xs, mut ys): (Vec<f32>, Vec<f32>) = shifts.iter().map(rest).unzip();
    let (x, y) = (statistics::quantile_interpolated(&mut xs, 0.5)?, statistics::quantile_interpolated(&mut ys, 0.5)?);
    let mut away: Vec<f32> = shifts.iter().map(rest).map(|(dx, dy)| (dx - x).hypot(dy - y)).collect();
    let sigma = (f64::from(statistics::quantile_interpolated(&mut away, 0.5)?) / 1.18).max(LEAST_SIGMA);
    Some(((f64::from(x), f64::from(y)), 1.25 * sigma / (shifts.len() as f64).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `count` windows of pair `n`, moved by a common scale and shift, by a little scatter, and by `jump`.
    fn pair(n: usize, count: usize, jump: (f64, f64)) -> Vec<Shift> {
        let window = |k: usize| {
            let (x, y) = ((97 * (k + 3 * n) % 500) as f64, (61 * (k + n) % 300) as f64);
            let scatter = 0.05 * ((k * 7 + n * 3) % 5) as f64 - 0.1;
            Shift { x, y, dx: 0.001 * (x - 250.0) + 0.2 + jump.0 + scatter, dy: 0.001 * (y - 150.0) + jump.1 }
        };
        (0..count).map(window).collect()
    }

    #[test]
    fn a_jump_in_the_pair_with_most_windows_is_not_the_common_shift() {
        let pairs: Vec<Vec<Shift>> = [3, 0, 4, 25, 3, 4]
            .into_iter()
            .enumerate()
            .map(|(n, count)| pair(n, count, if count == 25 { (4.0, -3.0) } else { (0.0, 0.0) }))
            .collect();
        let fit = Similarity::robust(&pairs, &pairs).unwrap();
        let (dx, dy) = fit.at((250.0, 150.0));
        assert!((dx - 0.2).abs() < 0.05 && dy.abs() < 0.05 && (fit.a - 0.001).abs() < 1e-4, "{fit:?} {dx} {dy}");
        let (own, _) = own_shift(&pairs[3], Some(&fit), LEAST_SHIFTS).unwrap();
        assert!((own.0 - 4.0).abs() < 0.1 && (own.1 + 3.0).abs() < 0.1, "{own:?}");
    }

    #[test]
    fn one_displaced_slice_of_five_is_not_the_common_shift() {
        let pairs = [pair(0, 3, (0.0, 0.0)), pair(1, 4, (0.0, 0.0)), pair(2, 12, (4.0, -3.0)), pair(3, 5, (-4.0, 3.0))];
        let fit = Similarity::robust(&pairs, &pairs).unwrap();
        let (dx, dy) = fit.at((250.0, 150.0));
        assert!((dx - 0.2).abs() < 0.1 && dy.abs() < 0.1, "{fit:?} {dx} {dy}");
    }

    #[test]
    fn a_jump_in_the_only_pair_in_focus_is_told_by_the_other_pairs() {
        let jump = (4.0, -3.0);
        let pairs = [Vec::new(), pair(1, 20, jump), Vec::new(), Vec::new()];
        let rough = [pair(0, 5, (0.0, 0.0)), pair(1, 20, jump), pair(2, 5, (0.1, 0.0)), pair(3, 5, (0.0, 0.1))];
        let fit = Similarity::robust(&pairs, &rough).unwrap();
        let (own, _) = own_shift(&pairs[1], Some(&fit), LEAST_SHIFTS).unwrap();
        assert!((own.0 - 4.0).abs() < 0.2 && (own.1 + 3.0).abs() < 0.2, "{own:?}");
    }

    #[test]
    fn a_weighted_quantile_has_its_share_of_the_weight_up_to_it() {
        assert_eq!(weighted_quantile(vec![(3.0, 1.0), (1.0, 1.0), (2.0, 1.0)], 0.5), Some(2.0));
        assert_eq!(weighted_quantile(vec![(1.0, 0.1), (2.0, 0.1), (9.0, 1.0)], 0.5), Some(9.0));
        assert_eq!(weighted_quantile(Vec::new(), 0.5), None);
    }
}
