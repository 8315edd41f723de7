//! Findings about the dots: which slices were not measured, and which are uncertain.

use super::facts::Facts;
use crate::calibration::grade::{Finding, GOOD};
use crate::calibration::lost::{self, Loss};
use crate::types::{WarningCode, report::Grade};

/// Perspective (relative change of scale over the image) beyond which the centre of a disc's image differs from the
/// image of its centre.
const PERSPECTIVE: f64 = 1e-3;

/// Slices whose labels may be wrong by whole steps.
pub(super) fn ambiguous_labels(facts: &Facts) -> Option<Finding> {
    let names = facts.names_where(|i| facts.tracked.labelling[i].ambiguous)?;
    let detail = format!(
        "the grid looks the same after a shift by one pitch ({:.0} px), and nothing in the image tells such shifts apart \
         in {names}: let an edge or a mark of the target be in view, or use a target with a code",
        facts.base().map_or(0.0, |d| d.pitch)
    );
    Some(Finding::limiting(Grade::Usable, WarningCode::ShiftAmbiguous, detail))
}

/// The other findings about the dots.
pub(super) fn findings(facts: &Facts) -> Vec<Finding> {
    let predicted = lost::ALL.into_iter().filter_map(|cause| predicted(facts, cause));
    let others = [inverted(facts), uncertain_corners(facts), many_outliers(facts), perspective(facts)];
    predicted.chain(others.into_iter().flatten()).collect()
}

/// Slices that were predicted because of `cause`.
fn predicted(facts: &Facts, cause: Loss) -> Option<Finding> {
    let some = facts.slices_where(|i| facts.profile[i].interpolated && Loss::of(facts.tracked, i) == cause);
    let [is, was] = match some.len() {
        0 => return None,
        1 => ["is", "was"],
        _ => ["are", "were"],
    };
    let detail = format!(
        "{} {is} {}, and {was} predicted from the other slices; {}",
        facts.names(&some),
        cause.phrase(),
        cause.advice()
    );
    let allows = if matches!(cause, Loss::Other | Loss::Striped) { Grade::Usable } else { Grade::Good };
    Some(Finding::limiting(allows, WarningCode::SliceInterpolated, detail))
}

fn inverted(facts: &Facts) -> Option<Finding> {
    let names = facts.names_where(|i| facts.detection(i).is_some_and(|s| s.modulation < 0.0))?;
    let detail = format!(
        "blur has inverted the dots in {names}: they were measured, but a target with more widely spaced dots is better"
    );
    Some(Finding::remark(WarningCode::DotsInverted, detail))
}

fn uncertain_corners(facts: &Facts) -> Option<Finding> {
    let is_unsure = |i: usize| {
        let slice = &facts.profile[i];
        !slice.interpolated && slice.corner_sigma_px.is_some_and(|sigma| sigma > GOOD)
    };
    let names = facts.names_where(is_unsure)?;
    let detail = format!(
        "the image corners are uncertain by more than {GOOD} px in {names}: use a target that fills the image, or larger \
         dots"
    );
    Some(Finding::remark(WarningCode::UncertainCorners, detail))
}

fn many_outliers(facts: &Facts) -> Option<Finding> {
    let base = facts.base()?;
    let has_many = |i: usize| {
        let (Some(inliers), Some(slice)) = (facts.profile[i].inliers, facts.detection(i)) else { return false };
        let shared = slice.dots.keys().filter(|label| base.dots.contains_key(*label)).count();
        !facts.profile[i].interpolated && i != facts.solution.reference && 4 * (inliers as usize) < 3 * shared
    };
    let names = facts.names_where(has_many)?;
    let detail = format!(
        "more than a quarter of the dots disagree with the homography in {names}: check the target for dust, reflections \
         and bending"
    );
    Some(Finding::limiting(Grade::Usable, WarningCode::ManyOutliers, detail))
}

fn perspective(facts: &Facts) -> Option<Finding> {
    let is_tilted = |i: usize| {
        let h = facts.profile[i].homography.0;
        (h[6] * facts.tracked.width as f64).abs() > PERSPECTIVE
            || (h[7] * facts.tracked.height as f64).abs() > PERSPECTIVE
    };
    let names = facts.names_where(is_tilted)?;
    let detail = format!(
        "the perspective changes in {names}: align the rail with the optical axis, and check that camera and target did \
         not rotate"
    );
    Some(Finding::remark(WarningCode::Perspective, detail))
}
