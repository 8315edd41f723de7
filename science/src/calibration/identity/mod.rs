//! Identity of the dots: whether the same label is the same dot in all slices.
//!
//! Input: the tracked grid. A dot is tracked to the nearest dot of the next slice, and a perfect grid looks the same
//! after a shift by a whole step, so a jump by more than half a step is mistaken for a smaller one. The result would be
//! wrong by whole steps, and no residual would show it. What tells is all that makes the cells of the grid differ: its
//! end, missing dots, dirt, errors of print (see [`fingerprint`]). Each slice is compared with its neighbour and with
//! the slice in which the grid was detected, over shifts of the labels (see [`shifts`]).
//!
//! Output: corrected labels, and per slice whether its labels are certain. Where nothing tells, the labels are
//! ambiguous, and [`findings`] says so.

pub(super) mod findings;
mod fingerprint;
mod law;
mod sensor;
mod shifts;
mod target_map;
#[cfg(test)]
mod tests;

pub(super) use fingerprint::{Fingerprint, MAX_BYTES, MAX_CELLS};

use super::detection::Detection;
use super::lattice::Label;
use shifts::{Comparison, Decision, decide};

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
struct Settled {
    /// Added to the labels.
    decision: Decision,
    /// See [`Detection::turned`].
    turned: Option<bool>,
    /// True when a shift by half steps agrees better: gaps were taken for dots.
    is_half_off: bool,
}

impl Settled {
    const SEED: Self = Self { decision: Decision { shift: [0, 0], certain: true }, turned: None, is_half_off: false };
}

/// Checks and corrects the labels of all slices. `seed` is the slice in which the grid was detected; its labels define
/// those of the others. Removes tentative detections that are not confirmed.
pub(super) fn settle(detections: &mut [Option<Detection>], seed: usize) -> Vec<Labelling> {
    let first = compared(detections, seed, true);
    let shifted = |(detection, settled): (&Option<Detection>, &Option<Settled>)| {
        let mut print = detection.as_ref()?.fingerprint.clone()?;
        print.relabel(settled.as_ref()?.decision.shift);
        Some(print)
    };
    let prints: Vec<Fingerprint> = detections.iter().zip(&first).filter_map(shifted).collect();
    let known: Vec<&Fingerprint> = prints.iter().collect();
    let correlate = sensor::moves_with_target(&known);
    let mut settled = if correlate { first } else { compared(detections, seed, false) };
    settle_uncertain(&mut settled, detections, correlate);
    let is_confirmed = |s: &Settled| s.decision.certain && !s.is_half_off;
    for (slot, settled) in detections.iter_mut().zip(&settled) {
        if let (Some(detection), Some(settled)) = (slot.as_mut(), settled) {
            detection.relabel(settled.decision.shift);
            detection.turned = detection.turned.or(settled.turned);
            if detection.is_tentative && !is_confirmed(settled) {
                *slot = None;
            }
        }
    }
    let settled: Vec<Option<Settled>> =
        settled.into_iter().zip(&*detections).map(|(s, d)| s.filter(|_| d.is_some())).collect();
    let unsure: Vec<bool> = settled.iter().map(|s| s.is_some_and(|s| !s.decision.certain)).collect();
    let by_law = law::confirmed(detections, &unsure);
    let labelling = |(i, s): (usize, &Option<Settled>)| Labelling {
        ambiguous: unsure[i] && !by_law[i],
        confirmed: s.as_ref().is_some_and(is_confirmed),
    };
    settled.iter().enumerate().map(labelling).collect()
}

/// Rounds of [`settle_uncertain`]: each can make slices certain that help others.
const ROUNDS: usize = 3;

