//! Identity of the dots: whether the same label is the same dot in all slices.
//!
//! Input: the tracked grid. A dot is tracked to the nearest dot of the next slice, and a perfect grid looks the same
//! after a shift by a whole step, so a jump by more than half a step is mistaken for a smaller one. The result would be
//! wrong by whole steps, and no residual would show it. What tells is all that makes the cells of the grid differ: its
//! end, missing dots, dirt, errors of print (see [`fingerprint`]). Each slice is compared with its neighbour and with
//! the slice in which the grid was detected, over shifts of the labels (see [`shifts`]).
//!
//! Output: corrected labels, and per slice how certain they are:
//!
//! | word | meaning |
//! |---|---|
//! | certain | the comparisons reject every other shift by whole steps |
//! | confirmed | certain, and no shift by half a step agrees better |
//! | ambiguous | not certain, and the motion of the other slices does not tell either (see [`motion_line`]) |

mod cells;
mod fingerprint;
mod motion_line;
mod presence;
mod sensor;
mod shifts;
mod target_map;
#[cfg(test)]
mod tests;

pub(super) use fingerprint::{Fingerprint, MAX_BYTES, MAX_CELLS};

use super::detected::Detection;
use shifts::{Comparison, Decision, decide, is_half_step_off};

/// How certain the labels of one slice are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Labelling {
    /// True when the labels may be wrong by whole steps.
    pub(super) ambiguous: bool,
    /// True when the image itself confirms the labels: no other shift, by whole or half steps, agrees as well.
    pub(super) confirmed: bool,
}

/// What the comparisons with other slices tell about a slice.
#[derive(Debug, Clone, Copy)]
struct LabelCheck {
    /// Added to the labels.
    decision: Decision,
    /// See [`Detection::turned`].
    turned: Option<bool>,
    /// True when a shift by half steps agrees better: gaps were taken for dots.
    is_half_off: bool,
}

impl LabelCheck {
    /// The labels are right: of the first slice, and of slices whose code was read.
    const RIGHT: Self = Self { decision: Decision::RIGHT, turned: None, is_half_off: false };

    fn is_confirmed(&self) -> bool {
        self.decision.certain && !self.is_half_off
    }
}

/// Checks and corrects the labels of all slices. `seed` is the slice in which the grid was detected; its labels define
/// those of the others. Removes tentative detections that are not confirmed.
pub(super) fn resolve_labels(detections: &mut [Option<Detection>], seed: usize) -> Vec<Labelling> {
    let first = compare_outward(detections, seed, true);
    let prints: Vec<Fingerprint> = detections
        .iter()
        .zip(&first)
        .filter_map(|(detection, check)| relabelled(detection.as_ref()?, check.as_ref()?))
        .collect();
    let correlate = sensor::moves_with_target(&prints.iter().collect::<Vec<_>>());
    let mut checks = if correlate { first } else { compare_outward(detections, seed, false) };
    resolve_uncertain(&mut checks, detections, correlate);
    for (slot, check) in detections.iter_mut().zip(&mut checks) {
        if let (Some(detection), Some(found)) = (slot.as_mut(), *check) {
            detection.relabel(found.decision.shift);
            detection.turned = detection.turned.or(found.turned);
            if detection.is_tentative && !found.is_confirmed() {
                (*slot, *check) = (None, None);
            }
        }
    }
    let unsure: Vec<bool> = checks.iter().map(|c| c.is_some_and(|c| !c.decision.certain)).collect();
    let by_motion = motion_line::confirmed(detections, &unsure);
    let labelling = |(i, check): (usize, &Option<LabelCheck>)| Labelling {
        ambiguous: unsure[i] && !by_motion[i],
        confirmed: check.as_ref().is_some_and(LabelCheck::is_confirmed),
    };
    checks.iter().enumerate().map(labelling).collect()
}

/// The fingerprint of a slice with its labels corrected.
fn relabelled(detection: &Detection, check: &LabelCheck) -> Option<Fingerprint> {
    let mut print = detection.fingerprint.clone()?;
    print.relabel(check.decision.shift);
    Some(print)
}

/// Rounds of [`resolve_uncertain`]: each can make slices certain that help others.
const ROUNDS: usize = 3;

