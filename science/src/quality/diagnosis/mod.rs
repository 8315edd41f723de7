//! Diagnosis: the findings of a stack, as sentences for the person who runs the rig.
//!
//! Input: the metrics of a stack and the [`Evidence`] that the contract does not show. Output: findings, warnings
//! first. Each sentence names what is wrong, where, and what to do. Thresholds and their reasons: `docs/FINDINGS.md`.
//!
//! One fault changes many numbers. A consequence of a fault that is already reported is not reported again: a stack
//! whose slices are out of order gets no findings on alignment, depth or brightness. Where the image jumps, a pixel
//! shows another part of the object before and after, so that neither focus nor brightness can be compared. Beside a
//! slice of another view, focus means nothing.

mod brightness;
mod depth;
mod displacement;
mod geometry;
mod image;
mod order;

pub use geometry::is_misfit;

use super::{alignment::OwnShift, stack_quality::StackQuality};
use crate::types::{
    WarningCode,
    metrics::{Finding, Severity},
};

/// What the findings rest on besides the published metrics.
pub(super) struct Evidence<'a> {
    /// Per pair of neighbours: the shift that the common similarity does not explain.
    pub(super) own: &'a [Option<OwnShift>],
    /// The slices that show another view or another object.
    pub(super) foreign: &'a [u32],
    /// Per pair of neighbours: how far focus moves, in units of the median step.
    pub(super) steps: &'a [Option<f32>],
    /// Per slice: brightness relative to the reference slice, after the gains.
    pub(super) equalised: &'a [Option<f64>],
    /// Index of the reference slice.
    pub(super) reference: usize,
    /// The profile has gains: that of some slice is not 1.
    pub(super) has_gains: bool,
    /// A mask restricts the metrics to the object.
    pub(super) masked: bool,
    /// The slices run in the opposite direction to the profile.
    pub(super) reversed: bool,
    /// Width and height of the canvas, px.
    pub(super) canvas: (usize, usize),
}

/// All findings of a stack, warnings first.
pub(super) fn diagnose(quality: &StackQuality, evidence: &Evidence<'_>) -> Vec<Finding> {
    let diagnoser = Diagnoser { quality, evidence };
    let mut findings = diagnoser.duplicates();
    if let Some(foreign) = diagnoser.foreign() {
        findings.push(foreign);
        findings.extend(diagnoser.profile_misfit());
        findings.extend(diagnoser.brightness());
    } else if let Some(disorder) = diagnoser.reversed().or_else(|| diagnoser.out_of_order()) {
        findings.push(disorder);
    } else {
        findings.extend(diagnoser.profile_misfit().or_else(|| diagnoser.alignment_not_measured()));
        findings.extend(diagnoser.shifted_slices());
        if !diagnoser.shows_other_parts() {
            findings.extend(diagnoser.range());
            findings.extend(diagnoser.steps());
            findings.extend(diagnoser.brightness());
            findings.extend(diagnoser.redundant());
        }
    }
    findings.extend(diagnoser.image());
    findings.sort_by_key(|finding| finding.severity);
    findings
}

struct Diagnoser<'a> {
    quality: &'a StackQuality,
    evidence: &'a Evidence<'a>,
}

fn warning(code: WarningCode, slices: Vec<u32>, detail: String) -> Finding {
    Finding { code, severity: Severity::Warning, detail, slices }
}

fn note(code: WarningCode, slices: Vec<u32>, detail: String) -> Finding {
    Finding { severity: Severity::Note, ..warning(code, slices, detail) }
}

/// At most this many slices, or pairs of slices, are named in one sentence.
const MOST_NAMED: usize = 6;

impl Diagnoser<'_> {
    /// `3 ('a.jpg')`, or `3` when the slice has no name.
    fn name(&self, slice: u32) -> String {
        let slices = &self.quality.slices;
        match slices.get(slice as usize).map(|slice| slice.name.as_str()).filter(|name| !name.is_empty()) {
            Some(name) => format!("{slice} ('{name}')"),
            None => slice.to_string(),
        }
    }

    /// `slice 3 ('a.jpg')`, `slices 3 ('a.jpg') and 4 ('b.jpg')`, or the first few and the number of the others.
    fn named(&self, slices: &[u32]) -> String {
        let names: Vec<String> = slices.iter().take(MOST_NAMED).map(|&slice| self.name(slice)).collect();
        let more = slices.len().saturating_sub(MOST_NAMED);
        match &names[..] {
            [] => "no slice".to_owned(),
            [one] => format!("slice {one}"),
            all if more > 0 => format!("slices {} and {more} more", all.join(", ")),
            [first @ .., last] => format!("slices {} and {last}", first.join(", ")),
        }
    }

    /// The pairs of neighbours that begin with `firsts`, as `3 and 4`.
    fn pairs(firsts: &[u32]) -> String {
        let pairs: Vec<String> = firsts.iter().take(MOST_NAMED).map(|n| format!("{n} and {}", n + 1)).collect();
        let more = firsts.len().saturating_sub(MOST_NAMED);
        if more > 0 { format!("{}, and {more} more", pairs.join(", ")) } else { pairs.join(", ") }
    }

    /// Whether `slice` is a duplicate, or has one.
    fn is_duplicated(&self, slice: usize) -> bool {
        let original = |n: usize| self.quality.slices.get(n).and_then(|slice| slice.duplicate_of);
        original(slice).is_some() || (0..self.quality.slices.len()).any(|n| original(n) == Some(slice as u32))
    }

    /// Whether either slice of the pair that begins with `first` is duplicated.
    fn pair_is_duplicated(&self, first: usize) -> bool {
        self.is_duplicated(first) || self.is_duplicated(first + 1)
    }
}

#[cfg(test)]
mod tests;
