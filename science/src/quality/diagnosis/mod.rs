//! What the numbers mean, in sentences for the person at the rig. Thresholds and their reasons: `docs/METRICS.md`.
//!
//! One fault upsets many numbers. What follows from a fault that is already named is not named again.

use super::{StackQuality, alignment::OwnShift};
use crate::types::metrics::{Finding, Severity};

/// Brightness off that of the slices around by more than this flickers.
const FLICKER: f64 = 0.03;
/// Brightness after the gains off that of the reference slice by more than this drifts; colour likewise.
const DRIFT: f64 = 0.03;
const BALANCE: f64 = 0.03;
/// A profile that leaves less than this in the corners, from the first slice to the last, fits, px ...
const MISFIT_PX: f64 = 1.0;
/// ... and one is not accused on less than this many deviations.
const MISFIT_SIGMAS: f64 = 4.0;
/// A slice that is off by less than this is not misaligned, px; nor on less than so many deviations.
const MISALIGNED_PX: f64 = 0.75;
const MISALIGNED_SIGMAS: f64 = 4.0;
/// Share of the fused picture at full scale or zero.
const CLIPPED: f64 = 0.005;
/// Mean distance from the range of the slices, grey levels.
const HALO_LEVELS: f64 = 1.0;
/// Share of the canvas that every slice covers.
const COMMON: f64 = 0.9;
/// Share of the object in one unfocused part.
const UNFOCUSED: f64 = 0.25;
/// Share of pixels with texture under which little can be said.
const TEXTURED: f64 = 0.01;

/// What the findings rest on that the contract does not show.
pub(super) struct Evidence<'a> {
    /// Per pair of neighbours.
    pub(super) own: &'a [Option<OwnShift>],
    /// Per pair of neighbours: how far focus moves, in usual steps.
    pub(super) steps: &'a [Option<f32>],
    /// Per slice: brightness over that of the reference slice, after the gains.
    pub(super) evened: &'a [Option<f64>],
    /// The slices run the other way than the profile.
    pub(super) reversed: bool,
}

/// Everything that is to be said of a stack, warnings first.
pub(super) fn diagnose(quality: &StackQuality, evidence: &Evidence<'_>) -> Vec<Finding> {
    let diagnoser = Diagnoser { quality, evidence };
    let mut findings = diagnoser.duplicates();
    let disorder = diagnoser.reversed().or_else(|| diagnoser.disorder());
    let in_order = disorder.is_none();
    findings.extend(disorder);
    if in_order {
        findings.extend(diagnoser.alignment());
        findings.extend(diagnoser.range());
        findings.extend(diagnoser.gaps());
        findings.extend(diagnoser.brightness());
        findings.extend(diagnoser.redundant());
    }
    findings.extend(diagnoser.picture());
    findings.sort_by_key(|finding| finding.severity);
    findings
}

struct Diagnoser<'a> {
    quality: &'a StackQuality,
    evidence: &'a Evidence<'a>,
}

fn warning(code: &str, slices: Vec<u32>, detail: String) -> Finding {
    Finding { code: code.to_owned(), severity: Severity::Warning, detail, slices }
}

fn note(code: &str, slices: Vec<u32>, detail: String) -> Finding {
    Finding { severity: Severity::Note, ..warning(code, slices, detail) }
}

