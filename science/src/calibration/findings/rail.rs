//! Findings about the rail and the rig.

use super::facts::Facts;
use crate::calibration::rail_anomalies::{Jump, RailAnomaly};
use crate::calibration::{capture, grade::Finding, names::first_names};
use crate::types::{Homography, WarningCode, report::Grade};

/// How far the image jumps, as a predicate.
fn jumps(by: Jump) -> String {
    let px = by.shift[0].hypot(by.shift[1]);
    match (px > 0.0, by.turn != 0.0) {
        (true, true) => format!("jumps by {px:.1} px and turns by {:.2} degrees", by.turn.abs()),
        (false, true) => format!("turns by {:.2} degrees", by.turn.abs()),
        _ => format!("jumps by {px:.1} px"),
    }
}

/// Largest distance of an image corner from that of the reference slice in a stack that does not move, px; three
/// standard deviations where they are more.
const STILL: f64 = 0.1;
/// Least modulation, as a share of the strongest, in a stack whose blur does not change.
const AS_SHARP: f64 = 0.97;

/// That nothing changes from slice to slice. On a telecentric rig the image does not move, but its blur changes.
fn still(facts: &Facts) -> Option<Finding> {
    let [width, height] = facts.tracked.size();
    let strongest = facts.tracked.strongest();
    let is_still = |i: usize| {
        let (slice, detection) = (&facts.profile[i], facts.detection(i));
        let moved = slice.homography.corner_distance(&Homography::IDENTITY, width, height);
        moved < STILL.max(3.0 * slice.corner_sigma_px.unwrap_or(0.0))
            && !slice.interpolated
            && detection.is_some_and(|d| d.modulation > AS_SHARP * strongest)
    };
    let detail = "all slices show the target in the same place and equally sharp: the rail did not move, or copies of one \
                  file were sent; check the rail and the files, and take the stack again";
    let finding = || Finding::limiting(Grade::Usable, WarningCode::RailStill, detail);
    (0..facts.profile.len()).all(is_still).then(finding)
}

/// Findings about the rail and the rig.
pub(super) fn findings(facts: &Facts) -> Vec<Finding> {
    let name = |i: usize| facts.slices.name(i);
    let mut out: Vec<Finding> = facts
        .solution
        .rail
        .anomalies
        .iter()
        .map(|anomaly| match anomaly {
            RailAnomaly::Missing { after } => Finding::remark(
                WarningCode::SliceMissing,
                format!("a slice seems to be missing between {} and {}: the step between them is twice the usual one; check the rail and the files", name(*after), name(after + 1)),
            ),
            RailAnomaly::Doubled { first } => Finding::remark(
                WarningCode::SliceDoubled,
                format!("{} and {} were taken at the same rail position: remove one of them, or check whether the rail is stuck", name(*first), name(first + 1)),
            ),
            RailAnomaly::Backwards { after } => Finding::limiting(
                Grade::Usable,
                WarningCode::SlicesOutOfOrder,
                format!("the rail seems to move backwards between {} and {}: check that the files are in the order of capture", name(*after), name(after + 1)),
            ),
            RailAnomaly::Uneven { after, steps } => Finding::remark(
                WarningCode::UnevenStep,
                format!("the step between {} and {} is {steps:.2} times the usual one: check the rail for backlash or a missed step", name(*after), name(after + 1)),
            ),
            RailAnomaly::Bumped { after, from, by } => Finding::limiting(
                Grade::Usable,
                WarningCode::RigBumped,
                format!("the image {} between {} and {}: the rig was bumped or the target moved; fasten both, and calibrate again", jumps(*by), name(*after), name(*from)),
            ),
            RailAnomaly::Displaced { slice, by } => Finding::limiting(
                Grade::Usable,
                WarningCode::SliceDisplaced,
                format!("{} lies beside the line of the other slices: its image {}; its own dots were used: check the rail for backlash, and take the stack again", name(*slice), jumps(*by)),
            ),
            RailAnomaly::Different { slice } => Finding::limiting(
                Grade::Usable,
                WarningCode::SliceDisplaced,
                format!("{} is tilted, turned or stretched against the other slices; its own dots were used: fasten the target and the camera, and take the stack again", name(*slice)),
            ),
            RailAnomaly::OutOfOrder { order } => Finding::limiting(
                Grade::Usable,
                WarningCode::SlicesOutOfOrder,
                format!("by the size of the target the slices were taken in the order {} or the reverse, which is not the order of the files: rename them (a camera's counter may have started again), or check that the rail moves in one direction", first_names(facts.slices, order, 12)),
            ),
        })
        .collect();
    out.extend(still(facts));
    if let (Some(given), Some(found)) = (facts.capture.told, facts.capture.found)
        && given != found
    {
        out.push(Finding::remark(WarningCode::CaptureModeDisagrees, capture::disagreement(given, found)));
    }
    let contradictions = facts.contradictions.iter();
    out.extend(contradictions.map(|found| Finding::remark(found.code.clone(), found.detail.clone())));
    out
}
