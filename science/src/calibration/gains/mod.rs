//! Gains: the factor per slice that makes it as bright as the reference slice.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | mean light | `tone` | mean over whole grid steps, which blur of any shape does not change, for each tone curve |
//! | tone curve | this one | the curves for which the mean light is smooth over the rail and follows the bright level |
//! | own gain | this one | mean light and bright level, weighted by their uncertainties, averaged over the curves |
//! | law | `law` | a slice that agrees with the smooth law takes the law's gain, so gains do not flicker |
//!
//! No estimator is switched on or off at a limit: each has an uncertainty that grows smoothly with blur.

mod law;
mod tone;

use law::{Point, SmoothLaw};
use tone::{TONES, tone};

use super::blur;
use super::detection::Detection;
use super::dot_photometry::{self, DotLight};
use super::statistics::median;
use super::tracking::Tracked;

/// Blur radius of each slice in grid steps, relative to the slice with the strongest pattern; `None` where no grid was
/// found.
pub(super) fn blurs(tracked: &Tracked) -> Vec<Option<f64>> {
    let strongest = tracked.detections.iter().flatten().map(|s| s.modulation).fold(1e-9, f64::max);
    tracked.detections.iter().map(|s| s.as_ref().map(|s| blur::radius((s.modulation / strongest).min(1.0)))).collect()
}

/// Dot diameter over the pitch, from the sharpest slice.
pub(super) fn fill(tracked: &Tracked) -> f64 {
    let sharpest = tracked.detections.iter().flatten().max_by(|a, b| a.modulation.total_cmp(&b.modulation));
    sharpest.map_or(0.5, |s| s.fill.clamp(0.2, 0.8))
}

/// A gain with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gain {
    /// The factor.
    pub value: f64,
    /// Relative standard deviation.
    pub sigma: f64,
    /// The factor by the smooth law of the other slices; `None` without a law.
    pub by_law: Option<f64>,
    /// Brightness of the slice over what the law expects, when the difference is significant.
    pub off_law: Option<f64>,
}

/// Largest relative standard deviation of a gain that counts as measured.
pub(super) const MAX_SIGMA: f64 = 0.005;
/// Largest share of a dot's window that may be synthetic or at full scale when brightness is compared.
const MAX_INVALID: f64 = 0.02;
/// Least relative standard deviation of a gain.
const LEAST_SIGMA: f64 = 2e-4;
/// Standard deviation of the response of values to light at the bright level, relative to that of the tone curve.
const SLOPE_DOUBT: f64 = 0.4;
/// Standard deviation expected of the curvature of ln(light) over the stack beyond the inverse-square law.
const LIGHT_CURVATURE: f64 = 0.005;
/// The same for the gains.
const GAIN_CURVATURE: f64 = 0.02;
/// Relative standard deviation of the bright level where blur of unknown shape reaches it.
const SHAPE_DOUBT: f64 = 0.02;
/// Deviation from the law, in standard deviations, from which a slice keeps its own gain.
const OWN: f64 = 4.0;

