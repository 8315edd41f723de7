//! The gain of each slice from its own brightness: mean light and bright level.

use super::curve_fit::{Brightness, CurveFit};
use super::ln::{LEAST_SIGMA, Ln, MAX_SIGMA};
use super::tone::{self, TONES, tone};
use crate::calibration::dot_photometry::{self, DotBrightness};
use crate::calibration::{detected::Detection, statistics::median, tracked::Tracked};

/// Largest share of a dot's window that may be synthetic or at full scale when brightness is compared.
const MAX_INVALID: f64 = 0.02;
/// Relative standard deviation of the bright level at the radius of blur at which a disc begins to reach it: it grows
/// with the square of the radius, because blur of unknown shape may reach it earlier.
const SHAPE_DOUBT: f64 = 0.02;
/// The same for a core within a weak halo of several times its radius: the halo covers dots all around while the core
/// still looks small, so it grows with the eighth power.
const HALO_DOUBT: f64 = 0.2;
/// Least response that a relative standard deviation is taken of.
const LEAST_SLOPE: f64 = 0.1;
/// Deviation from the gain model, in standard deviations, from which a slice keeps its own gain.
pub(super) const OWN: f64 = 4.0;

/// The gain of a slice from its own brightness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OwnGain {
    /// `ln` of the factor.
    pub value: f64,
    /// Standard deviation of `value` for a camera whose response to light is known.
    noise: f64,
    /// Relative standard deviation of `value` from the response of the camera: the same error for all slices.
    response: f64,
}

impl OwnGain {
    /// The gain with its whole uncertainty.
    pub(super) fn ln(self) -> Ln {
        Ln { value: self.value, sigma: self.noise.hypot(self.response * self.value) }
    }

    /// The difference to the gain model, when it is significant. How uncertain the response is matters only as far as
    /// the model itself is away from 1: a slice with half of the light is off the model whatever the response.
    pub(super) fn off(self, model: Ln) -> Option<f64> {
        let off = self.value - model.value;
        let sigma = self.noise.hypot(self.response * model.value).hypot(model.sigma);
        (off.abs() > OWN * sigma).then_some(off)
    }

    /// The mean with an independent value that does not depend on the response, weighted by the uncertainties.
    fn merged(self, other: Ln) -> Self {
        let [a, b] = [self.ln().sigma, other.sigma].map(|sigma| sigma.max(LEAST_SIGMA).powi(-2));
        let [a, b] = [a / (a + b), b / (a + b)];
        let value = a * self.value + b * other.value;
        let noise = (a * self.noise).hypot(b * other.sigma);
        Self { value, noise, response: a * self.response }
    }
}

