//! Findings about the target in the reference slice.

use super::facts::Facts;
use crate::calibration::{detection::grid_steps, grade::Finding, lattice::Places, statistics::range, tracked::Tracked};
use crate::types::WarningCode;

/// Share of the image that the dots cover, below which the target is small.
const SMALL: f64 = 0.25;
/// Stretch of the grid from which a tilted target is reported: 1 / cos(12 degrees).
const ASLANT: f64 = 1.022;
/// Blur radius in the reference slice, grid steps, from which it is reported.
const BLURRED: f64 = 0.3;

/// The findings about the target, about lateral colour of the lens, and about blur of the reference slice.
pub(super) fn findings(facts: &Facts) -> Vec<Finding> {
    let Some(base) = facts.base() else { return Vec::new() };
    let mut out = Vec::new();
    let share = coverage(facts.tracked, facts.solution.reference);
    if share < SMALL {
        let detail = format!(
            "the dots cover {:.0} % of the reference slice: the corners are extrapolated; use a larger target",
            100.0 * share
        );
        out.push(Finding::remark(WarningCode::SmallTarget, detail));
    }
    if let Some(stretch) = stretch(&base.places).filter(|s| *s > ASLANT) {
        let detail = format!(
            "the grid is stretched by {:.1} %, as if the target were tilted by about {:.0} degrees: set it square to the lens",
            100.0 * (stretch - 1.0),
            (1.0 / stretch).acos().to_degrees()
        );
        out.push(Finding::remark(WarningCode::TargetAslant, detail));
    }
    let [width, height] = facts.tracked.size();
    if let Some(colours) = facts.tracked.colours.and_then(|measured| measured.worth_correcting(width, height)) {
        let [red, blue] = [colours.red, colours.blue].map(|colour| colour.max_displacement_px(width, height));
        let detail = format!(
            "the lens has lateral colour: relative to green, the image corners are displaced in red by {red:.1} px and in \
             blue by {blue:.1} px; the profile keeps it, and fusion moves red and blue to where green is, unless a stack \
             is sent with lateral_colour=keep"
        );
        out.push(Finding::remark(WarningCode::LateralColour, detail));
    }
    if facts.blurs[facts.solution.reference].is_some_and(|blur| blur > BLURRED) {
        let detail = "the target is blurred in the reference slice, on which all others depend: move the target to where \
                      the reference slice is in focus, or set reference_index to a sharper slice";
        out.push(Finding::remark(WarningCode::BlurredReference, detail));
    }
    out
}

/// Share of the image inside the dots' bounding box.
pub(in crate::calibration) fn coverage(tracked: &Tracked, reference: usize) -> f64 {
    let Some(detection) = tracked.detections[reference].as_ref() else { return 0.0 };
    let span = |axis: usize| {
        let (low, high) = range(detection.dots.values().map(|d| d.at[axis]));
        (high - low).max(0.0)
    };
    span(0) * span(1) / (tracked.width * tracked.height) as f64
}

/// Ratio of the singular values of the map from the grid to the image; 1 for a square grid seen square on.
fn stretch(places: &Places) -> Option<f64> {
    let steps = grid_steps(places);
    let [[a, c], [b, d]] = steps;
    let (sum, twist) = (a * a + b * b + c * c + d * d, a * d - b * c);
    let root = (sum * sum - 4.0 * twist * twist).max(0.0).sqrt();
    let (large, small) = (((sum + root) / 2.0).sqrt(), ((sum - root) / 2.0).max(0.0).sqrt());
    (small > 0.0).then(|| large / small)
}