/// One gain per slice; 1 for the reference.
pub(super) fn of(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Gain> {
    let own = own_gains(tracked, reference, positions);
    let points: Vec<Point> = own
        .iter()
        .zip(positions)
        .filter_map(|(own, &z)| own.filter(|o| o.sigma < 0.05).map(|o| Point { z, value: o.value, sigma: o.sigma }))
        .collect();
    let law = SmoothLaw::fit(&points, GAIN_CURVATURE, None);
    let settle = |(index, own): (usize, &Option<Ln>)| {
        let z = positions[index];
        let by_law = law.as_ref().map(|l| Ln { value: l.at(z), sigma: l.sigma_at(z).max(LEAST_SIGMA) });
        let away = own.zip(by_law).map(|(own, law)| (own.value - law.value, own.sigma.hypot(law.sigma)));
        let off = away.filter(|(off, sigma)| off.abs() > OWN * sigma).map(|(off, _)| off);
        let settled = match (own, by_law) {
            _ if index == reference => Ln { value: 0.0, sigma: 0.0 },
            (Some(own), Some(law)) if off.is_none() => own.merged(law),
            (Some(own), _) => *own,
            (None, Some(law)) => law,
            // a stack of so few slices has no law
            (None, None) => Ln { value: mean_value(&points), sigma: f64::INFINITY },
        };
        Gain {
            value: settled.value.exp().clamp(0.05, 20.0),
            sigma: settled.sigma,
            by_law: by_law.map(|l| l.value.exp()),
            off_law: off.map(|off| (-off).exp()),
        }
    };
    own.iter().enumerate().map(settle).collect()
}

/// Per slice how much red over green and blue over green (`ln`) differ from the smooth law of all slices, where that is
/// significant.
pub(super) fn off_tint(tints: &[Option<[f64; 2]>], positions: &[f64]) -> Vec<Option<[f64; 2]>> {
    let law = |k: usize| {
        let points = tints.iter().zip(positions).filter_map(|(t, &z)| t.map(|t| Point { z, value: t[k], sigma: 1e-3 }));
        SmoothLaw::fit(&points.collect::<Vec<_>>(), GAIN_CURVATURE, None)
    };
    let (Some(red), Some(blue)) = (law(0), law(1)) else { return vec![None; tints.len()] };
    let off = |(tint, &z): (&Option<[f64; 2]>, &f64)| {
        let [a, b] = (*tint)?;
        let off = [a - red.at(z), b - blue.at(z)];
        let beyond = |off: f64, law: &SmoothLaw| off.abs() > OWN * law.sigma_at(z).hypot(1e-3);
        (beyond(off[0], &red) || beyond(off[1], &blue)).then_some(off)
    };
    tints.iter().zip(positions).map(off).collect()
}

fn mean_value(points: &[Point]) -> f64 {
    points.iter().map(|p| p.value).sum::<f64>() / points.len().max(1) as f64
}

/// The natural logarithm of a factor, with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ln {
    value: f64,
    sigma: f64,
}

impl Ln {
    /// The mean of two independent values, weighted by their uncertainties.
    fn merged(self, other: Self) -> Self {
        let [a, b] = [self, other].map(|l| l.sigma.max(LEAST_SIGMA).powi(-2));
        Self { value: (a * self.value + b * other.value) / (a + b), sigma: (a + b).recip().sqrt() }
    }
}

/// What was measured of one slice, relative to the reference slice.
struct Brightness {
    /// `ln` of the factor on light per tone curve; `None` where it was not measured.
    means: [Option<Ln>; TONES],
    /// `ln` of the factor on values, from the bright level; `None` where it is not visible.
    bright: Option<Ln>,
}

