//! What the technician is told.

use super::chain::Seen;
use super::field::Polarity;
use super::sighting::Sighting;
use super::solve::Solution;
use super::{Calibration, Dot, DotUse, rail};
use crate::imaging::Slices;
use crate::model::profile::{CaptureMode, HomographyModel, ProfileSlice};
use crate::model::report::{
    CalibrationReport, CameraReport, CaptureReport, DotReport, Grade, SliceReport, TargetReport,
};
use crate::model::request::CalibrationOptions;
use crate::model::{Homography, Warning};

/// Uncertainty of the worst corner up to which a calibration is good, px.
const GOOD: f64 = 0.3;
/// Perspective (change of scale over the picture) beyond which the centres of the discs' images and the
/// images of their centres begin to differ.
const PERSPECTIVE: f64 = 1e-3;

/// Puts everything together.
pub fn report(slices: &dyn Slices, options: &CalibrationOptions, seen: &Seen, solution: Solution) -> Calibration {
    let (width, height) = (seen.width as u32, seen.height as u32);
    let profile: Vec<ProfileSlice> = solution
        .slices
        .iter()
        .enumerate()
        .map(|(index, s)| ProfileSlice {
            dots_found: Some(s.dots.len() as u32),
            inliers: Some(s.dots.iter().filter(|d| d.used == DotUse::Inlier).count() as u32),
            rms_px: s.rms,
            p95_px: s.p95,
            corner_sigma_px: Some(s.corner_sigma),
            interpolated: s.interpolated,
            ..ProfileSlice::given(index as u32, s.homography, s.gain, width, height)
        })
        .collect();
    let dot_pitch_px = seen.sightings[solution.reference].as_ref().map_or(0.0, |s| s.pitch);
    let magnification = match (options.pixel_pitch_mm, options.target_pitch_mm) {
        (Some(pixel), Some(target)) if target > 0.0 => Some(dot_pitch_px * pixel / target),
        _ => None,
    };
    let warnings = warnings(slices, seen, &profile, solution.reference);
    let verdict = verdict(&profile, solution.reference);
    let capture_mode = rail::capture_mode(&solution.known, width, height);
    let found = Found { profile: &profile, warnings: &warnings, verdict: &verdict, capture_mode, magnification };
    let report = in_full(slices, options, seen, &solution, &found);
    Calibration {
        width,
        height,
        reference_index: solution.reference,
        dot_pitch_px,
        magnification,
        capture_mode,
        verdict,
        report,
        warnings,
        slices: profile,
        dots: solution.slices.into_iter().map(|s| s.dots).collect(),
    }
}

/// What was concluded from the solution.
struct Found<'a> {
    profile: &'a [ProfileSlice],
    warnings: &'a [Warning],
    verdict: &'a str,
    capture_mode: Option<CaptureMode>,
    magnification: Option<f64>,
}

/// Most dots of one slice that are kept for the report.
const MOST_DOTS: usize = 2000;

/// The report with all that is known so far: no law, no other families of maps, no blur.
fn in_full(
    slices: &dyn Slices,
    options: &CalibrationOptions,
    seen: &Seen,
    solution: &Solution,
    found: &Found<'_>,
) -> CalibrationReport {
    let base = seen.sightings[solution.reference].as_ref();
    let worst = found.profile.iter().filter_map(|slice| slice.corner_sigma_px).fold(0.0, f64::max);
    let one = |(index, slice): (usize, &ProfileSlice)| SliceReport {
        index: index as u32,
        name: slices.name(index).to_owned(),
        scale: slice.scale,
        law_scale: None,
        shift_px: slice.shift_px,
        law_shift_px: None,
        off_law_px: None,
        blur_radius_px: None,
        contrast: None,
        gain: slice.gain,
        clipped: seen.sightings[index].as_ref().map(|s| s.clipped),
        dots_found: slice.dots_found.unwrap_or(0),
        inliers: slice.inliers.unwrap_or(0),
        rms_px: slice.rms_px,
        corner_sigma_px: slice.corner_sigma_px.unwrap_or(0.0),
        interpolated: slice.interpolated,
        dots: dots(&solution.slices[index].dots, &slice.homography, base),
    };
    CalibrationReport {
        width: seen.width as u32,
        height: seen.height as u32,
        reference_index: solution.reference as u32,
        verdict: found.verdict.to_owned(),
        grade: match worst {
            w if w <= GOOD => Grade::Good,
            w if w <= 2.0 * GOOD => Grade::Usable,
            _ => Grade::Poor,
        },
        findings: found.warnings.to_vec(),
        target: TargetReport {
            pitch_px: base.map_or(0.0, |s| s.pitch),
            pitch_mm: options.target_pitch_mm,
            fill: 0.0,
            bright_dots: seen.target.polarity == Polarity::LightOnDark,
            asymmetric: false,
            dots: base.map_or(0, |s| s.dots.len() as u32),
            coverage: coverage(seen, solution.reference).unwrap_or(0.0),
            magnification: found.magnification,
        },
        model: HomographyModel::Homography,
        model_reason: "eight free numbers per slice, fitted to the dots that the slice shares with the reference slice"
            .into(),
        candidates: Vec::new(),
        capture: CaptureReport {
            told: None,
            found: found.capture_mode,
            detail: match found.capture_mode {
                Some(_) => "the scales of the slices follow this law and not the other".into(),
                None => "the scales of the slices fit both laws, or neither".into(),
            },
        },
        rail: None,
        camera: CameraReport {
            pixel_pitch_mm: options.pixel_pitch_mm,
            detail: "not computed".into(),
            ..CameraReport::default()
        },
        slices: found.profile.iter().enumerate().map(one).collect(),
    }
}

