//! Gains: the factor per slice that makes it as bright as the reference slice.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | mean light | `tone` | mean over whole grid steps, which blur of any shape does not change, for each tone curve |
//! | tone curve | `curve_fit` | the curves for which the mean light is smooth over the rail and follows the bright level |
//! | own gain | `own_gain` | mean light and bright level, weighted by their uncertainties, averaged over the curves |
//! | gain model | `gain_model` | in a slice that agrees with the model, the mean of both, so gains do not flicker |
//!
//! No estimator is switched on or off at a limit: each has an uncertainty that grows smoothly with blur. The bright
//! level ends where its uncertainty leaves it almost no weight.

mod curve_fit;
mod gain_model;
mod ln;
mod own_gain;
mod tone;

use gain_model::{GainModel, Point};
pub(super) use ln::MAX_SIGMA;
use ln::{LEAST_SIGMA, Ln};
use own_gain::{OWN, OwnGain, own_gains};

use super::tracked::Tracked;

/// A gain with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gain {
    /// The factor.
    pub value: f64,
    /// Relative standard deviation.
    pub sigma: f64,
    /// The factor by the gain model of all slices; `None` without one.
    pub by_model: Option<f64>,
    /// Brightness of the slice over what the model expects, when the difference is significant.
    pub off_model: Option<f64>,
}

/// Standard deviation expected of the curvature of the gains over the stack beyond the inverse-square law.
const GAIN_CURVATURE: f64 = 0.02;

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
    let model = GainModel::fit(&points, GAIN_CURVATURE, None);
    let gain = |(index, own): (usize, &Option<OwnGain>)| {
        let z = positions[index];
        let by_model = model.as_ref().map(|m| Ln { value: m.at(z), sigma: m.sigma_at(z).max(LEAST_SIGMA) });
        let off = own.zip(by_model).and_then(|(own, by_model)| own.off(by_model));
        let combined = match (own, by_model) {
            _ if index == reference => Ln { value: 0.0, sigma: 0.0 },
            (Some(own), Some(by_model)) if off.is_none() => own.ln().merged(by_model),
            (Some(own), _) => own.ln(),
            (None, Some(by_model)) => by_model,
            // a stack of so few slices has no model
            (None, None) => Ln { value: mean_value(&points), sigma: f64::INFINITY },
        };
        Gain {
            value: combined.value.exp().clamp(0.05, 20.0),
            sigma: combined.sigma,
            by_model: by_model.map(|m| m.value.exp()),
            off_model: off.map(|off| (-off).exp()),
        }
    };
    own.iter().enumerate().map(gain).collect()
}

/// Per slice how much red over green and blue over green (`ln`) differ from the smooth model of all slices, where that
/// is significant.
pub(super) fn off_tint(tints: &[Option<[f64; 2]>], positions: &[f64]) -> Vec<Option<[f64; 2]>> {
    let model = |k: usize| {
        let points = tints.iter().zip(positions).filter_map(|(t, &z)| t.map(|t| Point { z, value: t[k], sigma: 1e-3 }));
        GainModel::fit(&points.collect::<Vec<_>>(), GAIN_CURVATURE, None)
    };
    let (Some(red), Some(blue)) = (model(0), model(1)) else { return vec![None; tints.len()] };
    let off = |(tint, &z): (&Option<[f64; 2]>, &f64)| {
        let [a, b] = (*tint)?;
        let off = [a - red.at(z), b - blue.at(z)];
        let beyond = |off: f64, model: &GainModel| off.abs() > OWN * model.sigma_at(z).hypot(1e-3);
        (beyond(off[0], &red) || beyond(off[1], &blue)).then_some(off)
    };
    tints.iter().zip(positions).map(off).collect()
}

fn mean_value(points: &[Point]) -> f64 {
    points.iter().map(|p| p.value).sum::<f64>() / points.len().max(1) as f64
}