/// Gains from the brightness of each slice alone, as averages over the tone curves by their probability.
pub(super) fn own_gains(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Option<OwnGain>> {
    let Some(base) = tracked.detections[reference].as_ref() else { return vec![None; positions.len()] };
    let blurs = tracked.blurs();
    let reach = dot_photometry::bright_reach(tracked.fill(), tracked.target.polarity);
    let doubt = |blur: Option<f64>| {
        let part = blur.filter(|b| *b < reach)? / reach;
        Some((SHAPE_DOUBT * part.powi(2)).max(HALO_DOUBT * part.powi(8)))
    };
    let base_doubt = doubt(blurs[reference]);
    let all: Vec<Option<Brightness>> = tracked
        .detections
        .iter()
        .enumerate()
        .map(|(i, slice)| {
            let slice = slice.as_ref()?;
            let shape = doubt(blurs[i]).zip(base_doubt).map(|(a, b)| a.hypot(b));
            let bright = against(slice, base, |l| l.bright).zip(shape);
            Some(Brightness {
                means: std::array::from_fn(|k| against(slice, base, |l| tone::mean_light(l, tone(k)))),
                bright: bright.map(|(bright, shape)| Ln { sigma: bright.sigma.hypot(shape), ..bright }),
            })
        })
        .collect();
    let level = bright_level(base);
    let curves: Vec<Option<CurveFit>> =
        (0..TONES).map(|k| CurveFit::of(&all, k, reference, level, positions)).collect();
    // the scatter of the light about its model, under the curve that explains it best
    let scatter = curves.iter().flatten().filter_map(|c| c.scatter).fold(f64::INFINITY, f64::min);
    let costs: Vec<Option<f64>> = curves
        .iter()
        .enumerate()
        .map(|(k, curve)| curve.as_ref().map(|c| c.cost(scatter.max(5e-4)) + tone::prior_cost(tone(k))))
        .collect();
    let least = costs.iter().flatten().fold(f64::INFINITY, |m, c| m.min(*c));
    let weights: Vec<f64> = costs.iter().map(|c| c.map_or(0.0, |c| (-0.5 * (c - least)).exp())).collect();
    all.iter().enumerate().map(|(i, slice)| average(slice.as_ref()?, i, &curves, &weights)).collect()
}

/// The gain of one slice: the mean light, averaged over the tone curves, merged with the bright level.
fn average(slice: &Brightness, index: usize, curves: &[Option<CurveFit>], weights: &[f64]) -> Option<OwnGain> {
    let (mut sum, mut first, mut second, mut noise, mut response) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for ((curve, mean), weight) in curves.iter().zip(&slice.means).zip(weights) {
        let (Some(curve), Some(mean)) = (curve, mean) else { continue };
        let Some(by_curve) = curve.gains.get(index).copied().flatten() else { continue };
        let value = curve.slope * by_curve;
        sum += weight;
        first += weight * value;
        second += weight * value * value;
        noise += weight * mean.sigma * mean.sigma;
        response += weight * (curve.slope_sigma / curve.slope.abs().max(LEAST_SLOPE)).powi(2);
    }
    let by_mean = (sum > 0.0).then(|| {
        let value = first / sum;
        let noise = (noise / sum + (second / sum - value * value).max(0.0)).sqrt();
        OwnGain { value, noise, response: (response / sum).sqrt() }
    });
    match (by_mean, slice.bright) {
        (Some(mean), Some(bright)) => Some(mean.merged(bright)),
        (None, Some(bright)) => Some(OwnGain { value: bright.value, noise: bright.sigma, response: 0.0 }),
        (mean, None) => mean,
    }
}

/// Median bright level of a slice, 0..255; its mean where the bright level is not visible.
fn bright_level(slice: &Detection) -> f64 {
    let mut levels: Vec<f64> = slice.dots.values().filter_map(|d| d.light.bright).collect();
    if levels.is_empty() {
        levels = slice.dots.values().map(|d| d.light.mean).collect();
    }
    median(&mut levels).clamp(1.0, 255.0)
}

/// `ln` of the median over the shared dots of brightness in `base` over brightness in `slice`. Uses dots with valid
/// windows in both slices when there are enough of them.
fn against(slice: &Detection, base: &Detection, measure: impl Fn(&DotBrightness) -> Option<f64>) -> Option<Ln> {
    let ratio = |max_invalid: f64| {
        let shared = slice.dots.iter().filter_map(|(label, d)| base.dots.get(label).map(|b| (d, b)));
        let clean = shared.filter(|(d, b)| d.invalid.max(b.invalid) < max_invalid);
        dot_photometry::ratio(clean.map(|(d, b)| (measure(&d.light), measure(&b.light))))
    };
    let clean = ratio(MAX_INVALID);
    // synthetic and full-scale samples carry no information about brightness
    let extra = if clean.is_some() { 0.0 } else { 2.0 * MAX_SIGMA };
    let (value, sigma) = clean.or_else(|| ratio(10.0 * MAX_INVALID)).or_else(|| ratio(f64::INFINITY))?;
    (value > 0.0).then(|| Ln { value: value.ln(), sigma: sigma.hypot(extra) })
}
