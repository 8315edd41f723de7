//! Findings: sentences about problems, each with the slices concerned and what to do.

use super::gains::{self, MAX_SIGMA};
use super::grade::{Finding, GOOD};
use super::lattice::Places;
use super::lost::{self, Loss};
use super::rail_anomalies::{Jump, RailAnomaly};
use super::solve::Solution;
use super::tracking::Tracked;
use super::{camera, capture, identity};
use crate::imaging::Slices;
use crate::types::profile::ProfileSlice;
use crate::types::report::{CameraReport, CaptureReport, Grade};

/// Perspective (relative change of scale over the image) beyond which the centre of a disc's image differs from the
/// image of its centre.
const PERSPECTIVE: f64 = 1e-3;
/// Stretch of the grid from which a tilted target is reported: 1 / cos(12 degrees).
const ASLANT: f64 = 1.022;

/// Relative uncertainty of a gain beyond which a calibration is not good.
const POOR_GAIN: f64 = 0.01;
/// Relative deviation of the brightness or tint of a slice from which it is named.
const OUTLIER: f64 = 0.01;

/// Input of the findings.
pub(super) struct Facts<'a> {
    /// The slices, for their names.
    pub slices: &'a dyn Slices,
    /// The tracked grid.
    pub tracked: &'a Tracked,
    /// The solved stack.
    pub solution: &'a Solution,
    /// The slices of the profile.
    pub profile: &'a [ProfileSlice],
    /// Blur radii in grid steps.
    pub blurs: &'a [Option<f64>],
    /// The capture mode.
    pub capture: &'a CaptureReport,
    /// The camera.
    pub camera: &'a CameraReport,
}

/// Names of slices, at most five, as a phrase.
pub(super) fn list(slices: &dyn Slices, indices: &[usize]) -> String {
    let mut names: Vec<&str> = indices.iter().take(5).map(|&i| slices.name(i)).collect();
    let more = indices.len().saturating_sub(5);
    let rest = format!("{more} more");
    if more > 0 {
        names.push(&rest);
    }
    names.join(", ")
}

/// Names of slices in order, at most twelve, as a phrase.
fn named(slices: &dyn Slices, order: &[usize]) -> String {
    let mut names: Vec<&str> = order.iter().take(12).map(|&i| slices.name(i)).collect();
    if order.len() > names.len() {
        names.push("...");
    }
    names.join(", ")
}

/// How far the image jumps, as a predicate.
fn jumps(by: Jump) -> String {
    let px = by.shift[0].hypot(by.shift[1]);
    match (px > 0.0, by.turn != 0.0) {
        (true, true) => format!("jumps by {px:.1} px and turns by {:.2} degrees", by.turn.abs()),
        (false, true) => format!("turns by {:.2} degrees", by.turn.abs()),
        _ => format!("jumps by {px:.1} px"),
    }
}

/// All findings, the most serious first.
pub(super) fn findings(facts: &Facts) -> Vec<Finding> {
    let mut out: Vec<Finding> = identity::findings::findings(facts).into_iter().collect();
    out.extend(rail(facts));
    out.extend(light(facts));
    out.extend(dots(facts));
    out.extend(target(facts));
    // stable: findings of the same weight keep their order
    out.sort_by_key(|finding| std::cmp::Reverse(finding.allows));
    out
}

