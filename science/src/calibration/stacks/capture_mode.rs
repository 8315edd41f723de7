//! What the slices show of what moved, beside their sizes: brightness and parallax.
//!
//! Let `b` be 0 with a fixed lens, 1 with a moving lens, and between them with a lens that moves alone.
//!
//! | evidence | expected | what disturbs it |
//! |---|---|---|
//! | slope of `ln gain` over `ln size` | `2 (1 - b)`: light falls with the square of the sensor's distance | equal exposures (then 0), lamps that drift |
//! | parallax, in squares of the growth | `b` (`perspective`) | blurred outlines, which grow too: [`OUTLINES`] |
//!
//! Equal brightness alone tells nothing, as cameras and raw converters make it. So a moving lens is found only where
//! the image grows by about a hundredth per slice or more.

use super::refine::growth;
use crate::calibration::transform_models::Parameters;

/// Standard deviation of the parallax that blurred outlines pretend, units per squared slice. `cargo bench --bench
/// calibration_stacks` counts the modes that are found with it.
const OUTLINES: f64 = 2.5e-5;
/// The same of the slope of the brightness.
const SLOPE: f64 = 0.1;
/// Shares of stacks whose brightness follows the lens, whose exposures were made equal, and of others.
const BRIGHTNESS: [f64; 3] = [0.7, 0.15, 0.15];
/// Range of the slopes of others.
const OTHER_SLOPES: f64 = 4.0;
/// Density of a parallax that follows nothing.
const OTHER_PARALLAX: f64 = 0.01;
/// Range of `b` of a lens that moves alone.
const ALONE: [f64; 2] = [0.1, 0.9];

/// What the slices show, each with its standard deviation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    /// Parallax in squares of the growth.
    pub parallax: Option<[f64; 2]>,
    /// Slope of the brightness.
    pub slope: Option<[f64; 2]>,
}

impl Shown {
    /// Of transforms reference slice -> slice at `offsets` from it on the rail, the gains that were measured, and the
    /// parallax of the fit.
    pub(super) fn of(transforms: &[Parameters], offsets: &[f64], gains: &[f64], parallax: Option<[f64; 2]>) -> Self {
        let growth = growth(transforms, offsets).powi(2).max(1e-30);
        let steps = offsets.len().saturating_sub(1).max(1) as f64;
        let span = offsets.first().zip(offsets.last()).map_or(0.0, |(first, last)| last - first);
        let outlines = OUTLINES * (steps / span).powi(2);
        let parallax = parallax.map(|[p, sigma]| [-p / growth, sigma.hypot(outlines) / growth]);
        Self { parallax, slope: slope(transforms, gains) }
    }

    /// Likelihoods of a fixed lens, a moving lens, and a lens that moves alone; `None` where the slices show nothing.
    pub(super) fn likelihoods(&self) -> Option<[f64; 3]> {
        if self.slope.is_none() && self.parallax.is_none() {
            return None;
        }
        const STEPS: usize = 64;
        let of_alone = |k: usize| self.likelihood(ALONE[0] + (ALONE[1] - ALONE[0]) * (k as f64 + 0.5) / STEPS as f64);
        Some([self.likelihood(0.0), self.likelihood(1.0), (0..STEPS).map(of_alone).sum::<f64>() / STEPS as f64])
    }

    fn likelihood(&self, b: f64) -> f64 {
        let by_parallax = self.parallax.map_or(1.0, |[share, sigma]| normal(share - b, sigma) + OTHER_PARALLAX);
        let by_brightness = self.slope.map_or(1.0, |[slope, sigma]| {
            let [follows, equal, other] = BRIGHTNESS;
            follows * normal(slope - 2.0 * (1.0 - b), sigma) + equal * normal(slope, sigma) + other / OTHER_SLOPES
        });
        by_parallax * by_brightness
    }
}

fn normal(off: f64, sigma: f64) -> f64 {
    (-0.5 * (off / sigma).powi(2)).exp() / sigma
}

/// Slope of the brightness over the size, through the reference slice.
fn slope(transforms: &[Parameters], gains: &[f64]) -> Option<[f64; 2]> {
    let samples = || transforms.iter().zip(gains).map(|(p, gain)| (p[0].ln_1p(), gain.ln()));
    let (square, product) = samples().fold((0.0, 0.0), |(square, product), (x, y)| (square + x * x, product + x * y));
    let slope = product / square;
    let rest: f64 = samples().map(|(x, y)| (y - slope * x).powi(2)).sum();
    let sigma = (rest / square / (gains.len() as f64 - 2.0).max(1.0)).sqrt().hypot(SLOPE);
    (slope.is_finite() && sigma < 1.0).then_some([slope, sigma])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn likelihoods(slope: f64, parallax: Option<[f64; 2]>) -> [f64; 3] {
        let found = Shown { parallax, slope: Some([slope, SLOPE]) }.likelihoods().expect("evidence");
        let sum: f64 = found.iter().sum();
        found.map(|v| v / sum)
    }

    #[test]
    fn brightness_tells_a_fixed_lens_and_a_moving_lens_needs_the_parallax_too() {
        assert!(likelihoods(2.0, None)[0] > 0.95);
        assert!(likelihoods(2.0, Some([0.8, 1.0]))[0] > 0.95, "an uncertain parallax");
        let equal = likelihoods(0.0, None);
        assert!(equal[1] < 0.9 && equal[0] > 0.1, "{equal:?}");
        assert!(likelihoods(0.0, Some([0.9, 0.25]))[1] > 0.9);
        assert!(likelihoods(0.0, Some([0.05, 0.2]))[0] > 0.7, "exposures that were made equal");
        assert!(likelihoods(1.0, Some([0.5, 0.2]))[2] > 0.5, "between them");
        let torn = likelihoods(2.0, Some([1.0, 0.1]));
        assert!(torn.iter().all(|p| *p < 0.95), "a contradiction: {torn:?}");
    }
}
