//! The inliers of each slice, and its estimate from these dots alone.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use crate::calibration::lattice::{Label, MIN_DOTS};
use crate::calibration::rail::{Law, OwnEstimate};
use crate::calibration::transform_models::{self, Frame, Match, TransformModel};
use crate::calibration::{
    detected::Detection, dlt::Pair, model_selection::Evidence, phase::WINDOW_OVERLAP, robust, tracked::Tracked,
};

/// Largest inlier limit, px; 0.02 of the pitch where that is more.
const MAX_RESIDUAL: f64 = 1.0;
/// Distance from the rail law, in grid steps, from which the grid of a slice with merged dots counts as mistaken.
pub(super) const MISTAKEN: f64 = 0.3;
/// Uncertainty that no number of dots reduces (lens distortion, print, pixel shape): px, and as a share of the pitch.
pub(super) const FLOOR: (f64, f64) = (0.006, 4e-4);
/// Approximate number of neighbouring dots that share an error.
const NEIGHBOURS: f64 = 9.0;

/// The dots that a slice shares with the reference slice, and which of them are inliers.
#[derive(Debug, Clone, Default)]
pub(in crate::calibration) struct Inliers {
    /// The inliers.
    pub(in crate::calibration) evidence: Evidence,
    /// For every shared dot, whether it is an inlier.
    pub(super) is_inlier: BTreeMap<Label, bool>,
    /// Per inlier the displacement of one standard deviation that all have together, units.
    doubts: Vec<[f64; 2]>,
}

impl Inliers {
    /// The same as if light and blur displaced no dots.
    pub(super) fn without_doubts(&self) -> Self {
        Self { doubts: vec![[0.0; 2]; self.doubts.len()], ..self.clone() }
    }
}

/// Finds the inliers of a slice. `None` when there are too few.
pub(in crate::calibration) fn find_inliers(detection: &Detection, base: &Detection, frame: &Frame) -> Option<Inliers> {
    let shared: Vec<(Label, Pair, [f64; 2])> = detection
        .dots
        .iter()
        .filter_map(|(label, dot)| {
            let b = base.dots.get(label)?;
            let sigma = [dot.sigma.hypot(b.sigma), dot.shared_sigma.hypot(b.shared_sigma)];
            Some((*label, (dot.at, b.at), sigma))
        })
        .collect();
    let pairs: Vec<Pair> = shared.iter().map(|s| s.1).collect();
    if pairs.len() < MIN_DOTS {
        return None;
    }
    let consensus = robust::consensus(&pairs, 0.15, MAX_RESIDUAL.max(0.02 * base.pitch))?;
    let count = consensus.is_inlier.iter().filter(|a| **a).count();
    if count < MIN_DOTS || 2 * count < pairs.len() {
        return None;
    }
    let floor = FLOOR.0;
    let kept = shared.iter().zip(&consensus.is_inlier).filter(|(_, is_inlier)| **is_inlier);
    let matches = kept
        .clone()
        .map(|((_, (here, at), [sigma, _]), _)| Match {
            base: frame.unit(*at),
            here: frame.unit(*here),
            sigma: sigma.hypot(floor) / frame.half,
        })
        .collect();
    // errors that neighbours share (light beyond the target, glare) do not average out among them
    let (weights, alike) = kept.clone().fold((0.0, 0.0), |(weights, alike), ((_, _, [sigma, shared_sigma]), _)| {
        let weight = 1.0 / (sigma * sigma + floor * floor);
        (weights + weight, alike + weight * weight * shared_sigma * shared_sigma)
    });
    let alike = 1.0 + (NEIGHBOURS - 1.0) * alike / weights.max(1e-30);
    let labels: Vec<Label> = kept.map(|(s, _)| s.0).collect();
    let doubt = |label: &Label| {
        let [here, there] = [detection, base].map(|of| of.dots.get(label).map_or([0.0; 2], |dot| dot.doubt));
        [0, 1].map(|a| (here[a] - there[a]) / frame.half)
    };
    let doubts = labels.iter().map(doubt).collect();
    // where many dots were rejected, the rest is less accurate than its scatter suggests
    let chosen = (pairs.len() as f64 / count as f64).powi(4);
    let overlap = (WINDOW_OVERLAP * detection.density).max(1.0) * chosen * alike;
    let is_inlier = shared.iter().map(|s| s.0).zip(consensus.is_inlier.iter().copied()).collect();
    Some(Inliers { evidence: Evidence { labels, matches, overlap }, is_inlier, doubts })
}

/// Each slice's estimate from its own dots under one model; the reference slice is exactly the identity.
pub(super) fn own_estimates(
    model: TransformModel,
    inliers: &[Inliers],
    reference: usize,
    frame: &Frame,
    [width, height]: [u32; 2],
) -> Vec<Option<OwnEstimate>> {
    inliers
        .iter()
        .enumerate()
        .map(|(index, inliers)| {
            let size = model.size();
            if index == reference {
                let covariance = DMatrix::identity(size, size) * 1e-16;
                return Some(OwnEstimate { free: DVector::zeros(size), covariance });
            }
            let fit = transform_models::fit(model, &inliers.evidence.matches)?;
            let covariance = &fit.covariance * inliers.evidence.overlap;
            // compared at the corners, which matter: a few blocks cannot determine a full covariance
            let at_corners =
                |c: &DMatrix<f64>| transform_models::corner_sigma(model, &fit.free, c, frame, width, height);
            let more = (at_corners(&fit.block_covariance) / at_corners(&covariance).max(1e-12)).max(1.0);
            let mut covariance = covariance * (more * more);
            let doubt = transform_models::response(model, &inliers.evidence.matches, &fit.free, &inliers.doubts)?;
            covariance += &doubt * doubt.transpose();
            Some(OwnEstimate { covariance, free: fit.free })
        })
        .collect()
}

/// Drops slices with merged dots whose position contradicts the sharper slices by a good part of the pitch: there the
/// grid was mistaken by half a step or a whole one. Works outward from the sharp slices, so that one mistaken slice
/// does not support another.
pub(super) fn drop_mistaken_grids(
    inliers: &mut [Inliers],
    own: &[Option<OwnEstimate>],
    positions: &[f64],
    tracked: &Tracked,
    base: &Detection,
) {
    let frame = Frame::new(tracked.width, tracked.height);
    let merged = |i: usize| {
        tracked.detections[i].as_ref().is_some_and(|s| s.merged && s.identity.is_none())
            && !tracked.labelling[i].confirmed
    };
    let mut trusted: Vec<Option<OwnEstimate>> =
        own.iter().enumerate().map(|(i, o)| o.clone().filter(|_| !merged(i))).collect();
    loop {
        let known: Vec<usize> = (0..own.len()).filter(|&i| trusted[i].is_some()).collect();
        let waiting = (0..own.len()).filter(|&i| {
            own[i].is_some() && merged(i) && trusted[i].is_none() && !inliers[i].evidence.matches.is_empty()
        });
        let nearest = |i: usize| known.iter().map(|k| k.abs_diff(i)).min().unwrap_or(usize::MAX);
        let Some(next) = waiting.min_by_key(|&i| nearest(i)) else { return };
        let off =
            Law::fit(&trusted, positions, None).zip(own[next].as_ref()).map(|(law, o)| &o.free - law.predict(next));
        if off.is_some_and(|off| frame.half * off[2].hypot(off[3]) > MISTAKEN * base.pitch) {
            inliers[next] = Inliers::default();
        } else {
            trusted[next].clone_from(&own[next]);
        }
    }
}
