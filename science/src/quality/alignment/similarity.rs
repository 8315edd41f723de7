//! The similarity (shift, scale, rotation) that all steps from slice to slice have in common, with its uncertainty.
//!
//! About the centre of the windows a shift is `dx = a x - b y + tx`, `dy = b x + a y + ty`. The fit is least squares
//! over all windows of all pairs; windows more than three standard deviations off are removed, four times.

use super::Shift;
use crate::imaging::statistics;

/// Least number of shifts for a fit.
const LEAST: usize = 4;
/// Shifts that differ from the fit by more than this many standard deviations are outliers.
const OUTLIER: f64 = 3.0;
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
    /// The best fit without outliers; none if the shifts are too few or all at one position.
    pub(super) fn robust(shifts: &[Shift]) -> Option<Self> {
        let mut kept: Vec<Shift> = shifts.to_vec();
        let mut fit = Self::fit(&kept)?;
        for _ in 0..4 {
            let mut residuals: Vec<f32> = shifts.iter().map(|shift| fit.residual(shift) as f32).collect();
            // the median length of a two-dimensional normal deviation is 1.18 sigma
            let sigma = f64::from(statistics::quantile_interpolated(&mut residuals, 0.5)?) / 1.18;
            let limit = (OUTLIER * sigma).max(OUTLIER * LEAST_SIGMA);
            kept = shifts.iter().filter(|shift| fit.residual(shift) <= limit).copied().collect();
            fit = Self::fit(&kept)?;
        }
        Some(fit)
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
