//! The pinhole camera, as far as a calibration can determine it.
//!
//! In: the sizes of the target over the rail, its pitch, and the numbers that the user specified. Out: the principal
//! distance `c = E / P = M D` of [`Lens`] with its source and standard deviation, or unknown.
//!
//! | what moves | the rail measures | `c` is known with |
//! |---|---|---|
//! | camera and lens | `D` | the target pitch: `M D` |
//! | sensor | `E` | a moved target (`M D`), the pupil ratio (`E / P`), or roughly the focal length (`P = E / f - M`) |
//! | lens alone | `1 / E + 1 / D` | the same |
//! | nothing in mm | nothing | the focal length with the pupil ratio, or roughly with `P = 1` |
//!
//! A target that is nearer to the lens by `T` and `m1 / m0` times as large gives `D = T / (1 - m0 / m1)`. With both
//! pupils, `P = E / (M D)` and `f = E / (M + P)` follow, against which specified numbers are checked.

mod checks;
mod measured;

use crate::types::{
    calibration_options::CalibrationOptions,
    lens::Lens,
    pupils::{PrincipalDistanceSource, Pupils},
    report::CameraReport,
};
use measured::{ASSUMED_RATIO, Estimate, FOCAL, Measured, PRINT, RATIO};

pub(super) use checks::Contradiction;
pub(super) use measured::Known;

/// The camera from the options and the measured quantities, and what contradicts it.
pub(super) fn camera(options: &CalibrationOptions, known: Known) -> (CameraReport, Vec<Contradiction>) {
    let measured = Measured::of(options, known);
    let contradictions = checks::contradictions(options, known, &measured);
    let (source, distance) = distance(options, &measured, &contradictions);
    let given = options.pupil_ratio.and_then(|ratio| Estimate::new(ratio, [RATIO]));
    let ratio = measured.ratio().or(given);
    let measured_focal_mm = measured.ratio().and_then(|ratio| measured.lens(ratio.value)).map(|lens| lens.focal_mm);
    let (value, sigma) = (|e: Estimate| e.value, Estimate::absolute);
    let report = CameraReport {
        principal_distance_mm: distance.map(value),
        principal_distance_px: distance.zip(options.pixel_pitch_mm).map(|(d, p)| d.value / p),
        source,
        pupils: Pupils {
            principal_distance_sigma_mm: distance.map(sigma),
            exit_pupil_distance_mm: measured.exit.map(value),
            exit_pupil_distance_sigma_mm: measured.exit.map(sigma),
            entrance_pupil_distance_mm: measured.depth().map(value),
            entrance_pupil_distance_sigma_mm: measured.depth().map(sigma),
            pupil_ratio: ratio.map(value),
            pupil_ratio_sigma: ratio.map(sigma),
        },
        measured_focal_mm,
        // the fixed point gives the principal point only together with the tilt of the rail, which is unknown
        principal_point_px: None,
        pixel_pitch_mm: options.pixel_pitch_mm,
        focal_mm: options.focal_mm,
        detail: detail(source, options, known, &measured),
    };
    (report, contradictions)
}

/// The principal distance and its source.
fn distance(
    options: &CalibrationOptions,
    measured: &Measured,
    contradictions: &[Contradiction],
) -> (PrincipalDistanceSource, Option<Estimate>) {
    use PrincipalDistanceSource as Source;
    let m = measured.magnification;
    if let (Some(depth), Some(m)) = (measured.depth(), m) {
        let source = if measured.entrance.is_some() { Source::CameraRail } else { Source::MovedTarget };
        return (source, Estimate::new(m.value * depth.value, [depth.sigma, m.sigma]));
    }
    // where the two numbers that were specified contradict each other, either may be wrong
    let doubt = contradictions.iter().map(|c| c.doubt).fold(0.0, f64::max);
    if let (Some(rail), Some(ratio)) = (measured.exit.or(measured.growth), options.pupil_ratio) {
        let by_lens = || measured.lens(ratio).map(|lens| lens.principal_distance());
        if let Some(distance) = measured.exit.map(|exit| exit.value / ratio).or_else(by_lens) {
            return (Source::PupilRatio, Estimate::new(distance, [rail.sigma, RATIO, doubt]));
        }
    }
    let by_focal = || {
        let (focal_mm, magnification) = (options.focal_mm?, m?.value);
        let on_rail = measured.ratio_of(focal_mm);
        if on_rail.is_some() && contradictions.iter().any(|c| c.is_implausible) {
            return None;
        }
        let at = |focal_mm: f64| {
            let pupil_ratio = measured.ratio_of(focal_mm).or(options.pupil_ratio).unwrap_or(1.0);
            Lens { focal_mm, magnification, pupil_ratio }.principal_distance()
        };
        let ratio = match (on_rail, options.pupil_ratio) {
            (Some(_), _) => 0.0,
            (None, Some(_)) => RATIO,
            (None, None) => ASSUMED_RATIO,
        };
        // with a rail the pupil ratio follows from the focal length, and takes its error up
        let step = 1e-4;
        let slope = (at(focal_mm * (1.0 + step)) / at(focal_mm) - 1.0) / step;
        Estimate::new(at(focal_mm), [slope * FOCAL, ratio, PRINT]).filter(|distance| distance.sigma < 1.0)
    };
    match by_focal() {
        Some(distance) => (Source::FocalLength, Some(distance)),
        None => (Source::Unknown, None),
    }
}

/// Where the number comes from, or what would make it known or better, in one sentence.
fn detail(source: PrincipalDistanceSource, options: &CalibrationOptions, known: Known, measured: &Measured) -> String {
    use PrincipalDistanceSource as Source;
    const MOVE: &str = "add a picture of the target moved by a known distance (folder moved/ and target_advance_mm)";
    match source {
        Source::CameraRail => "measured with the rail, which moves camera and lens".into(),
        Source::MovedTarget => format!(
            "measured with the moved target, whose dots are {:.3} px apart instead of {:.3} px",
            options.moved_target_pitch_px.unwrap_or_default(),
            known.pitch_px[0]
        ),
        Source::PupilRatio => format!("from pupil_ratio as specified, which nothing checks; to measure it, {MOVE}"),
        Source::FocalLength if known.sizes.is_empty() && options.pupil_ratio.is_none() => format!(
            "rough: from focal_mm as specified, with a pupil ratio of 1 that is only assumed; to measure it, give \
             rail_step_mm, and with a rail that moves the sensor {MOVE}"
        ),
        Source::FocalLength => {
            format!("rough: from focal_mm as specified, which nothing checks; give pupil_ratio, or better {MOVE}")
        }
        Source::Unknown if known.pitch_px[0] <= 0.0 => {
            "not known: only a dot target of known pitch measures it, with pixel_pitch_mm and rail_step_mm".into()
        }
        Source::Unknown if measured.magnification.is_none() => {
            "not known: give target_pitch_mm and pixel_pitch_mm, and rail_step_mm or rail_positions_mm".into()
        }
        Source::Unknown if known.sizes.is_empty() => {
            "not known: give rail_step_mm or rail_positions_mm; focal_mm gives a rough value".into()
        }
        Source::Unknown if known.capture.is_none() => {
            "not known, because it is not decided what moved: specify capture_mode".into()
        }
        Source::Unknown => format!(
            "not known, because a rail that moves the sensor or the lens alone measures only half of it: {MOVE}, or give \
             pupil_ratio, or the right focal_mm for a rough value"
        ),
    }
}

#[cfg(test)]
mod tests;
