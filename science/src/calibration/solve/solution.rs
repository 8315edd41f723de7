//! The solution of a stack, and how one slice of it follows from its estimate and its dots.

use super::estimates::Estimate;
use super::inliers::{Inliers, MISTAKEN};
use crate::calibration::detected::{Detection, MeasuredDot};
use crate::calibration::gains::Gain;
use crate::calibration::lattice::Label;
use crate::calibration::model_selection::StackModel;
use crate::calibration::rail::EstimateSource;
use crate::calibration::rail_anomalies::RailAnomaly;
use crate::calibration::result::{Dot, DotUse};
use crate::calibration::robust;
use crate::calibration::statistics::quantile;
use crate::types::Homography;
use crate::types::report::ModelCandidate;

/// Geometry and gain of one slice.
#[derive(Debug, Clone)]
pub(in crate::calibration) struct Solved {
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// The homography by the rail law alone.
    pub by_law: Option<Homography>,
    /// Factor that makes the slice as bright as the reference slice.
    pub gain: f64,
    /// Its relative standard deviation.
    pub gain_sigma: f64,
    /// The gain by the gain model of all slices; `None` without one.
    pub gain_by_model: Option<f64>,
    /// Brightness over what that model expects, where they differ significantly.
    pub brightness_off_model: Option<f64>,
    /// Standard deviation of the worst image corner, px.
    pub corner_sigma: f64,
    /// RMS residual of the inliers in the reference slice, px; `None` when predicted.
    pub rms: Option<f64>,
    /// 95th percentile of the residuals, px.
    pub p95: Option<f64>,
    /// The dots found.
    pub dots: Vec<Dot>,
    /// Largest distance of an image corner between the slice's own estimate and the rail law, px.
    pub off_law: Option<f64>,
    /// True when predicted by the rail law.
    pub interpolated: bool,
}

/// The solution for the stack.
#[derive(Debug, Clone)]
pub(in crate::calibration) struct Solution {
    /// Index of the reference slice.
    pub reference: usize,
    /// One per slice.
    pub slices: Vec<Solved>,
    /// The selected model.
    pub model: StackModel,
    /// Why it was selected.
    pub model_reason: String,
    /// What each model would give.
    pub candidates: Vec<ModelCandidate>,
    /// Rail anomalies.
    pub anomalies: Vec<RailAnomaly>,
    /// Rail positions that the law was fitted with.
    pub positions: Vec<f64>,
    /// Rail positions derived from the scales, with standard deviations.
    pub positions_by_scale: Option<Vec<Option<(f64, f64)>>>,
    /// Scale parameter of each measured slice (0 at the reference) with its standard deviation.
    pub scales: Vec<Option<(f64, f64)>>,
    /// Slopes of scale, rotation and shift over the positions, units.
    pub slopes: Option<[f64; 4]>,
}

impl Solved {
    /// The reference slice: the identity by definition.
    pub(super) fn reference(base: &Detection, gain: Gain) -> Self {
        let dot = |(label, dot): (&Label, &MeasuredDot)| Dot {
            label: *label,
            at: dot.at,
            sigma: dot.sigma,
            used: DotUse::Inlier,
        };
        Self {
            homography: Homography::IDENTITY,
            by_law: None,
            gain: 1.0,
            gain_sigma: 0.0,
            gain_by_model: gain.by_model,
            brightness_off_model: gain.off_model,
            corner_sigma: 0.0,
            rms: Some(0.0),
            p95: Some(0.0),
            dots: base.dots.iter().map(dot).collect(),
            off_law: None,
            interpolated: false,
        }
    }

    /// A slice by its estimate. `detection`: its dots; `base`: those of the reference slice.
    pub(super) fn estimated(
        estimate: &Estimate,
        inliers: &Inliers,
        detection: Option<&Detection>,
        base: &Detection,
        gain: Gain,
    ) -> Self {
        let interpolated = estimate.source == EstimateSource::Law;
        let far = |label: &Label, at: [f64; 2]| {
            base.dots
                .get(label)
                .is_some_and(|b| robust::transfer_error(&estimate.homography, &(at, b.at)) > MISTAKEN * base.pitch)
        };
        let used = |label: &Label, at: [f64; 2]| match inliers.is_inlier.get(label) {
            // the grid was mistaken by half a step
            _ if interpolated && far(label, at) => DotUse::Outlier,
            _ if interpolated => DotUse::Unused,
            Some(true) => DotUse::Inlier,
            Some(false) => DotUse::Outlier,
            None => DotUse::Unused,
        };
        let measured = detection.iter().flat_map(|s| &s.dots);
        let dots: Vec<Dot> = measured
            .map(|(label, d)| Dot { label: *label, at: d.at, sigma: d.sigma, used: used(label, d.at) })
            .collect();
        let inliers = dots.iter().filter(|d| d.used == DotUse::Inlier);
        let mut errors: Vec<f64> = inliers
            .filter_map(|d| {
                base.dots.get(&d.label).map(|b| robust::transfer_error(&estimate.homography, &(d.at, b.at)))
            })
            .collect();
        let rms =
            (!errors.is_empty()).then(|| (errors.iter().map(|m| m * m).sum::<f64>() / errors.len() as f64).sqrt());
        Self {
            homography: estimate.homography,
            by_law: estimate.by_law,
            gain: gain.value,
            gain_sigma: gain.sigma,
            gain_by_model: gain.by_model,
            brightness_off_model: gain.off_model,
            corner_sigma: estimate.sigma,
            rms,
            p95: rms.map(|_| quantile(&mut errors, 0.95)),
            dots,
            off_law: estimate.off_law,
            interpolated,
        }
    }
}
