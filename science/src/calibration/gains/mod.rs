//! Gains: the factor per slice that makes it as bright as the reference slice.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | mean light | `tone` | mean over whole grid steps, which blur of any shape does not change, for each tone curve |
//! | tone curve | `curve_fit` | the curves for which the mean light is smooth over the rail and follows the bright level |
//! | own gain | `own_gain` | mean light and bright level, weighted by their uncertainties, averaged over the curves |
//! | law | `law` | in a slice that agrees with the smooth law, the weighted mean of both, so gains do not flicker |
//!
//! No estimator is switched on or off at a limit: each has an uncertainty that grows smoothly with blur. The bright
//! level ends where its uncertainty leaves it almost no weight.

mod curve_fit;
mod law;
mod ln;
mod own_gain;
mod tone;

use law::{Point, SmoothLaw};
use ln::{LEAST_SIGMA, Ln};
use own_gain::{OwnGain, own_gains};

use super::blur;
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
    /// The factor by the smooth law of all slices; `None` without a law.
    pub by_law: Option<f64>,
    /// Brightness of the slice over what the law expects, when the difference is significant.
    pub off_law: Option<f64>,
}

/// Largest relative standard deviation of a gain that counts as measured.
pub(super) const MAX_SIGMA: f64 = 0.005;
/// Standard deviation expected of the curvature of the gains over the stack beyond the inverse-square law.
const GAIN_CURVATURE: f64 = 0.02;
/// Deviation from the law, in standard deviations, from which a slice keeps its own gain.
const OWN: f64 = 4.0;

/// One gain per slice; 1 for the reference.
pub(super) fn of(tracked: &Tracked, reference: usize, positions: &[f64]) -> Vec<Gain> {
    let own = own_gains(tracked, reference, positions);
    let points: Vec<Point> = own
        .iter()
        .zip(positions)
        .filter_map(|(own, &z)| {
            own.map(|o| Point { z, value: o.value, sigma: o.ln().sigma }).filter(|p| p.sigma < 0.05)
        })
        .collect();
    let law = SmoothLaw::fit(&points, GAIN_CURVATURE, None);
    let settle = |(index, own): (usize, &Option<OwnGain>)| {
        let z = positions[index];
        let by_law = law.as_ref().map(|l| Ln { value: l.at(z), sigma: l.sigma_at(z).max(LEAST_SIGMA) });
        let off = own.zip(by_law).and_then(|(own, law)| own.off(law));
        let settled = match (own, by_law) {
            _ if index == reference => Ln { value: 0.0, sigma: 0.0 },
            (Some(own), Some(law)) if off.is_none() => own.ln().merged(law),
            (Some(own), _) => own.ln(),
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
