//! Assembles the calibration result and the report for the technician.

use super::camera::{self, Known};
use super::capture::{self, ScaleSample};
use super::code;
use super::distortion::LensAnalysis;
use super::findings::{self, Facts};
use super::flat_field::Polarity;
use super::gains;
use super::grade::{self, Finding};
use super::lost::Loss;
use super::solve::Solution;
use super::tracking::Tracked;
use super::{Calibration, Dot, DotUse};
use crate::imaging::Slices;
use crate::types::calibration_options::CalibrationOptions;
use crate::types::profile::ProfileSlice;
use crate::types::report::{CalibrationReport, DotReport, Grade, RailReport, SliceReport, TargetReport};
use crate::types::{Homography, Warning};

/// Most dots per slice that a report keeps.
const MAX_DOTS: usize = 2000;
/// Largest advised blur radius over pitch (the pitch is 2.5 times the largest blur radius).
const ADVISED: f64 = 0.4;

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
        slice.corner_sigma = slice.corner_sigma.hypot(*more);
    }
    let seen_at = |p: [f64; 2]| lens.distortion.map_or(p, |distortion| distortion.distort(p));
    let (width, height) = (tracked.width as u32, tracked.height as u32);
    let reference = solution.reference;
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
    let blurs = gains::blurs(tracked);
    let pitch = tracked.detections[reference].as_ref().map_or(0.0, |s| s.pitch);
    let magnification = match (options.pixel_pitch_mm, options.target_pitch_mm) {
        (Some(pixel), Some(target)) if target > 0.0 => Some(pitch * pixel / target),
        _ => None,
    };
    let half = 0.5 * (f64::from(width) - 1.0).hypot(f64::from(height) - 1.0);
    let scaled: Vec<ScaleSample> = (0..profile.len())
        .filter_map(|i| {
            let (_, sigma) = solution.scales[i].filter(|_| !profile[i].interpolated)?;
            Some(ScaleSample {
                position: solution.positions[i],
                scale: profile[i].scale,
                sigma: sigma.max(0.01 / half),
            })
        })
        .collect();
    let capture = capture::decide(&scaled, in_mm, in_mm || solution.anomalies.is_empty(), options.capture_mode);
    let rail = rail(&solution, in_mm, width, height);
    let known = Known {
        magnification,
        growth_per_mm: rail.as_ref().filter(|_| in_mm).map(|r| r.growth),
        capture: capture.found.or(options.capture_mode),
    };
    let camera = camera::camera(options, known);
    let facts = Facts {
        slices,
        tracked,
        solution: &solution,
        profile: &profile,
        blurs: &blurs,
        capture: &capture,
        camera: &camera,
    };
    let mut findings = findings::findings(&facts);
    findings.extend(lens.finding.clone());
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.allows));
    // a slice that is lost to blur is blurred at least to where the pattern vanishes
    let lost_to_blur = |i: usize| {
        let is_lost = profile[i].interpolated && Loss::of(tracked, i) == Loss::Blurred;
        is_lost.then(|| blurs[i].unwrap_or(super::blur::VANISHES))
    };
    let lost: Vec<Option<f64>> = (0..blurs.len()).map(lost_to_blur).collect();
    let (grade, verdict) = verdict(&profile, &findings, &lost, reference, pitch, options.target_pitch_mm);
    let warnings: Vec<Warning> = findings.into_iter().map(|finding| finding.warning).collect();
    let target = TargetReport {
        pitch_px: pitch,
        pitch_mm: options.target_pitch_mm,
        fill: gains::fill(tracked),
        bright_dots: tracked.target.polarity == Polarity::LightOnDark,
        asymmetric: tracked.detections[reference].as_ref().is_some_and(|s| is_asymmetric(s.places.keys().copied())),
        dots: profile.get(reference).and_then(|s| s.dots_found).unwrap_or(0),
        coverage: findings::coverage(tracked, reference),
        magnification,
        coded: tracked.target.code.is_some(),
        code: code::report(tracked, reference),
    };
    let slice_reports = (0..profile.len())
        .map(|i| {
            let mut report = slice_report(slices.name(i), &profile[i], &solution, tracked, blurs[i], i);
            report.dots.iter_mut().for_each(|dot| dot.at = seen_at(dot.at));
            report
        })
        .collect();
    let report = CalibrationReport {
        width,
        height,
        reference_index: reference as u32,
        verdict: verdict.clone(),
        grade,
        findings: warnings.clone(),
        target,
        model: solution.model.0.name(),
        model_reason: solution.model.1.clone(),
        candidates: solution.candidates.clone(),
        capture: capture.clone(),
        rail,
        camera,
        slices: slice_reports,
    };
    Calibration {
        width,
        height,
        reference_index: reference,
        dot_pitch_px: pitch,
        magnification,
        capture_mode: capture.found.or(options.capture_mode),
        model: solution.model.0.name(),
        verdict,
        warnings,
        slices: profile,
        dots: solution
            .slices
            .into_iter()
            .map(|s| s.dots.into_iter().map(|dot| Dot { at: seen_at(dot.at), ..dot }).collect())
            .collect(),
        distortion: lens.distortion,
        lateral_colour: tracked.colours.and_then(|measured| measured.worth_correcting(width, height)),
        report,
    }
}

