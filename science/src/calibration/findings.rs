//! What the user should know: each finding a sentence with its slices.

use super::capture;
use super::gains::MAX_SIGMA;
use super::lattice::Places;
use super::rail_anomalies::RailAnomaly;
use super::solve::Solution;
use super::tracking::Tracked;
use crate::imaging::Slices;
use crate::types::Warning;
use crate::types::profile::ProfileSlice;
use crate::types::report::{CameraReport, CaptureReport};

/// Uncertainty of the worst corner up to which a calibration is good, px.
pub(super) const GOOD: f64 = 0.3;
/// Perspective (change of scale over the picture) beyond which the centres of the discs' images and the
/// images of their centres begin to differ.
const PERSPECTIVE: f64 = 1e-3;
/// Stretch of the grid from which the target stands noticeably aslant: 1 / cos of 12 degrees.
const ASLANT: f64 = 1.022;

/// Everything that findings are made from.
pub(super) struct Facts<'a> {
    /// For names.
    pub slices: &'a dyn Slices,
    /// What was tracked.
    pub tracked: &'a Tracked,
    /// What followed.
    pub solution: &'a Solution,
    /// What the profile says.
    pub profile: &'a [ProfileSlice],
    /// Blur radii in steps of the grid.
    pub blurs: &'a [Option<f64>],
    /// What moved.
    pub capture: &'a CaptureReport,
    /// The pinhole.
    pub camera: &'a CameraReport,
}

/// Names of slices, at most five of them.
fn list(slices: &dyn Slices, indices: &[usize]) -> String {
    let mut names: Vec<&str> = indices.iter().take(5).map(|&i| slices.name(i)).collect();
    let more = indices.len().saturating_sub(5);
    let rest = format!("{more} more");
    if more > 0 {
        names.push(&rest);
    }
    names.join(", ")
}

/// All findings, the gravest first.
pub(super) fn findings(facts: &Facts) -> Vec<Warning> {
    let mut out = rail(facts);
    out.extend(light(facts));
    out.extend(dots(facts));
    out.extend(target(facts));
    out
}

/// What the rail and the rig did.
fn rail(facts: &Facts) -> Vec<Warning> {
    let name = |i: usize| facts.slices.name(i);
    let mut out: Vec<Warning> = facts
        .solution
        .anomalies
        .iter()
        .map(|event| match *event {
            RailAnomaly::Missing { after } => Warning::new(
                "slice_missing",
                format!("a slice seems to be missing between {} and {}: the step between them is twice as long as the others", name(after), name(after + 1)),
            ),
            RailAnomaly::Doubled { first } => Warning::new(
                "slice_doubled",
                format!("{} and {} were taken at the same place of the rail: one of them is one too many, or the rail stuck", name(first), name(first + 1)),
            ),
            RailAnomaly::Backwards { after } => Warning::new(
                "slices_out_of_order",
                format!("the rail seems to go backwards between {} and {}: are the files in the order in which they were taken?", name(after), name(after + 1)),
            ),
            RailAnomaly::Uneven { after, steps } => Warning::new(
                "uneven_step",
                format!("the step between {} and {} is {steps:.2} times as long as the others", name(after), name(after + 1)),
            ),
            RailAnomaly::Bumped { from, by } => Warning::new(
                "rig_bumped",
                format!("the picture jumps by {:.1} px between {} and {}: the rig was bumped; calibrate again if it still stands so", by[0].hypot(by[1]), name(from.saturating_sub(1)), name(from)),
            ),
        })
        .collect();
    if let (Some(told), Some(found)) = (facts.capture.told, facts.capture.found)
        && told != found
    {
        let detail =
            format!("you said that {} was used, but the pictures show {}", capture::name(told), capture::name(found));
        out.push(Warning::new("capture_mode_disagrees", detail));
    }
    if facts.camera.detail.contains("DISAGREE") {
        out.push(Warning::new("principal_distance_disagrees", format!("principal distance {}", facts.camera.detail)));
    }
    out
}

fn which(facts: &Facts, test: impl Fn(usize) -> bool) -> Vec<usize> {
    (0..facts.profile.len()).filter(|&i| test(i)).collect()
}

fn light(facts: &Facts) -> Vec<Warning> {
    let mut out = Vec::new();
    let clipped = which(facts, |i| facts.tracked.detections[i].as_ref().is_some_and(|s| s.clipped > 0.05));
    if !clipped.is_empty() {
        let detail = format!(
            "the white of the target is clipped in {}: their gains are not to be relied on; expose less",
            list(facts.slices, &clipped)
        );
        out.push(Warning::new("clipped_white", detail));
    }
    let sigma = |i: usize| facts.solution.slices[i].gain_sigma;
    let unsure = which(facts, |i| sigma(i) > MAX_SIGMA);
    if !unsure.is_empty() {
        let worst = unsure.iter().map(|&i| sigma(i)).fold(0.0, f64::max);
        let by = if worst < 0.5 { format!("by {:.1} %", 100.0 * worst) } else { "altogether".to_owned() };
        let detail = format!(
            "the gains are uncertain {by} in {}: use dark dots on white, evenly lit and not clipped, in raw or linear \
             pictures",
            list(facts.slices, &unsure)
        );
        out.push(Warning::new("uncertain_gains", detail));
    }
    out
}