/// Findings about the rail and the rig.
fn rail(facts: &Facts) -> Vec<Finding> {
    let name = |i: usize| facts.slices.name(i);
    let mut out: Vec<Finding> = facts
        .solution
        .anomalies
        .iter()
        .map(|anomaly| match anomaly.clone() {
            RailAnomaly::Missing { after } => Finding::remark(
                "slice_missing",
                format!("a slice seems to be missing between {} and {}: the step between them is twice the usual one; check the rail and the files", name(after), name(after + 1)),
            ),
            RailAnomaly::Doubled { first } => Finding::remark(
                "slice_doubled",
                format!("{} and {} were taken at the same rail position: remove one of them, or check whether the rail is stuck", name(first), name(first + 1)),
            ),
            RailAnomaly::Backwards { after } => Finding::limiting(
                Grade::Usable,
                "slices_out_of_order",
                format!("the rail seems to move backwards between {} and {}: check that the files are in the order of capture", name(after), name(after + 1)),
            ),
            RailAnomaly::Uneven { after, steps } => Finding::remark(
                "uneven_step",
                format!("the step between {} and {} is {steps:.2} times the usual one: check the rail for backlash or a missed step", name(after), name(after + 1)),
            ),
            RailAnomaly::Bumped { after, from, by } => Finding::limiting(
                Grade::Usable,
                "rig_bumped",
                format!("the image {} between {} and {}: the rig was bumped or the target moved; fasten both, and calibrate again", jumps(by), name(after), name(from)),
            ),
            RailAnomaly::Displaced { slice, by } => Finding::limiting(
                Grade::Usable,
                "slice_displaced",
                format!("{} lies beside the line of the other slices: its image {}; its own dots were used: check the rail for backlash, and take the stack again", name(slice), jumps(by)),
            ),
            RailAnomaly::OutOfOrder { order } => Finding::limiting(
                Grade::Usable,
                "slices_out_of_order",
                format!("by the size of the target the slices were taken in the order {} or the reverse, which is not the order of the files: rename them (a camera's counter may have started again), or check that the rail moves in one direction", named(facts.slices, &order)),
            ),
        })
        .collect();
    if let (Some(given), Some(found)) = (facts.capture.told, facts.capture.found)
        && given != found
    {
        let detail = format!(
            "capture_mode specifies {}, but the slices show {}: correct the option, or check what the rail moves",
            capture::name(given),
            capture::name(found)
        );
        out.push(Finding::remark("capture_mode_disagrees", detail));
    }
    if camera::is_contradictory(facts.camera) {
        out.push(Finding::remark(
            "principal_distance_disagrees",
            format!(
                "the principal distance is {:.2} mm {}",
                facts.camera.principal_distance_mm.unwrap_or_default(),
                facts.camera.detail
            ),
        ));
    }
    out
}

fn which(facts: &Facts, test: impl Fn(usize) -> bool) -> Vec<usize> {
    (0..facts.profile.len()).filter(|&i| test(i)).collect()
}

fn light(facts: &Facts) -> Vec<Finding> {
    let mut out = Vec::new();
    let clipped = which(facts, |i| facts.tracked.detections[i].as_ref().is_some_and(|s| s.clipped > 0.05));
    if !clipped.is_empty() {
        let detail = format!(
            "the white of the target is clipped in {}: their gains are unreliable; reduce the exposure",
            list(facts.slices, &clipped)
        );
        out.push(Finding::remark("clipped_white", detail));
    }
    out.extend(exposure(facts));
    out.extend(tints(facts));
    out.extend(banding(facts));
    let sigma = |i: usize| facts.solution.slices[i].gain_sigma;
    let unsure = which(facts, |i| sigma(i) > MAX_SIGMA);
    if !unsure.is_empty() {
        let worst = unsure.iter().map(|&i| sigma(i)).fold(0.0, f64::max);
        let by = if worst < 0.5 { format!("by {:.1} %", 100.0 * worst) } else { "by 50 % or more".to_owned() };
        let detail = format!(
            "the gains are uncertain {by} in {}: use dark dots on white, evenly lit and not clipped, in raw or linear \
             images",
            list(facts.slices, &unsure)
        );
        let allows = if worst > POOR_GAIN { Grade::Usable } else { Grade::Good };
        out.push(Finding::limiting(allows, "uncertain_gains", detail));
    }
    out
}

/// Slices with another exposure than the smooth law expects. Their gains make up for it.
fn exposure(facts: &Facts) -> Option<Finding> {
    let off = |i: usize| {
        let off = facts.solution.slices[i].brightness_off_law?;
        ((off - 1.0).abs() > OUTLIER).then_some(off)
    };
    let some = which(facts, |i| off(i).is_some());
    let sizes = |i: usize| {
        let percent = 100.0 * (off(i).unwrap_or(1.0) - 1.0);
        format!(
            "{} ({:.1} % {})",
            facts.slices.name(i),
            percent.abs(),
            if percent < 0.0 { "darker" } else { "brighter" }
        )
    };
    (!some.is_empty()).then(|| {
        Finding::remark(
            "exposure_outlier",
            format!(
                "the exposure differs from what the other slices lead to expect in {}: the gains make up for it, but \
                 every stack taken with a steady lamp will then be wrong by as much; check the lamp, the flash and the \
                 exposure time, and calibrate again",
                listed(&some, sizes)
            ),
        )
    })
}