fn rail(solution: &Solution, in_mm: bool, width: u32, height: u32) -> Option<RailReport> {
    let [scale, turn, x, y] = solution.slopes?;
    let centre = [(f64::from(width) - 1.0) / 2.0, (f64::from(height) - 1.0) / 2.0];
    let half = centre[0].hypot(centre[1]);
    // the fixed point solves a x + e = 0, with a the scaling and rotation per step
    let size = scale * scale + turn * turn;
    let span = solution.positions.iter().fold(0.0_f64, |m, z| m.max((z - solution.positions[0]).abs()));
    let fixed_point_px = (size.sqrt() * span > 2e-3).then(|| {
        let unit = [-(scale * x + turn * y) / size, -(scale * y - turn * x) / size];
        [centre[0] + half * unit[0], centre[1] + half * unit[1]]
    });
    let off: Vec<f64> = solution.slices.iter().filter_map(|s| s.off_law).collect();
    let corner_rms_px = (off.iter().map(|o| o * o).sum::<f64>() / off.len().max(1) as f64).sqrt();
    Some(RailReport {
        growth: scale,
        fixed_point_px,
        in_mm,
        positions: solution.positions.clone(),
        measured_positions: match &solution.positions_by_scale {
            Some(positions) => positions.iter().map(|p| p.map(|p| p.0)).collect(),
            None => vec![None; solution.positions.len()],
        },
        corner_rms_px,
    })
}

fn slice_report(
    name: &str,
    slice: &ProfileSlice,
    solution: &Solution,
    tracked: &Tracked,
    blur: Option<f64>,
    index: usize,
) -> SliceReport {
    let solved = &solution.slices[index];
    let detection = tracked.detections[index].as_ref();
    let (width, height) = (tracked.width as u32, tracked.height as u32);
    let law = solved.by_law.map(|h| ProfileSlice::given(0, h, 1.0, width, height));
    let strongest = tracked.detections.iter().flatten().map(|s| s.modulation).fold(1e-9, f64::max);
    let base = tracked.detections[solution.reference].as_ref();
    let every = solved.dots.len().div_ceil(MAX_DOTS).max(1);
    let dot = |d: &Dot| DotReport {
        at: d.at,
        residual: base.and_then(|b| b.dots.get(&d.label)).map(|b| {
            let sent = slice.homography.apply(d.at);
            [sent[0] - b.at[0], sent[1] - b.at[1]]
        }),
        inlier: d.used == DotUse::Inlier,
    };
    SliceReport {
        index: slice.index,
        name: name.to_owned(),
        scale: slice.scale,
        law_scale: law.as_ref().map(|l| l.scale),
        shift_px: slice.shift_px,
        law_shift_px: law.map(|l| l.shift_px),
        off_law_px: solved.off_law,
        blur_radius_px: blur.zip(detection).map(|(b, s)| b * s.pitch),
        contrast: detection.map(|s| s.modulation / strongest),
        gain: slice.gain,
        gain_sigma: Some(solved.gain_sigma).filter(|s| s.is_finite()),
        law_gain: solved.gain_by_law,
        clipped: detection.map(|s| s.clipped),
        dots_found: slice.dots_found.unwrap_or(0),
        inliers: slice.inliers.unwrap_or(0),
        rms_px: slice.rms_px,
        corner_sigma_px: solved.corner_sigma,
        interpolated: slice.interpolated,
        dots: solved.dots.iter().step_by(every).map(dot).collect(),
    }
}

/// True when the grid is the asymmetric one that some tools print: in diagonal coordinates it fills its bounding box
/// better.
fn is_asymmetric(labels: impl Iterator<Item = [i32; 2]> + Clone) -> bool {
    let area = |of: &dyn Fn([i32; 2]) -> [i32; 2]| {
        let span = |axis: usize| {
            let (low, high) =
                labels.clone().map(|l| of(l)[axis]).fold((i32::MAX, i32::MIN), |b, v| (b.0.min(v), b.1.max(v)));
            f64::from(high - low + 1)
        };
        span(0) * span(1)
    };
    let upright = area(&|l| l);
    // in coordinates rotated by 45 degrees every other position is empty
    let turned = area(&|[i, j]| [i + j, i - j]) / 2.0;
    turned < 0.75 * upright
}