fn dots(facts: &Facts) -> Vec<Warning> {
    let (profile, reference) = (facts.profile, facts.solution.reference);
    let mut out = Vec::new();
    let interpolated = which(facts, |i| profile[i].interpolated);
    if !interpolated.is_empty() {
        let detail = format!(
            "too blurred to be measured and predicted from the other slices: {}",
            list(facts.slices, &interpolated)
        );
        out.push(Warning::new("slice_interpolated", detail));
    }
    let inverted = which(facts, |i| facts.tracked.detections[i].as_ref().is_some_and(|s| s.modulation < 0.0));
    if !inverted.is_empty() {
        let detail = format!(
            "blur has inverted the dots in {}: they were measured all the same, but a target with wider spaced dots is better",
            list(facts.slices, &inverted)
        );
        out.push(Warning::new("dots_inverted", detail));
    }
    let unsure = which(facts, |i| !profile[i].interpolated && profile[i].corner_sigma_px.is_some_and(|s| s > GOOD));
    if !unsure.is_empty() {
        let detail = format!(
            "the corners of the picture are uncertain by more than {GOOD} px in {}: use a target that fills the \
             picture, or larger dots",
            list(facts.slices, &unsure)
        );
        out.push(Warning::new("uncertain_corners", detail));
    }
    let lossy = which(facts, |i| match (profile[i].inliers, profile[i].dots_found) {
        (Some(inliers), Some(found)) if !profile[i].interpolated && i != reference => 4 * inliers < 3 * found,
        _ => false,
    });
    if !lossy.is_empty() {
        let detail = format!(
            "more than a quarter of the dots do not agree with the homography in {}",
            list(facts.slices, &lossy)
        );
        out.push(Warning::new("many_outliers", detail));
    }
    let tilted = which(facts, |i| {
        let h = profile[i].homography.0;
        (h[6] * facts.tracked.width as f64).abs() > PERSPECTIVE
            || (h[7] * facts.tracked.height as f64).abs() > PERSPECTIVE
    });
    if !tilted.is_empty() {
        let detail = format!(
            "the perspective changes in {}: the rail is not parallel to the lens's axis, or something turned",
            list(facts.slices, &tilted)
        );
        out.push(Warning::new("perspective", detail));
    }
    out
}

/// How the target stands in the reference slice.
fn target(facts: &Facts) -> Vec<Warning> {
    let Some(base) = facts.tracked.detections[facts.solution.reference].as_ref() else { return Vec::new() };
    let mut out = Vec::new();
    let share = coverage(facts.tracked, facts.solution.reference);
    if share < 0.25 {
        let detail = format!(
            "the dots cover {:.0} % of the reference slice: the corners are extrapolated; use a larger target",
            100.0 * share
        );
        out.push(Warning::new("small_target", detail));
    }
    if let Some(stretch) = stretch(&base.places).filter(|s| *s > ASLANT) {
        let detail = format!(
            "the grid is stretched by {:.1} %, as if the target stood aslant by some {:.0} degrees: set it square to the lens",
            100.0 * (stretch - 1.0),
            (1.0 / stretch).acos().to_degrees()
        );
        out.push(Warning::new("target_aslant", detail));
    }
    if facts.blurs[facts.solution.reference].is_some_and(|b| b > 0.3) {
        let detail = "the target is blurred in the reference slice, on which all others lean: put the target where \
                      the reference slice is in focus, or name a sharper reference_index"
            .to_owned();
        out.push(Warning::new("blurred_reference", detail));
    }
    out
}

/// Share of the picture inside the dots' bounding box.
pub(super) fn coverage(tracked: &Tracked, reference: usize) -> f64 {
    let Some(detection) = tracked.detections[reference].as_ref() else { return 0.0 };
    let span = |axis: usize| {
        let (low, high) =
            detection.dots.values().fold((f64::MAX, f64::MIN), |b, d| (b.0.min(d.at[axis]), b.1.max(d.at[axis])));
        (high - low).max(0.0)
    };
    span(0) * span(1) / (tracked.width * tracked.height) as f64
}

/// Largest over smallest scale of the map from the grid to the picture; a square grid tracked square on has 1.
fn stretch(places: &Places) -> Option<f64> {
    let steps = super::detection::grid_steps(places);
    let [[a, c], [b, d]] = steps;
    let (sum, twist) = (a * a + b * b + c * c + d * d, a * d - b * c);
    let root = (sum * sum - 4.0 * twist * twist).max(0.0).sqrt();
    let (large, small) = (((sum + root) / 2.0).sqrt(), ((sum - root) / 2.0).max(0.0).sqrt());
    (small > 0.0).then(|| large / small)
}
