//! Findings about the identity of the dots.

use super::super::findings::{Facts, list};
use super::super::grade::Finding;
use crate::types::report::Grade;

/// Slices whose labels may be wrong by whole steps.
pub(in super::super) fn findings(facts: &Facts) -> Option<Finding> {
    let labelling = &facts.tracked.labelling;
    let ambiguous: Vec<usize> = (0..labelling.len()).filter(|&i| labelling[i].ambiguous).collect();
    if ambiguous.is_empty() {
        return None;
    }
    let detail = format!(
        "the grid looks the same after a shift by one pitch ({:.0} px), and nothing in the image tells such shifts apart \
         in {}: let an edge or a mark of the target be in view, or use a target with a code",
        facts.tracked.detections[facts.solution.reference].as_ref().map_or(0.0, |d| d.pitch),
        list(facts.slices, &ambiguous)
    );
    Some(Finding::limiting(Grade::Usable, "shift_ambiguous", detail))
}