fn verdict(
    profile: &[ProfileSlice],
    findings: &[Finding],
    lost_to_blur: &[Option<f64>],
    reference: usize,
    pitch_px: f64,
    pitch_mm: Option<f64>,
) -> (Grade, String) {
    let others = || profile.iter().filter(|s| s.index as usize != reference);
    let worst = others().filter_map(|s| s.corner_sigma_px).fold(0.0, f64::max);
    let rms = others().filter(|s| !s.interpolated).filter_map(|s| s.rms_px).fold(0.0, f64::max);
    let dots = profile.iter().filter(|s| !s.interpolated).filter_map(|s| s.inliers).min().unwrap_or(0);
    let (grade, limit) = grade::grade(worst, findings);
    let corners = match (grade, limit) {
        (Grade::Good, _) => format!("the image corners are good to {worst:.2} px"),
        (_, None) => format!("the image corners are uncertain by {worst:.2} px"),
        // the finding says what is wrong, and the corners are only as good as what it doubts
        (_, Some(finding)) => {
            format!("see {}; apart from that the image corners are good to {worst:.2} px", finding.warning.code)
        }
    };
    let predicted: Vec<usize> = profile.iter().filter(|s| s.interpolated).map(|s| s.index as usize).collect();
    let tail = if predicted.is_empty() {
        format!("all {} slices measured", profile.len())
    } else {
        let why = too_fine(&predicted, lost_to_blur, pitch_mm).filter(|_| pitch_px > 0.0).unwrap_or_default();
        format!("{} predicted{why}", slices_named(&predicted))
    };
    let same = others().all(|s| s.homography.corner_distance(&Homography::IDENTITY, 1000, 1000) < 1e-3);
    let still = if same { "; all slices have the same geometry" } else { "" };
    let text = format!(
        "{}: {corners}; dots fit to {rms:.3} px RMS or better, at least {dots} \
         dots per slice, {tail}{still}",
        grade::word(grade)
    );
    (grade, text)
}

/// That the pitch of the target is too fine for the `predicted` slices, in brackets; `None` when blur is not the reason
/// for any of them. `lost_to_blur`: the blur radii, in grid steps, of the slices of which it is.
fn too_fine(predicted: &[usize], lost_to_blur: &[Option<f64>], pitch_mm: Option<f64>) -> Option<String> {
    let blurred: Vec<usize> = predicted.iter().copied().filter(|&i| lost_to_blur[i].is_some()).collect();
    let blur = lost_to_blur.iter().flatten().copied().fold(0.0, f64::max);
    if blur <= ADVISED {
        return None;
    }
    let which = match blurred.len() {
        1 if predicted.len() == 1 => "its blur".to_owned(),
        n if n == predicted.len() => "their blur".to_owned(),
        _ => format!("the blur of {}", slices_named(&blurred)),
    };
    let advice = match pitch_mm {
        Some(mm) => format!("{:.2} mm or more", mm * blur / ADVISED),
        None => format!("{:.1} times the pitch or more", blur / ADVISED),
    };
    Some(format!(" (the target's pitch is too fine for {which}: use {advice})"))
}

/// Slices by their indices, as a phrase.
fn slices_named(indices: &[usize]) -> String {
    let noun = if indices.len() == 1 { "slice" } else { "slices" };
    format!("{noun} {}", ranges(indices))
}

/// Indices as ranges: `0 to 2, 7`.
fn ranges(indices: &[usize]) -> String {
    let mut parts: Vec<(usize, usize)> = Vec::new();
    for &i in indices {
        match parts.last_mut() {
            Some((_, last)) if *last + 1 == i => *last = i,
            _ => parts.push((i, i)),
        }
    }
    let text = |(a, b): &(usize, usize)| if a == b { a.to_string() } else { format!("{a} to {b}") };
    parts.iter().map(text).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_written_as_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 7, 9, 10]), "0 to 2, 7, 9 to 10");
        assert_eq!(ranges(&[]), "");
    }

    #[test]
    fn an_asymmetric_grid_is_recognised() {
        let upright = (0..8_i32).flat_map(|j| (0..11_i32).map(move |i| [i, j]));
        assert!(!is_asymmetric(upright));
        let asymmetric = (0..11_i32).flat_map(|r| {
            (0..5_i32).map(move |c| 2 * c + r % 2).map(move |x| [(x + r).div_euclid(2), (x - r).div_euclid(2)])
        });
        assert!(is_asymmetric(asymmetric));
    }
}
