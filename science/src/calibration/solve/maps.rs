//! The map of each slice in one family, by its dots or by the law of the rail, and how sure it is.

use nalgebra::DVector;

use super::agreed::{Agreed, FLOOR, owns};
use crate::calibration::chain::Seen;
use crate::calibration::choice::{Corner, Model};
use crate::calibration::families::{self, Departure, Family, Frame, Match};
use crate::calibration::joint::Joint;
use crate::calibration::rail::{self, Law, Source};
use crate::calibration::sighting::Sighting;
use crate::types::Homography;

/// Uncertainty of a corner, px, from which a slice's own dots count as too blurred when the rail knows better.
const FAINT: f64 = 0.4;

/// What all maps are made in.
pub(super) struct Setting<'a> {
    pub(super) frame: &'a Frame,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) reference: usize,
    pub(super) positions: &'a [f64],
    pub(super) away: &'a [f64],
    pub(super) jump: Option<usize>,
    pub(super) floors: &'a [f64],
}

/// The map of one slice.
pub(super) struct Mapped {
    pub(super) homography: Homography,
    pub(super) by_law: Option<Homography>,
    pub(super) off_law: Option<f64>,
    pub(super) sigma: f64,
    pub(super) source: Source,
}

/// What a family's maps do at the corners, beside the homographies, in the slices that were measured.
pub(super) fn corners(maps: &[Option<Mapped>], full: &[Option<Mapped>], agreed: &[Agreed], s: &Setting) -> Vec<Corner> {
    let measured = (0..maps.len()).filter(|&i| i != s.reference && !agreed[i].evidence.matches.is_empty());
    measured
        .filter_map(|i| maps[i].as_ref().zip(full.get(i)?.as_ref()))
        .map(|(own, full)| Corner {
            sigma: own.sigma,
            full_sigma: full.sigma,
            apart: own.homography.corner_distance(&full.homography, s.width, s.height),
        })
        .collect()
}

/// The maps of all slices in one family; `None` where there is neither a measurement nor a law.
pub(super) fn maps(model: Model, agreed: &[Agreed], setting: &Setting) -> Vec<Option<Mapped>> {
    match model {
        Model::Joint => joint_maps(agreed, setting),
        Model::PerSlice(family) => slice_maps(family, agreed, setting),
    }
}

/// What no count of dots takes away, px, per slice: it weighs the more the less blur has left of the pattern.
pub(super) fn floors(seen: &Seen, pitch: f64) -> Vec<f64> {
    let strongest = seen.sightings.iter().flatten().map(|s| s.ripple).fold(1e-9, f64::max);
    let left = |s: &Sighting| (s.ripple / strongest).abs().clamp(0.05, 1.0);
    let floor = |s: &Option<Sighting>| {
        let blurred = s.as_ref().map_or(1.0, |s| 0.5 + 0.5 / left(s));
        (FLOOR.0 + FLOOR.1 * pitch) * blurred
    };
    seen.sightings.iter().map(floor).collect()
}

fn slice_maps(family: Family, agreed: &[Agreed], s: &Setting) -> Vec<Option<Mapped>> {
    let own = owns(family, agreed, s.reference, s.frame, [s.width, s.height]);
    let map = |free: &DVector<f64>| s.frame.homography(&family.departure(free));
    (0..own.len())
        .map(|index| {
            let (settled, source) = rail::settled(&own, s.positions, s.jump, index)?;
            let mut others = own.clone();
            others[index] = None;
            let by_law = Law::fit(&others, s.positions, s.jump).and_then(|law| map(&law.says(index)));
            let alone = own[index].as_ref().and_then(|o| map(&o.free));
            let off_law = alone.zip(by_law).map(|(a, b)| a.corner_distance(&b, s.width, s.height));
            let sigma = families::corner_sigma(family, &settled.free, &settled.covariance, s.frame, s.width, s.height);
            let by_itself = own[index]
                .as_ref()
                .map_or(0.0, |o| families::corner_sigma(family, &o.free, &o.covariance, s.frame, s.width, s.height));
            // its dots had a say, but hardly a voice
            let source = if by_itself > FAINT && sigma < 0.5 * by_itself { Source::Law } else { source };
            Some(Mapped {
                homography: map(&settled.free)?,
                by_law,
                off_law,
                sigma: sigma.hypot(s.floors[index]),
                source,
            })
        })
        .collect()
}

fn joint_maps(agreed: &[Agreed], s: &Setting) -> Vec<Option<Mapped>> {
    let matches: Vec<Vec<Match>> = agreed.iter().map(|a| a.evidence.matches.clone()).collect();
    let overlap = agreed.iter().map(|a| a.evidence.overlap).fold(1.0, f64::max);
    let Some(joint) = Joint::fit(&matches, s.away) else { return agreed.iter().map(|_| None).collect() };
    let own = owns(Family::Homography, agreed, s.reference, s.frame, [s.width, s.height]);
    let map = |p: &Departure| s.frame.homography(p);
    let off = |index: usize| {
        let mine = own[index].as_ref().and_then(|o| map(&Family::Homography.departure(&o.free)))?;
        Some(mine.corner_distance(&map(&joint.departure(s.away[index]))?, s.width, s.height))
    };
    (0..agreed.len())
        .map(|index| {
            let homography = map(&joint.departure(s.away[index]))?;
            // scatter that slices share among their dots is no noise of the dots
            let similar = families::fit(Family::Similarity, &agreed[index].evidence.matches)
                .and_then(|fit| map(&Family::Similarity.departure(&fit.free)))
                .map_or(0.0, |h| h.corner_distance(&homography, s.width, s.height));
            let sigma = s.frame.half * joint.corner_sigma(s.away[index]) * overlap.sqrt();
            let source = if agreed[index].evidence.matches.is_empty() { Source::Law } else { Source::Dots };
            let sigma = sigma.hypot(s.floors[index]).hypot(0.5 * similar);
            Some(Mapped { homography, by_law: Some(homography), off_law: off(index), sigma, source })
        })
        .collect()
}
