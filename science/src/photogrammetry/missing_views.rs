//! The views that are missing from the grid of pan and tilt that the views of a scan form.
//!
//! In: the angles of all views. Out: the angles at which no view is.

use std::collections::{BTreeMap, BTreeSet};

use super::statistics::median;
use crate::types::view::ViewAngles;

/// Angles that differ by less are equal, degrees.
const SAME_ANGLE: f64 = 0.01;
/// Largest number of missing views that are listed.
const MOST_MISSING: usize = 200;

/// The angles at which a view is missing from the grid of pan and tilt that the other views form, by tilt and pan; at
/// most 200. Empty when the views form no grid: fewer than two positions of pan, or rings of different positions.
///
/// A position belongs to the grid when at least half of the rings (views of equal tilt) have it, or when it closes a
/// gap of a whole number of steps within a ring.
pub fn missing_views(angles: &[ViewAngles]) -> Vec<ViewAngles> {
    let rings = rings(angles);
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    rings.iter().flat_map(|(_, pans)| pans).for_each(|&pan| *counts.entry(pan).or_default() += 1);
    let is_common = |count: usize| rings.len() > 1 && 2 * count >= rings.len();
    let common: Vec<u32> = counts.into_iter().filter(|(_, count)| is_common(*count)).map(|(pan, _)| pan).collect();
    let mut missing = Vec::new();
    for (tilt_deg, pans) in &rings {
        let candidates: BTreeSet<u32> = common.iter().copied().chain(gaps(pans)).collect();
        let absent = candidates.into_iter().filter(|pan| !pans.contains(pan));
        let left = MOST_MISSING - missing.len();
        missing.extend(absent.take(left).map(|pan| ViewAngles { pan_deg: degrees(pan), tilt_deg: *tilt_deg }));
    }
    missing
}

/// A pan as a multiple of [`SAME_ANGLE`], from 0 to 360 degrees.
fn position(pan_deg: f64) -> u32 {
    let turn = (360.0 / SAME_ANGLE).round();
    // at most 36000
    (pan_deg / SAME_ANGLE).round().rem_euclid(turn) as u32
}

fn degrees(position: u32) -> f64 {
    // the reciprocal is a whole number: 0.2 and not 0.20000000000000001
    f64::from(position) / (1.0 / SAME_ANGLE).round()
}

/// The views by tilt: the positions of pan of each ring.
fn rings(angles: &[ViewAngles]) -> Vec<(f64, BTreeSet<u32>)> {
    let mut sorted: Vec<ViewAngles> =
        angles.iter().filter(|view| view.pan_deg.is_finite() && view.tilt_deg.is_finite()).copied().collect();
    sorted.sort_by(|a, b| a.tilt_deg.total_cmp(&b.tilt_deg));
    let mut rings: Vec<(f64, BTreeSet<u32>)> = Vec::new();
    for view in sorted {
        let pan = position(view.pan_deg);
        match rings.last_mut() {
            Some((tilt, pans)) if view.tilt_deg - *tilt < SAME_ANGLE => {
                pans.insert(pan);
            }
            _ => rings.push((view.tilt_deg, BTreeSet::from([pan]))),
        }
    }
    rings
}

/// The positions that are missing between neighbours of a ring, by the median step. A gap of more than half a turn is
/// taken for the end of a partial ring.
fn gaps(pans: &BTreeSet<u32>) -> Vec<u32> {
    let pans: Vec<f64> = pans.iter().map(|&pan| degrees(pan)).collect();
    if pans.len() < 4 {
        return Vec::new();
    }
    let next = |at: usize| if at + 1 < pans.len() { pans[at + 1] } else { pans[0] + 360.0 };
    let step = median((0..pans.len()).map(|at| next(at) - pans[at]).collect());
    let mut missing = Vec::new();
    for (at, &pan) in pans.iter().enumerate() {
        let gap = next(at) - pan;
        let steps = (gap / step).round();
        let is_whole = (gap - steps * step).abs() < 0.1 * step;
        if steps < 1.5 || gap > 180.0 || !is_whole {
            continue;
        }
        missing.extend((1..steps as usize).map(|k| position(pan + gap * k as f64 / steps)));
    }
    missing
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(pans: usize, tilts: &[f64]) -> Vec<ViewAngles> {
        let ring =
            |tilt_deg: f64| (0..pans).map(move |k| ViewAngles { pan_deg: 360.0 / pans as f64 * k as f64, tilt_deg });
        tilts.iter().flat_map(|&tilt| ring(tilt)).collect()
    }

    #[test]
    fn missing_positions_of_the_grid_are_found() {
        let mut angles = grid(18, &[0.0, 6.0, 12.0]);
        assert_eq!(missing_views(&angles), []);
        let removed = [angles.remove(40), angles.remove(17), angles.remove(0)];
        let mut missing = missing_views(&angles);
        missing.reverse();
        assert_eq!(missing, removed);
    }

    #[test]
    fn a_gap_in_a_single_ring_is_found_and_a_partial_ring_has_none() {
        let mut ring = grid(12, &[0.0]);
        ring.remove(5);
        ring.remove(5);
        let pans: Vec<f64> = missing_views(&ring).iter().map(|view| view.pan_deg.round()).collect();
        assert_eq!(pans, [150.0, 180.0]);
        let partial: Vec<ViewAngles> = grid(36, &[0.0]).into_iter().take(12).collect();
        assert_eq!(missing_views(&partial), []);
        assert_eq!(missing_views(&[]), []);
    }

    /// Ten thousand views at angles of their own: work that grew with the cube of their number would not end.
    #[test]
    fn a_scan_of_many_rings_is_searched_in_bounded_time() {
        let angles: Vec<ViewAngles> = (0..10_000)
            .map(|at| ViewAngles { pan_deg: f64::from(at % 360), tilt_deg: -90.0 + f64::from(at) * 0.018 })
            .collect();
        assert_eq!(missing_views(&angles), []);
    }
}
