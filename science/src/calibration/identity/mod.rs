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
#[cfg(test)]
mod tests;

pub(super) use fingerprint::Fingerprint;

use super::detection::Detection;
use super::lattice::Label;
use shifts::{Comparison, Decision, decide};

/// How certain the labels of one slice are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Labelling {
    /// Grid steps that were added to the labels of the slice, relative to its neighbour nearer to the first slice that
    /// was detected.
    pub(super) corrected: Label,
    /// True when the labels may be wrong by whole steps.
    pub(super) ambiguous: bool,
}

/// Checks and corrects the labels of all slices. `seed` is the slice in which the grid was detected; its labels define
/// those of the others.
pub(super) fn settle(detections: &mut [Option<Detection>], seed: usize) -> Vec<Labelling> {
    let first = decisions(detections, seed, true);
    let moved = |decisions: &[Option<Decision>]| -> Vec<Option<Fingerprint>> {
        let shifted = |(d, decision): (&Option<Detection>, &Option<Decision>)| {
            let mut print = d.as_ref()?.fingerprint.clone()?;
            print.relabel(decision.as_ref()?.shift);
            Some(print)
        };
        detections.iter().zip(decisions).map(shifted).collect()
    };
    let prints = moved(&first);
    let known: Vec<&Fingerprint> = prints.iter().flatten().collect();
    let settled = if sensor::moves_with_target(&known) { first } else { decisions(detections, seed, false) };
    for (detection, decision) in detections.iter_mut().zip(&settled) {
        if let (Some(detection), Some(decision)) = (detection, decision) {
            detection.relabel(decision.shift);
        }
    }
    let unsure: Vec<bool> = settled.iter().map(|d| d.is_some_and(|d| !d.certain)).collect();
    let by_law = law::confirmed(detections, &unsure);
    let shift = |i: usize| settled[i].map_or([0, 0], |d| d.shift);
    (0..detections.len())
        .map(|i| {
            let inner = match i.cmp(&seed) {
                std::cmp::Ordering::Less => (i + 1..=seed).find(|&k| settled[k].is_some()),
                std::cmp::Ordering::Equal => None,
                std::cmp::Ordering::Greater => (seed..i).rev().find(|&k| settled[k].is_some()),
            };
            let before = inner.map_or([0, 0], shift);
            let corrected = if settled[i].is_some() { [0, 1].map(|a| shift(i)[a] - before[a]) } else { [0, 0] };
            Labelling { corrected, ambiguous: unsure[i] && !by_law[i] }
        })
        .collect()
}

/// The shift of each slice's labels, outward from `seed`; `None` where the grid was not found.
fn decisions(detections: &[Option<Detection>], seed: usize, correlate: bool) -> Vec<Option<Decision>> {
    let mut out: Vec<Option<Decision>> = vec![None; detections.len()];
    let Some(start) = detections.get(seed).and_then(Option::as_ref) else { return out };
    out[seed] = Some(Decision { shift: [0, 0], certain: true });
    let outward: [Vec<usize>; 2] = [(seed + 1..detections.len()).collect(), (0..seed).rev().collect()];
    for indices in outward {
        let mut inner = (start.fingerprint.clone(), Decision { shift: [0, 0], certain: true });
        for index in indices {
            let Some(detection) = &detections[index] else { continue };
            if detection.identity.is_some() {
                // the code of the target has identified its dots
                let decision = Decision { shift: [0, 0], certain: true };
                out[index] = Some(decision);
                inner = (detection.fingerprint.clone(), decision);
                continue;
            }
            // the slice was tracked from its neighbour, so it shares the error of its labels
            let carried = inner.1.shift;
            let mut print = detection.fingerprint.clone();
            if let Some(print) = &mut print {
                print.relabel(carried);
            }
            let compared: Vec<Comparison> = print.as_ref().map_or_else(Vec::new, |print| {
                let others = [inner.0.as_ref(), start.fingerprint.as_ref()];
                let distinct = usize::from(index.abs_diff(seed) > 1) + 1;
                others.into_iter().take(distinct).flatten().map(|other| Comparison::new(print, other)).collect()
            });
            let found = if compared.is_empty() {
                Decision { shift: [0, 0], certain: false }
            } else {
                decide(&compared, correlate)
            };
            if let Some(print) = &mut print {
                print.relabel(found.shift);
            }
            let shift = [0, 1].map(|a| carried[a] + found.shift[a]);
            // a chain is as certain as its weakest link, except where the first slice itself confirms the slice
            let by_start = print.as_ref().zip(start.fingerprint.as_ref()).is_some_and(|(print, start)| {
                let confirmed = decide(&[Comparison::new(print, start)], correlate);
                confirmed.certain && confirmed.shift == [0, 0]
            });
            let decision = Decision { shift, certain: by_start || (found.certain && inner.1.certain) };
            out[index] = Some(decision);
            inner = (print, decision);
        }
    }
    out
}