impl Diagnoser<'_> {
    fn name(&self, slice: u32) -> String {
        let slices = &self.quality.slices;
        match slices.get(slice as usize).map(|slice| slice.name.as_str()).filter(|name| !name.is_empty()) {
            Some(name) => format!("{slice} ('{name}')"),
            None => slice.to_string(),
        }
    }

    /// `slice 3 ('a.jpg')`, `slices 3 ('a.jpg') and 4 ('b.jpg')`; of very many the first.
    fn named(&self, slices: &[u32]) -> String {
        const MOST: usize = 6;
        let names: Vec<String> = slices.iter().take(MOST).map(|&slice| self.name(slice)).collect();
        let more = slices.len().saturating_sub(MOST);
        match &names[..] {
            [] => "no slice".to_owned(),
            [one] => format!("slice {one}"),
            all if more > 0 => format!("slices {} and {more} more", all.join(", ")),
            [first @ .., last] => format!("slices {} and {last}", first.join(", ")),
        }
    }

    /// The pairs that begin with `firsts`, as `3 and 4`.
    fn pairs(firsts: &[u32]) -> String {
        let pairs: Vec<String> = firsts.iter().take(6).map(|n| format!("{n} and {}", n + 1)).collect();
        let more = firsts.len().saturating_sub(6);
        if more > 0 { format!("{}, and {more} more", pairs.join(", ")) } else { pairs.join(", ") }
    }

    fn is_double(&self, slice: usize) -> bool {
        let of = |n: usize| self.quality.slices.get(n).and_then(|slice| slice.duplicate_of);
        of(slice).is_some() || (0..self.quality.slices.len()).any(|n| of(n) == Some(slice as u32))
    }

    fn beside_double(&self, first: usize) -> bool {
        self.is_double(first) || self.is_double(first + 1)
    }

    fn duplicates(&self) -> Vec<Finding> {
        let doubles = self.quality.slices.iter().filter_map(|slice| Some((slice.index, slice.duplicate_of?)));
        let told = doubles.map(|(slice, original)| {
            let detail = format!(
                "slice {} is the same picture as slice {}: one was uploaded twice, or copied over another; put the right \
                 file in its place",
                self.name(slice),
                self.name(original)
            );
            warning("duplicate_slice", vec![original, slice], detail)
        });
        told.collect()
    }

    fn disorder(&self) -> Option<Finding> {
        let order = self.quality.focus.order.as_ref()?;
        let misplaced = out_of_place(order);
        let detail = format!(
            "{} stand out of the order of focus: there the object gets sharp, unsharp and sharp again; look at how the files \
             are numbered and sorted, or name the order in manifest.json. The profile moved each as if it stood at its place",
            self.named(&misplaced)
        );
        Some(warning("slices_out_of_order", misplaced, detail))
    }

    fn alignment(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        if let Some(left) = &self.quality.alignment.similarity {
            let (drift, sigma) = (left.corner_drift_px, left.corner_drift_sigma_px);
            if drift > MISFIT_PX.max(MISFIT_SIGMAS * sigma) {
                let steps = self.quality.slices.len().saturating_sub(1) as f64;
                let detail = format!(
                    "this profile does not fit the stack: from the first slice to the last the corners of the picture are \
                     {drift:.1} px (give or take {:.1}) off (scale {:+.3} %, rotation {:+.3} degrees, shift {:.1}, \
                     {:.1} px); calibrate again. Likely causes: lens, aperture, focus ring or rail were touched since \
                     the calibration, or the stack is of another rig or lens",
                    2.0 * sigma,
                    100.0 * (left.scale.powf(steps) - 1.0),
                    left.rotation_deg * steps,
                    left.shift_px[0] * steps,
                    left.shift_px[1] * steps,
                );
                findings.push(warning("profile_misfit", Vec::new(), detail));
            }
        }
        findings.extend(self.moved());
        findings
    }

    /// The slices run the other way than the profile. What is said of focus, place and brightness would follow from that.
    fn reversed(&self) -> Option<Finding> {
        let left = self.quality.alignment.similarity.as_ref().filter(|_| self.evidence.reversed)?;
        let (drift, sigma) = (left.corner_drift_px, left.corner_drift_sigma_px);
        if drift <= MISFIT_PX.max(MISFIT_SIGMAS * sigma) {
            return None;
        }
        let last = self.quality.slices.len().saturating_sub(1) as u32;
        let detail = format!(
            "the stack runs the other way than the profile: slice {} belongs to the end of the rail where slice {} \
             stands, and the corners of the picture are {drift:.1} px off; send it again with order=reverse (or without, \
             if it was sent with it). The calibration need not be repeated",
            self.name(0),
            self.name(last)
        );
        Some(warning("slices_reversed", Vec::new(), detail))
    }

    /// Slices that are off though their neighbours are not, and places from where all are.
    fn moved(&self) -> Vec<Finding> {
        let off = |pair: usize| {
            let own = (*self.evidence.own.get(pair)?)?;
            let length = own.shift.0.hypot(own.shift.1);
            let sure = length > MISALIGNED_PX.max(MISALIGNED_SIGMAS * own.sigma) && !self.beside_double(pair);
            sure.then_some((own.shift, length))
        };
        let pairs = self.evidence.own.len();
        let (mut findings, mut pair) = (Vec::new(), 0);
        while pair < pairs {
            let Some((shift, length)) = off(pair) else {
                pair += 1;
                continue;
            };
            let slice = pair as u32 + 1;
            // away and back: one slice; away: all from there on
            let back = off(pair + 1).is_some_and(|(next, _)| (shift.0 + next.0).hypot(shift.1 + next.1) < 0.5 * length);
            let last = pair + 1 == pairs;
            let first = pair == 0 && !back;
            if back || last || first {
                let slice = if first && !last { 0 } else { slice };
                let detail = format!(
                    "slice {} is {length:.1} px off its neighbours ({:+.1}, {:+.1}): the rig was shaken or knocked there; \
                     take the stack again, or calibrate again if it is so in every stack",
                    self.name(slice),
                    shift.0,
                    shift.1
                );
                findings.push(warning("slice_misaligned", vec![slice], detail));
            } else {
                let detail = format!(
                    "from slice {} on the picture has moved by {length:.1} px ({:+.1}, {:+.1}): the rig or the object was \
                     knocked while the stack was taken; take it again",
                    self.name(slice),
                    shift.0,
                    shift.1
                );
                findings.push(warning("picture_jumps", vec![slice - 1, slice], detail));
            }
            pair += if back { 2 } else { 1 };
        }
        findings
    }

    fn range(&self) -> Vec<Finding> {
        let focus = &self.quality.focus;
        let last = self.quality.slices.len().saturating_sub(1) as u32;
        let ends = [
            (
                focus.range_too_short_near,
                focus.peak_at_first_fraction,
                "range_too_short_near",
                0,
                "starts",
                "before",
                "earlier",
            ),
            (
                focus.range_too_short_far,
                focus.peak_at_last_fraction,
                "range_too_short_far",
                last,
                "ends",
                "behind",
                "later",
            ),
        ];
        let told = ends.into_iter().filter(|end| end.0 == Some(true)).map(|(_, share, code, slice, verb, side, when)| {
            let detail = format!(
                "the stack {verb} inside the object: {:.1} % of what has texture is sharpest in slice {} and would be sharper \
                 {side} it; {verb_short} the stack some steps {when}",
                100.0 * share.unwrap_or(0.0),
                self.name(slice),
                verb_short = verb.trim_end_matches('s'),
            );
            warning(code, vec![slice], detail)
        });
        told.collect()
    }

    fn gaps(&self) -> Vec<Finding> {
        let focus = &self.quality.focus;
        let mut findings = Vec::new();
        let clean = |firsts: &[u32]| -> Vec<u32> {
            firsts.iter().copied().filter(|&n| !self.beside_double(n as usize)).collect()
        };
        let gaps = clean(&focus.coverage_gaps);
        if !gaps.is_empty() {
            let detail = format!(
                "between slices {} focus moves farther than the depth of field reaches, and what lies between is sharp in none; \
                 make the step smaller, or see whether slices are missing there",
                Self::pairs(&gaps)
            );
            findings.push(warning("coverage_gap", gaps.clone(), detail));
        }
        let uneven: Vec<u32> = clean(&focus.uneven_steps).into_iter().filter(|n| !gaps.contains(n)).collect();
        if !uneven.is_empty() {
            let times = uneven.iter().filter_map(|&n| self.evidence.steps.get(n as usize).copied().flatten());
            let detail = format!(
                "between slices {} focus moves about {:.1} times as far as between the others: a slice is missing there, or the \
                 rail slipped",
                Self::pairs(&uneven),
                times.fold(0.0, f32::max)
            );
            findings.push(warning("uneven_step", uneven, detail));
        }
        findings
    }

    fn brightness(&self) -> Vec<Finding> {
        let slices = &self.quality.slices;
        let mut findings = Vec::new();
        let off = |ratio: Option<f64>| ratio.map_or(0.0, |ratio| ratio - 1.0);
        let flickering: Vec<u32> =
            slices.iter().filter(|slice| off(slice.flicker_ratio).abs() > FLICKER).map(|slice| slice.index).collect();
        if !flickering.is_empty() {
            let most = slices
                .iter()
                .map(|slice| off(slice.flicker_ratio))
                .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let detail = format!(
                "{} differ in brightness from those around by up to {:+.0} %: the light or the shutter flickers; use constant \
                 light, manual exposure and a fixed aperture",
                self.named(&flickering),
                100.0 * most
            );
            findings.push(warning("exposure_flicker", flickering.clone(), detail));
        }
        let steady = |n: &usize| !flickering.contains(&(*n as u32));
        let evened = (0..self.evidence.evened.len()).filter(steady).filter_map(|n| self.evidence.evened[n]);
        let drift = evened.map(|ratio| ratio - 1.0).fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
        if drift.abs() > DRIFT && slices.len() > 2 {
            let detail = format!(
                "after the gains of the profile the brightness still drifts by up to {:+.0} % against the reference slice: \
                 calibrate again, so that the gains fit, and let the lamps warm up",
                100.0 * drift
            );
            findings.push(warning("exposure_drift", Vec::new(), detail));
        }
        let colours = |slice: &u32| {
            slices[*slice as usize].balance_ratio.is_some_and(|b| b.iter().any(|r| (r - 1.0).abs() > BALANCE))
        };
        let coloured: Vec<u32> = (0..slices.len() as u32).filter(colours).collect();
        if !coloured.is_empty() {
            let detail = format!(
                "{} differ in colour from the reference slice by more than {:.0} %: set the white balance by hand, and let the \
                 lamps warm up",
                self.named(&coloured),
                100.0 * BALANCE
            );
            findings.push(warning("white_balance_drift", coloured, detail));
        }
        findings
    }

    fn redundant(&self) -> Option<Finding> {
        let redundant = &self.quality.focus.redundant_slices;
        let alone: Vec<u32> = redundant.iter().copied().filter(|&n| !self.is_double(n as usize)).collect();
        (!alone.is_empty()).then(|| {
            let detail = format!(
                "hardly any pixel comes from {}: the object has nothing at that depth, or the step is finer than it needs to be",
                self.named(&alone)
            );
            note("redundant_slices", alone, detail)
        })
    }

    fn picture(&self) -> Vec<Finding> {
        let StackQuality { fusion, focus, alignment, .. } = self.quality;
        let mut findings = Vec::new();
        let percent = |share: f64| 100.0 * share;
        if let Some(share) = fusion.clipped_fraction.filter(|share| *share > CLIPPED) {
            let detail = format!(
                "{:.1} % of the picture is at full scale or black: detail is lost there in every slice; change the exposure, or \
                 soften the light",
                percent(share)
            );
            findings.push(warning("clipped", Vec::new(), detail));
        }
        if let Some(levels) = fusion.overshoot_levels.filter(|levels| *levels > HALO_LEVELS) {
            let detail = format!(
                "the fused picture leaves the range of the slices by {levels:.1} grey levels in the mean: look for halos at \
                 edges, and try smaller filters"
            );
            findings.push(note("halos", Vec::new(), detail));
        }
        if let Some(area) = focus.unfocused_area.filter(|area| area.fraction > UNFOCUSED) {
            let detail = format!(
                "{:.0} % of the object in one piece ({} x {} px at {}, {}) shows no texture in any slice: it is smooth, or never \
                 in focus",
                percent(area.fraction),
                area.width,
                area.height,
                area.x,
                area.y
            );
            findings.push(note("unfocused_area", Vec::new(), detail));
        }
        if let Some(share) = alignment.common_fraction.filter(|share| *share < COMMON) {
            let detail = format!(
                "only {:.0} % of the picture is covered by every slice: near the border fewer slices are there to choose from; \
                 keep the object in the middle, or use crop=valid",
                percent(share)
            );
            findings.push(note("small_common_area", Vec::new(), detail));
        }
        if let Some(share) = focus.textured_fraction.filter(|share| *share < TEXTURED) {
            let detail = format!(
                "only {:.2} % of the picture has texture: what these numbers say of focus and of the profile rests on little",
                percent(share)
            );
            findings.push(note("little_texture", Vec::new(), detail));
        }
        findings
    }
}