/// Gains from the brightness of each slice alone, as averages over the tone curves by their probability.
fn own_gains(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Option<Ln>> {
    let Some(base) = tracked.detections[reference].as_ref() else { return vec![None; positions.len()] };
    let blurs = blurs(tracked);
    let reach = dot_photometry::bright_reach(fill(tracked), tracked.target.polarity);
    let doubt = |blur: Option<f64>| blur.filter(|b| *b < reach).map(|b| SHAPE_DOUBT * (b / reach).powi(2));
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
    // the scatter of the light about its law, under the curve that explains it best
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

/// The gain of one slice: per tone curve the mean light merged with the bright level, averaged over the curves.
fn average(slice: &Brightness, index: usize, curves: &[Option<CurveFit>], weights: &[f64]) -> Option<Ln> {
    let (mut sum, mut first, mut second, mut noise) = (0.0, 0.0, 0.0, 0.0);
    let mut fits = Vec::new();
    for (k, curve) in curves.iter().enumerate() {
        let (Some(curve), Some(mean)) = (curve, slice.means[k]) else { continue };
        let Some(by_curve) = curve.gains.get(index).copied().flatten() else { continue };
        let own = Ln { value: curve.slope * by_curve, sigma: mean.sigma.hypot(curve.slope_sigma * by_curve.abs()) };
        fits.push((weights[k], own));
    }
    for (weight, own) in &fits {
        sum += weight;
        first += weight * own.value;
        second += weight * own.value * own.value;
        noise += weight * own.sigma * own.sigma;
    }
    let by_mean = (sum > 0.0).then(|| {
        let value = first / sum;
        Ln { value, sigma: (noise / sum + (second / sum - value * value).max(0.0)).sqrt() }
    });
    match (by_mean, slice.bright) {
        (Some(mean), Some(bright)) => Some(mean.merged(bright)),
        (mean, bright) => mean.or(bright),
    }
}

/// How one tone curve explains the stack.
struct CurveFit {
    /// Points of the square root of the light over the rail, which is straight for a fixed lens.
    points: Vec<Point>,
    /// Scatter about the smooth law; `None` with too few slices for one.
    scatter: Option<f64>,
    /// Sum of squared deviations between mean light and bright level, in standard deviations.
    off_bright: f64,
    /// Response of the values at the bright level, relative to the curve's own.
    slope: f64,
    slope_sigma: f64,
    /// `ln` of the factor on values per slice.
    gains: Vec<Option<f64>>,
}

/// Least number of slices whose brightness over the rail says something about the tone curve.
const LAW_SLICES: usize = 5;

impl CurveFit {
    fn of(all: &[Option<Brightness>], k: usize, reference: usize, level: f64, positions: &[f64]) -> Option<Self> {
        let mean = |i: usize| all[i].as_ref().and_then(|b| b.means[k]);
        mean(reference)?;
        let gains: Vec<Option<f64>> =
            (0..all.len()).map(|i| mean(i).and_then(|m| tone::value_gain(m.value, level, tone(k)))).collect();
        let points: Vec<Point> = (0..all.len())
            // the same slices for all curves, so that their costs can be compared
            .filter(|&i| all[i].as_ref().is_some_and(|b| b.means.iter().all(Option::is_some)))
            .filter_map(|i| {
                let mean = mean(i)?;
                let root = (0.5 * mean.value).exp();
                Some(Point { z: positions[i], value: root, sigma: 0.5 * root * mean.sigma })
            })
            .collect();
        let scatter = (points.len() >= LAW_SLICES)
            .then(|| SmoothLaw::fit(&points, 0.5 * LIGHT_CURVATURE, None))
            .flatten()
            .map(|law| law.scatter);
        // bright = slope * gain + offset; the offset is an error of the reference slice's bright level
        let pairs = (0..all.len()).filter(|&i| i != reference).filter_map(|i| {
            let bright = all[i].as_ref()?.bright?;
            Some((gains[i]?, bright.value, bright.sigma.hypot(mean(i)?.sigma).max(3e-4)))
        });
        let (mut xx, mut xy, mut yy) = (SLOPE_DOUBT.powi(-2), SLOPE_DOUBT.powi(-2), SLOPE_DOUBT.powi(-2));
        for (x, y, sigma) in pairs {
            let weight = sigma.powi(-2);
            xx += weight * x * x;
            xy += weight * x * y;
            yy += weight * y * y;
        }
        let slope = xy / xx;
        Some(Self {
            points,
            scatter,
            off_bright: (yy - slope * xy).max(0.0),
            slope,
            slope_sigma: xx.recip().sqrt(),
            gains,
        })
    }

    /// Twice the negative log-likelihood for light that scatters by `scatter` about a smooth law.
    fn cost(&self, scatter: f64) -> f64 {
        let law = (self.points.len() >= LAW_SLICES)
            .then(|| SmoothLaw::fit(&self.points, 0.5 * LIGHT_CURVATURE, Some(scatter)))
            .flatten();
        law.map_or(0.0, |law| law.cost) + self.off_bright
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
fn against(slice: &Detection, base: &Detection, measure: impl Fn(&DotLight) -> Option<f64>) -> Option<Ln> {
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
