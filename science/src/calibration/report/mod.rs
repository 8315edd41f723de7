//! Assembles the calibration result and the report for the technician.

mod rail;
mod slice;
mod target;
mod verdict;

use super::camera::{self, Known};
use super::capture::{self, ScaleSample};
use super::findings::{self, Facts};
use super::result::{Calibration, Dot, DotUse};
use super::solve::{Solution, Solved};
use super::{distortion::LensAnalysis, grade::Finding, tracked::Tracked};
use crate::imaging::Slices;
use crate::types::report::{CalibrationReport, CaptureReport};
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
    let pitch = tracked.detections[reference].as_ref().map_or(0.0, |s| s.pitch);
    let magnification = match (options.pixel_pitch_mm, options.target_pitch_mm) {
        (Some(pixel), Some(target)) if target > 0.0 => Some(pitch * pixel / target),
        _ => None,
    };
    let capture = capture_report(&solution, &profile, tracked, in_mm, options);
    let capture_mode = capture.found.or(options.capture_mode);
    let rail = rail::report(&solution, in_mm, tracked.size());
    let growth_per_mm = rail.as_ref().filter(|_| in_mm).map(|r| r.growth);
    let camera = camera::camera(options, Known { magnification, growth_per_mm, capture: capture_mode });
    let facts = Facts {
        slices,
        tracked,
        solution: &solution,
        profile: &profile,
        blurs: &tracked.blurs(),
        capture: &capture,
        camera: &camera,
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
        target: target::report(&facts, options.target_pitch_mm, magnification),
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

/// What moves, by the scales of the measured slices.
fn capture_report(
    solution: &Solution,
    profile: &[ProfileSlice],
    tracked: &Tracked,
    in_mm: bool,
    options: &CalibrationOptions,
) -> CaptureReport {
    let [width, height] = tracked.size().map(|length| f64::from(length) - 1.0);
    let half = 0.5 * width.hypot(height);
    let sample = |i: usize| {
        let (_, sigma) = solution.rail.scales[i].filter(|_| !profile[i].interpolated)?;
        let sigma = sigma.max(LEAST_CORNER_SIGMA / half);
        Some(ScaleSample { position: solution.rail.positions[i], scale: profile[i].scale, sigma })
    };
    let scales: Vec<ScaleSample> = (0..profile.len()).filter_map(sample).collect();
    capture::decide(&scales, in_mm, in_mm || solution.rail.anomalies.is_empty(), options.capture_mode)
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