/// Slices with another tint than the others.
fn tints(facts: &Facts) -> Option<Finding> {
    let tints: Vec<Option<[f64; 2]>> =
        facts.tracked.detections.iter().map(|d| d.as_ref().and_then(|d| d.tint)).collect();
    let off = gains::off_tint(&tints, &facts.solution.positions);
    let large = |i: usize| off[i].filter(|o| o.iter().any(|t| t.abs() > OUTLIER));
    let some = which(facts, |i| large(i).is_some());
    let sizes = |i: usize| {
        let percent = large(i).unwrap_or_default().map(|t| 100.0 * (t.exp() - 1.0));
        format!("{} (red {:+.1} %, blue {:+.1} %)", facts.slices.name(i), percent[0], percent[1])
    };
    (!some.is_empty()).then(|| {
        Finding::limiting(
            Grade::Usable,
            "tint_outlier",
            format!(
                "the tint differs from that of the other slices in {}: set a fixed white balance, and calibrate again",
                listed(&some, sizes)
            ),
        )
    })
}

/// Slices with stripes of light.
fn banding(facts: &Facts) -> Option<Finding> {
    let stripes = |i: usize| facts.tracked.detections[i].as_ref().and_then(|d| d.stripes);
    let some = which(facts, |i| stripes(i).is_some());
    let size = |i: usize| format!("{} ({:.1} %)", facts.slices.name(i), 100.0 * stripes(i).unwrap_or_default());
    (!some.is_empty()).then(|| {
        Finding::limiting(
            Grade::Usable,
            "lamp_banding",
            format!(
                "stripes of light cross {}: the lamp flickers while the shutter runs, which displaces the dots and makes \
                 stacks uneven; use a lamp on direct current, a longer exposure, or the mechanical shutter",
                listed(&some, size)
            ),
        )
    })
}

/// At most five items as a phrase.
fn listed(indices: &[usize], text: impl Fn(usize) -> String) -> String {
    let mut items: Vec<String> = indices.iter().take(5).map(|&i| text(i)).collect();
    if indices.len() > 5 {
        items.push(format!("{} more", indices.len() - 5));
    }
    items.join(", ")
}

fn dots(facts: &Facts) -> Vec<Finding> {
    let (profile, reference) = (facts.profile, facts.solution.reference);
    let mut out = Vec::new();
    for cause in lost::ALL {
        let some = which(facts, |i| profile[i].interpolated && Loss::of(facts.tracked, i) == cause);
        if some.is_empty() {
            continue;
        }
        let [is, was] = if some.len() == 1 { ["is", "was"] } else { ["are", "were"] };
        let detail = format!(
            "{} {is} {}, and {was} predicted from the other slices; {}",
            list(facts.slices, &some),
            cause.phrase(),
            cause.advice()
        );
        let allows = if cause == Loss::Other { Grade::Usable } else { Grade::Good };
        out.push(Finding::limiting(allows, "slice_interpolated", detail));
    }
    let inverted = which(facts, |i| facts.tracked.detections[i].as_ref().is_some_and(|s| s.modulation < 0.0));
    if !inverted.is_empty() {
        let detail = format!(
            "blur has inverted the dots in {}: they were measured, but a target with more widely spaced dots is better",
            list(facts.slices, &inverted)
        );
        out.push(Finding::remark("dots_inverted", detail));
    }
    let unsure = which(facts, |i| !profile[i].interpolated && profile[i].corner_sigma_px.is_some_and(|s| s > GOOD));
    if !unsure.is_empty() {
        let detail = format!(
            "the image corners are uncertain by more than {GOOD} px in {}: use a target that fills the image, or larger \
             dots",
            list(facts.slices, &unsure)
        );
        out.push(Finding::remark("uncertain_corners", detail));
    }
    let base = facts.tracked.detections[reference].as_ref();
    let shared = |i: usize| {
        let (slice, base) = (facts.tracked.detections[i].as_ref()?, base?);
        Some(slice.dots.keys().filter(|label| base.dots.contains_key(*label)).count())
    };
    let lossy = which(facts, |i| match (profile[i].inliers, shared(i)) {
        (Some(inliers), Some(shared)) if !profile[i].interpolated && i != reference => {
            4 * (inliers as usize) < 3 * shared
        }
        _ => false,
    });
    if !lossy.is_empty() {
        let detail = format!(
            "more than a quarter of the dots disagree with the homography in {}: check the target for dust, reflections \
             and bending",
            list(facts.slices, &lossy)
        );
        out.push(Finding::limiting(Grade::Usable, "many_outliers", detail));
    }
    let tilted = which(facts, |i| {
        let h = profile[i].homography.0;
        (h[6] * facts.tracked.width as f64).abs() > PERSPECTIVE
            || (h[7] * facts.tracked.height as f64).abs() > PERSPECTIVE
    });
    if !tilted.is_empty() {
        let detail = format!(
            "the perspective changes in {}: align the rail with the optical axis, and check that camera and target did \
             not rotate",
            list(facts.slices, &tilted)
        );
        out.push(Finding::remark("perspective", detail));
    }
    out
}