/// The fewest slices that explain the order: those whose removal leaves the others rising (or falling), or those that do
/// not stand at their place, if these are not more.
fn out_of_place(order: &[u32]) -> Vec<u32> {
    let longest = |values: &[i64]| -> Vec<i64> {
        let mut best: Vec<Vec<i64>> = Vec::with_capacity(values.len());
        for (i, &value) in values.iter().enumerate() {
            let before = best[..i].iter().filter(|run| run.last().is_some_and(|&last| last < value));
            let mut run = before.max_by_key(|run| run.len()).cloned().unwrap_or_default();
            run.push(value);
            best.push(run);
        }
        best.into_iter().max_by_key(Vec::len).unwrap_or_default()
    };
    let rising: Vec<i64> = order.iter().map(|&n| i64::from(n)).collect();
    let falling: Vec<i64> = rising.iter().map(|n| -n).collect();
    let (up, down) = (longest(&rising), longest(&falling));
    let kept: Vec<i64> = if up.len() >= down.len() { up } else { down.into_iter().map(|n| -n).collect() };
    let mut odd: Vec<u32> = order.iter().copied().filter(|&n| !kept.contains(&i64::from(n))).collect();
    odd.sort_unstable();
    // two that changed places are two, though three stand out of any run
    let displaced: Vec<u32> =
        (0..).zip(order).filter(|(place, slice)| place != *slice).map(|(place, _)| place).collect();
    if displaced.len() <= odd.len() { displaced } else { odd }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slices_out_of_place_are_the_fewest_that_explain_the_order() {
        assert_eq!(out_of_place(&[0, 1, 2, 4, 3, 5]).len(), 1);
        assert_eq!(out_of_place(&[0, 1, 4, 3, 2, 5]), [2, 4]);
        assert_eq!(out_of_place(&[0, 7, 1, 2, 3, 4, 5, 6]), [7]);
        assert_eq!(out_of_place(&[5, 4, 3, 0, 2, 1]), [0]);
        assert_eq!(out_of_place(&[0, 1, 2]), [0; 0]);
    }
}
