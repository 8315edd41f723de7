//! The solution of a stack, and how one slice of it follows from its estimate and its dots.

use super::inliers::{Inliers, MISTAKEN};
use super::{estimates::Estimate, rail_state::RailState};
use crate::calibration::result::{Dot, DotUse};
use crate::calibration::{
    detected::Detection, gains::Gain, lattice::Label, model_selection::Selection, rail::EstimateSource, robust,
    statistics::quantile,
};

/// Geometry and gain of one slice.
pub(in crate::calibration) struct Solved {
    /// Its homography.
    pub estimate: Estimate,
    /// Its gain.
    pub gain: Gain,
    /// RMS residual of the inliers in the reference slice, px; `None` when predicted.
    pub rms: Option<f64>,
    /// 95th percentile of the residuals, px.
    pub p95: Option<f64>,
    /// The dots found.
    pub dots: Vec<Dot>,
}

/// The solution for the stack.
pub(in crate::calibration) struct Solution {
    /// Index of the reference slice.
    pub reference: usize,
    /// One per slice.
    pub slices: Vec<Solved>,
    /// The selected model.
    pub selection: Selection,
    /// The rail.
    pub rail: RailState,
}

impl Solved {
    /// The reference slice: the identity by definition.
    pub(super) fn reference(base: &Detection, gain: Gain) -> Self {
        let dots = dots(base, |_, _| DotUse::Inlier);
        Self { estimate: Estimate::IDENTITY, gain, rms: Some(0.0), p95: Some(0.0), dots }
    }

    /// A slice by its estimate. `detection`: its dots; `base`: those of the reference slice.
    pub(super) fn estimated(
        estimate: Estimate,
        inliers: &Inliers,
        detection: Option<&Detection>,
        base: &Detection,
        gain: Gain,
    ) -> Self {
        let interpolated = estimate.source == EstimateSource::Law;
        let error = |label: &Label, at: [f64; 2]| {
            base.dots.get(label).map(|b| robust::transfer_error(&estimate.homography, &(at, b.at)))
        };
        let used = |label: &Label, at: [f64; 2]| match inliers.is_inlier.get(label) {
            // the grid was mistaken by half a step
            _ if interpolated && error(label, at).is_some_and(|error| error > MISTAKEN * base.pitch) => DotUse::Outlier,
            _ if interpolated => DotUse::Unused,
            Some(true) => DotUse::Inlier,
            Some(false) => DotUse::Outlier,
            None => DotUse::Unused,
        };
        let dots = detection.map_or_else(Vec::new, |detection| dots(detection, used));
        let inliers = dots.iter().filter(|d| d.used == DotUse::Inlier);
        let mut errors: Vec<f64> = inliers.filter_map(|d| error(&d.label, d.at)).collect();
        let count = errors.len() as f64;
        let rms = (!errors.is_empty()).then(|| (errors.iter().map(|m| m * m).sum::<f64>() / count).sqrt());
        Self { estimate, gain, rms, p95: rms.map(|_| quantile(&mut errors, 0.95)), dots }
    }

    /// True when predicted by the rail law.
    pub(in crate::calibration) fn is_predicted(&self) -> bool {
        self.estimate.source == EstimateSource::Law
    }
}

/// The dots of a slice, each with its use by label and position.
fn dots(detection: &Detection, used: impl Fn(&Label, [f64; 2]) -> DotUse) -> Vec<Dot> {
    let dots = detection.dots.iter();
    dots.map(|(label, d)| Dot { label: *label, at: d.at, sigma: d.sigma, used: used(label, d.at) }).collect()
}