/// Findings about the target in the reference slice.
fn target(facts: &Facts) -> Vec<Finding> {
    let Some(base) = facts.tracked.detections[facts.solution.reference].as_ref() else { return Vec::new() };
    let mut out = Vec::new();
    let share = coverage(facts.tracked, facts.solution.reference);
    if share < 0.25 {
        let detail = format!(
            "the dots cover {:.0} % of the reference slice: the corners are extrapolated; use a larger target",
            100.0 * share
        );
        out.push(Finding::remark("small_target", detail));
    }
    if let Some(stretch) = stretch(&base.places).filter(|s| *s > ASLANT) {
        let detail = format!(
            "the grid is stretched by {:.1} %, as if the target were tilted by about {:.0} degrees: set it square to the lens",
            100.0 * (stretch - 1.0),
            (1.0 / stretch).acos().to_degrees()
        );
        out.push(Finding::remark("target_aslant", detail));
    }
    let (width, height) = (facts.tracked.width as u32, facts.tracked.height as u32);
    if let Some(colours) = facts.tracked.colours.and_then(|measured| measured.worth_correcting(width, height)) {
        let [red, blue] = [colours.red, colours.blue].map(|colour| colour.max_displacement_px(width, height));
        let detail = format!(
            "the lens has lateral colour: relative to green, the image corners are displaced in red by {red:.1} px and in \
             blue by {blue:.1} px; the profile keeps it, and fusion moves red and blue to where green is, unless a stack \
             is sent with lateral_colour=keep"
        );
        out.push(Finding::remark("lateral_colour", detail));
    }
    if facts.blurs[facts.solution.reference].is_some_and(|b| b > 0.3) {
        let detail =
            "the target is blurred in the reference slice, on which all others depend: move the target to where \
                      the reference slice is in focus, or set reference_index to a sharper slice"
                .to_owned();
        out.push(Finding::remark("blurred_reference", detail));
    }
    out
}

/// Share of the image inside the dots' bounding box.
pub(super) fn coverage(tracked: &Tracked, reference: usize) -> f64 {
    let Some(detection) = tracked.detections[reference].as_ref() else { return 0.0 };
    let span = |axis: usize| {
        let (low, high) =
            detection.dots.values().fold((f64::MAX, f64::MIN), |b, d| (b.0.min(d.at[axis]), b.1.max(d.at[axis])));
        (high - low).max(0.0)
    };
    span(0) * span(1) / (tracked.width * tracked.height) as f64
}

/// Ratio of the singular values of the map from the grid to the image; 1 for a square grid seen square on.
fn stretch(places: &Places) -> Option<f64> {
    let steps = super::detection::grid_steps(places);
    let [[a, c], [b, d]] = steps;
    let (sum, twist) = (a * a + b * b + c * c + d * d, a * d - b * c);
    let root = (sum * sum - 4.0 * twist * twist).max(0.0).sqrt();
    let (large, small) = (((sum + root) / 2.0).sqrt(), ((sum - root) / 2.0).max(0.0).sqrt());
    (small > 0.0).then(|| large / small)
}
