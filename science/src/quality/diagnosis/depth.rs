//! Findings on coverage in depth: `range_too_short_near`, `range_too_short_far`, `coverage_gap`, `uneven_step`,
//! `redundant_slices`.

use super::{Diagnoser, note, warning};
use crate::types::{WarningCode, metrics::Finding};

impl Diagnoser<'_> {
    pub(super) fn range(&self) -> Vec<Finding> {
        let focus = &self.quality.focus;
        let last = self.quality.slices.len().saturating_sub(1) as u32;
        let mut findings = Vec::new();
        // the peak at an end is estimated from three slices, which are at most a quarter of the stack apart
        let pairs = self.evidence.own.len();
        let compared = pairs.min(2 * (pairs / 4).max(1));
        let in_place = |pairs: std::ops::Range<usize>| !pairs.into_iter().any(|pair| self.pair_is_off(pair));
        let taken_from = |slice: u32| {
            let contribution = self.quality.slices.get(slice as usize).and_then(|slice| slice.contribution);
            100.0 * contribution.unwrap_or(0.0)
        };
        if focus.range_too_short_near == Some(true) && in_place(0..compared) {
            let detail = format!(
                "the stack starts inside the object: {:.1} % of the textured pixels are taken from slice {}, and for a \
                 considerable part of them the focus lies before it; start the stack some steps earlier",
                taken_from(0),
                self.name(0)
            );
            findings.push(warning(WarningCode::RangeTooShortNear, vec![0], detail));
        }
        if focus.range_too_short_far == Some(true) && in_place(pairs - compared..pairs) {
            let detail = format!(
                "the stack ends inside the object: {:.1} % of the textured pixels are taken from slice {}, and for a \
                 considerable part of them the focus lies after it; end the stack some steps later",
                taken_from(last),
                self.name(last)
            );
            findings.push(warning(WarningCode::RangeTooShortFar, vec![last], detail));
        }
        findings
    }

    /// Steps that are larger than the depth of field, and steps that are larger than the others.
    pub(super) fn steps(&self) -> Vec<Finding> {
        let focus = &self.quality.focus;
        let mut findings = Vec::new();
        let is_step = |first: usize| !self.pair_is_duplicated(first) && !self.pair_shows_other_texture(first);
        let of_steps =
            |firsts: &[u32]| -> Vec<u32> { firsts.iter().copied().filter(|&n| is_step(n as usize)).collect() };
        let gaps = of_steps(&focus.coverage_gaps);
        if !gaps.is_empty() {
            let detail = format!(
                "between slices {} focus moves farther than the depth of field, and what lies between is sharp in no slice; \
                 make the step smaller, or check whether slices are missing",
                Self::pairs(&gaps)
            );
            findings.push(warning(WarningCode::CoverageGap, both_of(&gaps), detail));
        }
        let uneven: Vec<u32> = of_steps(&focus.uneven_steps).into_iter().filter(|n| !gaps.contains(n)).collect();
        if !uneven.is_empty() {
            let times = uneven.iter().filter_map(|&n| self.evidence.steps.get(n as usize).copied().flatten());
            let (about, missing) = if uneven.len() == 1 { ("about", "a slice is") } else { ("up to", "slices are") };
            let detail = format!(
                "between slices {} focus moves {about} {:.1} times as far as usual in this stack: {missing} missing, \
                 or the rail slipped; check the files and the rail",
                Self::pairs(&uneven),
                times.fold(0.0, f32::max)
            );
            findings.push(warning(WarningCode::UnevenStep, both_of(&uneven), detail));
        }
        findings
    }

    pub(super) fn redundant(&self) -> Option<Finding> {
        let redundant = &self.quality.focus.redundant_slices;
        let redundant: Vec<u32> = redundant.iter().copied().filter(|&n| !self.is_duplicated(n as usize)).collect();
        (!redundant.is_empty()).then(|| {
            let detail = format!(
                "almost no pixel is taken from {}: the object has nothing at that depth, or the step is finer than needed; \
                 a larger step gives the same image",
                self.named(&redundant)
            );
            note(WarningCode::RedundantSlices, redundant, detail)
        })
    }
}

/// Both slices of each pair of neighbours, by the first slice of each pair in ascending order; without repetition.
fn both_of(firsts: &[u32]) -> Vec<u32> {
    let mut slices: Vec<u32> = firsts.iter().flat_map(|&first| [first, first + 1]).collect();
    slices.dedup();
    slices
}