/// The dots of a slice, every so many of them when they are many.
fn dots(dots: &[Dot], homography: &Homography, base: Option<&Sighting>) -> Vec<DotReport> {
    let every = dots.len().div_ceil(MOST_DOTS).max(1);
    let one = |dot: &Dot| {
        let miss = base.and_then(|base| base.dots.get(&dot.label)).map(|reference| {
            let sent = homography.apply(dot.at);
            [sent[0] - reference.at[0], sent[1] - reference.at[1]]
        });
        DotReport {
            at: dot.at,
            residual: miss.filter(|miss| dot.used != DotUse::Unused && miss.iter().all(|v| v.is_finite())),
            inlier: dot.used == DotUse::Inlier,
        }
    };
    dots.iter().step_by(every).map(one).collect()
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

fn warnings(slices: &dyn Slices, seen: &Seen, profile: &[ProfileSlice], reference: usize) -> Vec<Warning> {
    let mut out = Vec::new();
    let which = |test: &dyn Fn(usize) -> bool| (0..profile.len()).filter(|&i| test(i)).collect::<Vec<_>>();
    let interpolated = which(&|i| profile[i].interpolated);
    if !interpolated.is_empty() {
        let detail =
            format!("too blurred to be measured and predicted from the other slices: {}", list(slices, &interpolated));
        out.push(Warning::new("slice_interpolated", detail));
    }
    let clipped = which(&|i| seen.sightings[i].as_ref().is_some_and(|s| s.clipped > 0.05));
    if !clipped.is_empty() {
        let detail = format!(
            "the white of the target is clipped in {}: their gains are not to be relied on; expose less",
            list(slices, &clipped)
        );
        out.push(Warning::new("clipped_white", detail));
    }
    let unsure = which(&|i| !profile[i].interpolated && profile[i].corner_sigma_px.is_some_and(|s| s > GOOD));
    if !unsure.is_empty() {
        let detail = format!(
            "the corners of the picture are uncertain by more than {GOOD} px in {}: use a target that fills the \
             picture, or larger dots",
            list(slices, &unsure)
        );
        out.push(Warning::new("uncertain_corners", detail));
    }
    let lossy = which(&|i| match (profile[i].inliers, profile[i].dots_found) {
        (Some(inliers), Some(found)) if !profile[i].interpolated && i != reference => 4 * inliers < 3 * found,
        _ => false,
    });
    if !lossy.is_empty() {
        let detail =
            format!("more than a quarter of the dots do not agree with the homography in {}", list(slices, &lossy));
        out.push(Warning::new("many_outliers", detail));
    }
    let tilted = which(&|i| {
        let h = profile[i].homography.0;
        (h[6] * seen.width as f64).abs() > PERSPECTIVE || (h[7] * seen.height as f64).abs() > PERSPECTIVE
    });
    if !tilted.is_empty() {
        let detail = format!(
            "the target is not seen square on or the rail is not parallel to the lens's axis (perspective changes in {})",
            list(slices, &tilted)
        );
        out.push(Warning::new("perspective", detail));
    }
    if let Some(share) = coverage(seen, reference)
        && share < 0.25
    {
        let detail = format!(
            "the dots cover {:.0} % of the reference slice: the corners are extrapolated; use a larger target",
            100.0 * share
        );
        out.push(Warning::new("small_target", detail));
    }
    out
}

/// Share of the picture inside the dots' bounding box.
fn coverage(seen: &Seen, reference: usize) -> Option<f64> {
    let dots = &seen.sightings[reference].as_ref()?.dots;
    let span = |axis: usize| {
        let (low, high) = dots.values().fold((f64::MAX, f64::MIN), |b, d| (b.0.min(d.at[axis]), b.1.max(d.at[axis])));
        high - low
    };
    Some(span(0) * span(1) / (seen.width * seen.height) as f64)
}

fn verdict(profile: &[ProfileSlice], reference: usize) -> String {
    let others = || profile.iter().filter(|s| s.index as usize != reference);
    let worst = others().filter_map(|s| s.corner_sigma_px).fold(0.0, f64::max);
    let rms = others().filter_map(|s| s.rms_px).fold(0.0, f64::max);
    let measured = profile.iter().filter(|s| !s.interpolated).count();
    let dots = profile.iter().filter(|s| !s.interpolated).filter_map(|s| s.inliers).min().unwrap_or(0);
    let word = match worst {
        w if w <= GOOD => "Good",
        w if w <= 2.0 * GOOD => "Usable",
        _ => "Poor",
    };
    let same = others().all(|s| s.homography.corner_distance(&Homography::IDENTITY, 1000, 1000) < 1e-3);
    let still = if same { "; the slices do not differ in geometry" } else { "" };
    format!(
        "{word}: the image corners are good to {worst:.2} px; dots fit to {rms:.3} px RMS or better, at least {dots} dots \
         per slice, {measured} of {} slices measured{still}",
        profile.len()
    )
}