/// Compares the slices whose labels are not certain with all that are. Slices of another scale may show an end of the
/// grid, or a mark, that the neighbour and the first slice do not show.
fn settle_uncertain(settled: &mut [Option<Settled>], detections: &[Option<Detection>], correlate: bool) {
    let print = |i: usize, shift: Label| {
        let detection = detections[i].as_ref().filter(|d| !d.is_tentative)?;
        let mut print = detection.fingerprint.clone()?;
        print.relabel(shift);
        Some(print)
    };
    for _ in 0..ROUNDS {
        let with = |certain: bool| -> Vec<(usize, Fingerprint)> {
            let of = |(i, s): (usize, &Option<Settled>)| {
                let s = s.as_ref().filter(|s| s.decision.certain == certain && s.turned.is_none())?;
                Some((i, print(i, s.decision.shift)?))
            };
            settled.iter().enumerate().filter_map(of).collect()
        };
        let (known, open) = (with(true), with(false));
        let Some(map) = target_map::of(known.iter().map(|(_, print)| print)) else { return };
        let mut is_changed = false;
        for (i, print) in open {
            let nearest = known.iter().min_by_key(|(k, _)| k.abs_diff(i));
            let others = std::iter::once(&map).chain(nearest.map(|(_, other)| other));
            let comparisons: Vec<Comparison> = others.map(|other| Comparison::new(&print, other)).collect();
            let found = decide(&comparisons, correlate);
            if let Some(settled) = settled[i].as_mut().filter(|_| found.certain) {
                let before = settled.decision.shift;
                settled.decision = Decision { shift: [0, 1].map(|a| before[a] + found.shift[a]), certain: true };
                is_changed = true;
            }
        }
        if !is_changed {
            return;
        }
    }
}

/// Compares the slices outward from `seed`; `None` where the grid was not found.
fn compared(detections: &[Option<Detection>], seed: usize, correlate: bool) -> Vec<Option<Settled>> {
    let mut out: Vec<Option<Settled>> = vec![None; detections.len()];
    let Some(start) = detections.get(seed).and_then(Option::as_ref) else { return out };
    out[seed] = Some(Settled::SEED);
    let outward: [Vec<usize>; 2] = [(seed + 1..detections.len()).collect(), (0..seed).rev().collect()];
    for indices in outward {
        let mut inner = (start.fingerprint.clone(), Decision { shift: [0, 0], certain: true });
        for index in indices {
            let Some(detection) = &detections[index] else { continue };
            if detection.identity.is_some() {
                // the code of the target has identified its dots
                out[index] = Some(Settled::SEED);
                inner = (detection.fingerprint.clone(), Settled::SEED.decision);
                continue;
            }
            // the slice was tracked from its neighbour, so it shares the error of its labels
            let carried = inner.1.shift;
            let Some(mut print) = detection.fingerprint.clone() else {
                out[index] = Some(Settled { decision: Decision { shift: carried, certain: false }, ..Settled::SEED });
                continue;
            };
            print.relabel(carried);
            let neighbour = inner.0.as_ref().map(|other| (Comparison::new(&print, other), other));
            let first = start.fingerprint.as_ref().filter(|_| index.abs_diff(seed) > 1);
            let comparisons: Vec<Comparison> =
                neighbour.iter().map(|(c, _)| c.clone()).chain(first.map(|s| Comparison::new(&print, s))).collect();
            let found = decide(&comparisons, correlate);
            let turned = neighbour.as_ref().and_then(|(c, other)| c.orientation(&print, other));
            print.relabel(found.shift);
            let is_half_off =
                detection.merged && inner.0.as_ref().is_some_and(|other| shifts::is_half_step_off(&print, other));
            // labels that are carried from slice to slice are as certain as those they were carried from, except where
            // the first slice itself confirms the slice
            let by_first = || {
                first.is_some_and(|first| {
                    let alone = decide(&[Comparison::new(&print, first)], correlate);
                    alone.certain && alone.shift == [0, 0]
                })
            };
            let certain = (found.certain && inner.1.certain) || by_first();
            let shift = [0, 1].map(|a| carried[a] + found.shift[a]);
            let decision = Decision { shift, certain };
            out[index] = Some(Settled { decision, turned, is_half_off });
            if turned.is_none() && (!detection.is_tentative || (certain && !is_half_off)) {
                inner = (Some(print), decision);
            }
        }
    }
    out
}