/// Compares the slices whose labels are not certain with all that are. Slices of another scale may show an end of the
/// grid, or a mark, that the neighbour and the first slice do not show.
fn resolve_uncertain(checks: &mut [Option<LabelCheck>], detections: &[Option<Detection>], correlate: bool) {
    for _ in 0..ROUNDS {
        let with = |certain: bool| -> Vec<(usize, Fingerprint)> {
            let of = |(i, check): (usize, &Option<LabelCheck>)| {
                let check = check.as_ref().filter(|c| c.decision.certain == certain && c.turned.is_none())?;
                let detection = detections[i].as_ref().filter(|d| !d.is_tentative)?;
                Some((i, relabelled(detection, check)?))
            };
            checks.iter().enumerate().filter_map(of).collect()
        };
        let (known, open) = (with(true), with(false));
        let Some(map) = target_map::of(known.iter().map(|(_, print)| print)) else { return };
        let mut is_changed = false;
        for (i, print) in open {
            let nearest = known.iter().min_by_key(|(k, _)| k.abs_diff(i));
            let others = std::iter::once(&map).chain(nearest.map(|(_, other)| other));
            let comparisons: Vec<Comparison> = others.map(|other| Comparison::new(&print, other)).collect();
            let found = decide(&comparisons, correlate);
            if let Some(check) = checks[i].as_mut().filter(|_| found.certain) {
                check.decision = check.decision.then(found);
                check.decision.certain = true;
                is_changed = true;
            }
        }
        if !is_changed {
            return;
        }
    }
}

/// The slice from which the next one outward was tracked.
struct InnerSlice {
    fingerprint: Option<Fingerprint>,
    decision: Decision,
}

/// Compares the slices outward from `seed`; `None` where the grid was not found.
fn compare_outward(detections: &[Option<Detection>], seed: usize, correlate: bool) -> Vec<Option<LabelCheck>> {
    let mut out: Vec<Option<LabelCheck>> = vec![None; detections.len()];
    let Some(start) = detections.get(seed).and_then(Option::as_ref) else { return out };
    out[seed] = Some(LabelCheck::RIGHT);
    let outward: [Vec<usize>; 2] = [(seed + 1..detections.len()).collect(), (0..seed).rev().collect()];
    for indices in outward {
        let mut inner = InnerSlice { fingerprint: start.fingerprint.clone(), decision: Decision::RIGHT };
        for index in indices {
            let Some(detection) = &detections[index] else { continue };
            if detection.identity.is_some() {
                // the code of the target has identified its dots
                out[index] = Some(LabelCheck::RIGHT);
                inner = InnerSlice { fingerprint: detection.fingerprint.clone(), decision: Decision::RIGHT };
                continue;
            }
            let Some(print) = detection.fingerprint.clone() else {
                let decision = Decision { certain: false, ..inner.decision };
                out[index] = Some(LabelCheck { decision, ..LabelCheck::RIGHT });
                continue;
            };
            let first = start.fingerprint.as_ref().filter(|_| index.abs_diff(seed) > 1);
            let (check, print) = compare(print, detection.merged, &inner, first, correlate);
            if check.turned.is_none() && (!detection.is_tentative || check.is_confirmed()) {
                inner = InnerSlice { fingerprint: Some(print), decision: check.decision };
            }
            out[index] = Some(check);
        }
    }
    out
}

/// Compares the slice of `print` with `inner`, from which it was tracked, and with the first slice where that is
/// another one. Returns the fingerprint with its labels corrected, too.
fn compare(
    mut print: Fingerprint,
    merged: bool,
    inner: &InnerSlice,
    first: Option<&Fingerprint>,
    correlate: bool,
) -> (LabelCheck, Fingerprint) {
    // the slice shares the error of the labels of the inner one
    print.relabel(inner.decision.shift);
    let neighbour = inner.fingerprint.as_ref();
    let with_neighbour = neighbour.map(|other| Comparison::new(&print, other));
    let turned = with_neighbour.as_ref().zip(neighbour).and_then(|(c, other)| c.orientation(&print, other));
    let with_first = first.map(|first| Comparison::new(&print, first));
    let comparisons: Vec<Comparison> = with_neighbour.into_iter().chain(with_first).collect();
    let found = decide(&comparisons, correlate);
    print.relabel(found.shift);
    let is_half_off = merged && neighbour.is_some_and(|other| is_half_step_off(&print, other));
    // labels that are carried from slice to slice are as certain as those they were carried from, except where the
    // first slice itself confirms the slice
    let mut decision = inner.decision.then(found);
    decision.certain = decision.certain
        || first.is_some_and(|first| decide(&[Comparison::new(&print, first)], correlate) == Decision::RIGHT);
    (LabelCheck { decision, turned, is_half_off }, print)
}
