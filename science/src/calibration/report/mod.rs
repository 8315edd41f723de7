//! Assembles the calibration result and the report for the technician.

mod rail;
mod slice;
mod target;
mod verdict;

use super::camera::{self, Known};
use super::capture;
use super::findings::{self, Facts};
use super::result::{Calibration, Dot, DotUse};
use super::size_law::ScaleSample;
use super::solve::{Solution, Solved};
use super::{detected::Detection, distortion::LensAnalysis, grade::Finding, statistics::median_of, tracked::Tracked};
use crate::imaging::Slices;
use crate::types::report::CalibrationReport;
use crate::types::{Warning, calibration_options::CalibrationOptions, profile::ProfileSlice};

/// Least standard deviation of the image corners that a scale is known to, px.
const LEAST_CORNER_SIGMA: f64 = 0.01;

/// Assembles the result. `in_mm`: rail positions were specified in mm. `lens`: the distortion without which `tracked`
/// and `solution` are.
pub(super) fn report(
    slices: &dyn Slices,
    options: &CalibrationOptions,
    tracked: &Tracked,
    mut solution: Solution,
    in_mm: bool,
    lens: &LensAnalysis,
) -> Calibration {
    for (slice, more) in solution.slices.iter_mut().zip(&lens.corner_sigma) {
        slice.estimate.sigma = slice.estimate.sigma.hypot(*more);
    }
    let [width, height] = tracked.size();
    let reference = solution.reference;
    let profile = profile_slices(&solution, tracked);
    let base = tracked.detections[reference].as_ref();
    let pitch = base.map_or(0.0, |s| s.pitch);
    let magnification = options.magnification(pitch);
    let half = 0.5 * (f64::from(width) - 1.0).hypot(f64::from(height) - 1.0);
    let least_sigma = LEAST_CORNER_SIGMA / half;
    let sizes = sizes(&solution, &profile, least_sigma);
    let even = in_mm || solution.rail.anomalies.is_empty();
    let capture = capture::decide(&sizes, in_mm, even, options.capture_mode, magnification);
    let capture_mode = capture.found.or(options.capture_mode);
    let rail = rail::report(&solution, in_mm, tracked.size());
    let known = Known {
        magnification,
        sizes: if in_mm { &sizes } else { &[] },
        capture: capture_mode,
        pitch_px: [pitch, base.map_or(0.0, pitch_sigma).max(least_sigma)],
    };
    let (camera, contradictions) = camera::camera(options, known);
    let facts = Facts {
        slices,
        tracked,
        solution: &solution,
        profile: &profile,
        blurs: &tracked.blurs(),
        capture: &capture,
        camera: &camera,
        contradictions: &contradictions,
    };
    let findings = all_findings(&facts, lens);
    let (grade, verdict) = verdict::verdict(&facts, &findings, options.target_pitch_mm);
    let warnings: Vec<Warning> = findings.into_iter().map(|finding| finding.warning).collect();
    let report = CalibrationReport {
        width,
        height,
        reference_index: reference as u32,
        verdict: verdict.clone(),
        grade,
        findings: warnings.clone(),
        target: Some(target::report(&facts, options.target_pitch_mm, magnification)),
        model: solution.selection.model.name(),
        model_reason: solution.selection.reason.clone(),
        candidates: solution.selection.candidates.clone(),
        slices: (0..profile.len()).map(|i| slice::report(&facts, lens.distortion.as_ref(), i)).collect(),
        capture,
        rail,
        camera,
    };
    Calibration {
        width,
        height,
        reference_index: reference,
        dot_pitch_px: pitch,
        magnification,
        capture_mode,
        model: solution.selection.model.name(),
        verdict,
        warnings,
        dots: solution.slices.into_iter().map(|slice| seen_dots(slice, lens)).collect(),
        slices: profile,
        distortion: lens.distortion,
        lateral_colour: tracked.colours.and_then(|measured| measured.worth_correcting(width, height)),
        report,
    }
}

/// The slices of the profile.
fn profile_slices(solution: &Solution, tracked: &Tracked) -> Vec<ProfileSlice> {
    let [width, height] = tracked.size();
    let slice = |(index, s): (usize, &Solved)| ProfileSlice {
        dots_found: Some(s.dots.len() as u32),
        inliers: Some(s.dots.iter().filter(|d| d.used == DotUse::Inlier).count() as u32),
        rms_px: s.rms,
        p95_px: s.p95,
        corner_sigma_px: Some(s.estimate.sigma),
        interpolated: s.is_predicted(),
        ..ProfileSlice::given(index as u32, s.estimate.homography, s.gain.value, width, height)
    };
    solution.slices.iter().enumerate().map(slice).collect()
}

/// Relative standard deviation of the pitch, which is the median of the distances between neighbouring dots.
fn pitch_sigma(detection: &Detection) -> f64 {
    let dots = &detection.dots;
    1.25 * median_of(dots.values().map(|dot| dot.sigma)) / (detection.pitch * (dots.len() as f64).sqrt())
}

/// Sizes of the target in the measured slices, relative to the reference slice and its position.
fn sizes(solution: &Solution, profile: &[ProfileSlice], least_sigma: f64) -> Vec<ScaleSample> {
    let positions = &solution.rail.positions;
    let sample = |i: usize| {
        let (growth, sigma) = solution.rail.scales[i].filter(|_| !profile[i].interpolated)?;
        let position = positions[i] - positions[solution.reference];
        Some(ScaleSample { position, size: 1.0 + growth, sigma: sigma.max(least_sigma) })
    };
    (0..profile.len()).filter_map(sample).collect()
}

/// The findings of the slices and of the lens, the most serious first.
fn all_findings(facts: &Facts, lens: &LensAnalysis) -> Vec<Finding> {
    let mut all = findings::findings(facts);
    all.extend(lens.finding.clone());
    all.sort_by_key(|finding| std::cmp::Reverse(finding.allows));
    all
}

/// The dots of a slice where they are seen, with the distortion of the lens.
fn seen_dots(slice: Solved, lens: &LensAnalysis) -> Vec<Dot> {
    let seen = |at: [f64; 2]| lens.distortion.map_or(at, |distortion| distortion.distort(at));
    slice.dots.into_iter().map(|dot| Dot { at: seen(dot.at), ..dot }).collect()
}
