//! The dots that a slice shares with the reference, and what they say by themselves.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::STRAY;
use crate::calibration::chain::Seen;
use crate::calibration::choice::Evidence;
use crate::calibration::dlt::Pair;
use crate::calibration::families::{self, Family, Frame, Match};
use crate::calibration::lattice::{LEAST_DOTS, Label};
use crate::calibration::lockin::OVERLAP;
use crate::calibration::rail::{Law, Own};
use crate::calibration::robust;
use crate::calibration::sighting::Sighting;

/// Distance beyond which a dot never counts as an inlier, px; or a share of the pitch where that is more.
const MOST: f64 = 1.0;
/// What no count of dots takes away: lens distortion, printing, the shape of pixels; px, and as a share of the pitch.
pub(super) const FLOOR: (f64, f64) = (0.006, 4e-4);
/// About how many neighbours what spoils their windows moves alike.
const NEIGHBOURS: f64 = 9.0;

/// The dots that a slice shares with the reference, and which of them agree.
#[derive(Debug, Clone, Default)]
pub(super) struct Agreed {
    pub(super) evidence: Evidence,
    pub(super) agrees: BTreeMap<Label, bool>,
}

/// `None` when too few agree.
pub(super) fn agree(sighting: &Sighting, base: &Sighting, frame: &Frame) -> Option<Agreed> {
    let shared: Vec<(Label, Pair, [f64; 2])> = sighting
        .dots
        .iter()
        .filter_map(|(label, dot)| {
            let b = base.dots.get(label)?;
            let sigma = [dot.sigma.hypot(b.sigma), dot.doubt.hypot(b.doubt)];
            Some((*label, (dot.at, b.at), sigma))
        })
        .collect();
    let pairs: Vec<Pair> = shared.iter().map(|s| s.1).collect();
    if pairs.len() < LEAST_DOTS {
        return None;
    }
    let consensus = robust::agree(&pairs, 0.15, MOST.max(0.02 * base.pitch))?;
    let inliers = consensus.agrees.iter().filter(|a| **a).count();
    if inliers < LEAST_DOTS || 2 * inliers < pairs.len() {
        return None;
    }
    let floor = FLOOR.0;
    let kept = shared.iter().zip(&consensus.agrees).filter(|(_, agrees)| **agrees);
    let matches = kept
        .clone()
        .map(|((_, (here, at), [sigma, _]), _)| Match {
            base: frame.unit(*at),
            here: frame.unit(*here),
            sigma: sigma.hypot(floor) / frame.half,
        })
        .collect();
    // what neighbours share (light beyond the target, glare) is not averaged away among them
    let (weights, alike) = kept.clone().fold((0.0, 0.0), |(weights, alike), ((_, _, [sigma, doubt]), _)| {
        let weight = 1.0 / (sigma * sigma + floor * floor);
        (weights + weight, alike + weight * weight * doubt * doubt)
    });
    let alike = 1.0 + (NEIGHBOURS - 1.0) * alike / weights.max(1e-30);
    let labels = kept.map(|(s, _)| s.0).collect();
    // where many had to be left out, those that were kept are not as good as their scatter says
    let chosen = (pairs.len() as f64 / inliers as f64).powi(4);
    let overlap = (OVERLAP * sighting.density).max(1.0) * chosen * alike;
    let agrees = shared.iter().map(|s| s.0).zip(consensus.agrees.iter().copied()).collect();
    Some(Agreed { evidence: Evidence { labels, matches, overlap }, agrees })
}

/// What each slice says by itself in one family; the reference is the identity, exactly.
pub(super) fn owns(
    family: Family,
    agreed: &[Agreed],
    reference: usize,
    frame: &Frame,
    [width, height]: [u32; 2],
) -> Vec<Option<Own>> {
    agreed
        .iter()
        .enumerate()
        .map(|(index, agreed)| {
            let size = family.size();
            if index == reference {
                let covariance = DMatrix::identity(size, size) * 1e-16;
                return Some(Own { free: DVector::zeros(size), covariance });
            }
            let fit = families::fit(family, &agreed.evidence.matches)?;
            let covariance = &fit.covariance * agreed.evidence.overlap;
            // at the corners, which is what counts: numbers apart from one another are too many for so few blocks
            let at_corners = |c: &DMatrix<f64>| families::corner_sigma(family, &fit.free, c, frame, width, height);
            let more = (at_corners(&fit.by_blocks) / at_corners(&covariance).max(1e-12)).max(1.0);
            Some(Own { covariance: covariance * (more * more), free: fit.free })
        })
        .collect()
}

/// Forgets what was measured in slices whose dots run together and whose place contradicts the sharper slices by a good
/// part of the pitch: there the grid was mistaken by half a step or a whole one. From the sharp slices outward, so that
/// one mistaken slice does not speak for another.
pub(super) fn drop_strays(agreed: &mut [Agreed], own: &[Option<Own>], positions: &[f64], seen: &Seen, base: &Sighting) {
    let frame = Frame::new(seen.width, seen.height);
    let merged = |i: usize| seen.sightings[i].as_ref().is_some_and(|s| s.merged);
    let mut trusted: Vec<Option<Own>> = own.iter().enumerate().map(|(i, o)| o.clone().filter(|_| !merged(i))).collect();
    loop {
        let known: Vec<usize> = (0..own.len()).filter(|&i| trusted[i].is_some()).collect();
        let waiting = (0..own.len()).filter(|&i| {
            own[i].is_some() && merged(i) && trusted[i].is_none() && !agreed[i].evidence.matches.is_empty()
        });
        let nearest = |i: usize| known.iter().map(|k| k.abs_diff(i)).min().unwrap_or(usize::MAX);
        let Some(next) = waiting.min_by_key(|&i| nearest(i)) else { return };
        let off = Law::fit(&trusted, positions, None).zip(own[next].as_ref()).map(|(law, o)| &o.free - law.says(next));
        if off.is_some_and(|off| frame.half * off[2].hypot(off[3]) > STRAY * base.pitch) {
            agreed[next] = Agreed::default();
        } else {
            trusted[next].clone_from(&own[next]);
        }
    }
}
