//! The camera of a profile that exists, from numbers that are given later: no picture is needed again.
//!
//! In: the profile, the dot pitch of the calibration that measured it, and the numbers. Out: the profile with its
//! camera; homographies and gains stay as they are. Sizes of the target are those of the homographies, at the positions
//! of the rail; the rest is as in a calibration.

use super::{
    camera::{self, Known},
    capture,
    size_law::{ScaleSample, SizeLaw},
    statistics::range,
};
use crate::types::{
    Error, ErrorKind, Warning,
    calibration_options::CalibrationOptions,
    profile::{CaptureMode, ProfileInput, ProfileSlice},
    pupils::PrincipalDistanceSource,
};

/// Least standard deviation of an image corner, px.
const LEAST_PX: f64 = 0.01;
/// The same where it is not known.
const UNKNOWN_PX: f64 = 0.1;
/// Relative change of the size over the stack from which its direction counts.
const NOTICEABLE: f64 = 1e-4;

/// The profile with a camera from `given`. What `given` lacks is taken from the profile. `slices` are those of the
/// profile; `dot_pitch_px` is the pitch of the target in its reference slice, if a target measured it. `magnification`,
/// if given, replaces the ratio of the pitches. Also returns what contradicts a measurement.
///
/// # Errors
/// [`ErrorKind::InvalidProfile`] when the camera is still unknown, with what to give; when the sign of the rail step
/// contradicts what the profile says to move; for values out of range.
pub fn add_camera(
    profile: &ProfileInput,
    slices: &[ProfileSlice],
    dot_pitch_px: Option<f64>,
    magnification: Option<f64>,
    given: &CalibrationOptions,
) -> Result<(ProfileInput, Vec<Warning>), Error> {
    let count = profile.homographies.len();
    let by_step = |step: f64| (0_u32..).take(count).map(|i| f64::from(i) * step).collect();
    let rail_positions_mm: Option<Vec<f64>> =
        given.rail_step_mm.map(by_step).or_else(|| profile.rail_positions_mm.clone());
    let earlier = Some(PrincipalDistanceSource::PupilRatio) == profile.principal_distance_source;
    let options = CalibrationOptions {
        pixel_pitch_mm: given.pixel_pitch_mm.or(profile.pixel_pitch_mm),
        pupil_ratio: given.pupil_ratio.or(profile.pupils.pupil_ratio.filter(|_| earlier)),
        capture_mode: given.capture_mode.or(profile.capture_mode),
        ..given.clone()
    };
    let pitch = dot_pitch_px.unwrap_or(0.0);
    let magnification =
        magnification.or_else(|| options.magnification(pitch).filter(|m| *m > 0.0)).or(profile.magnification);
    let half = 0.5 * f64::from(profile.image_width).hypot(f64::from(profile.image_height));
    let sizes = rail_positions_mm.as_ref().map_or_else(Vec::new, |positions| sizes(profile, slices, positions, half));
    let capture = decided(&sizes, &options, magnification)?;
    // the sizes of a profile without a target tell nothing about the plane in focus
    let known = Known { magnification, sizes: &sizes, capture, pitch_px: [pitch, LEAST_PX / half] };
    let (report, contradictions) = camera::camera(&options, known);
    if report.principal_distance_mm.is_none() || report.pixel_pitch_mm.is_none() {
        let detail = match (report.pixel_pitch_mm, magnification) {
            (None, _) => "not known: give pixel_pitch_mm".to_owned(),
            (_, None) if pitch <= 0.0 => "not known: give magnification and focal_mm".to_owned(),
            (_, Some(_)) if pitch <= 0.0 => "not known: give rail_step_mm, and pupil_ratio or focal_mm".to_owned(),
            _ => report.detail,
        };
        return Err(Error::new(ErrorKind::InvalidProfile, format!("the principal distance is {detail}")));
    }
    let input = ProfileInput {
        rail_positions_mm,
        pixel_pitch_mm: report.pixel_pitch_mm,
        capture_mode: capture,
        principal_distance_mm: report.principal_distance_mm,
        principal_distance_source: Some(report.source),
        pupils: report.pupils,
        magnification,
        ..profile.clone()
    };
    input.check()?;
    Ok((input, contradictions.into_iter().map(|found| Warning::new(found.code, found.detail)).collect()))
}

/// Sizes of the image of the target, relative to the reference slice.
fn sizes(profile: &ProfileInput, slices: &[ProfileSlice], positions: &[f64], half: f64) -> Vec<ScaleSample> {
    let origin = positions.get(profile.reference_index as usize).copied().unwrap_or_default();
    let sample = |(slice, position): (&ProfileSlice, &f64)| {
        let sigma = slice.corner_sigma_px.unwrap_or(UNKNOWN_PX).max(LEAST_PX) / half;
        ScaleSample { position: position - origin, size: 1.0 / slice.scale, sigma }
    };
    let measured = slices.iter().zip(positions).filter(|(slice, _)| !slice.interpolated && slice.scale > 0.0);
    measured.map(sample).collect()
}

/// What moved: as found from the sizes, or as said.
fn decided(
    sizes: &[ScaleSample],
    options: &CalibrationOptions,
    magnification: Option<f64>,
) -> Result<Option<CaptureMode>, Error> {
    let Some(told) = options.capture_mode else {
        return Ok(capture::decide(sizes, true, true, None, magnification).found);
    };
    let grows = SizeLaw::fit(sizes, Some(CaptureMode::FixedLens)).map_or(0.0, |law| law.growth);
    let (low, high) = range(sizes.iter().map(|sample| sample.position));
    if (grows * (high - low)).abs() > NOTICEABLE && (grows > 0.0) == (told == CaptureMode::FixedLens) {
        let detail = format!(
            "towards the object the image would {}, but with {} it does the opposite: rail positions are counted towards the \
             object, so change the sign of rail_step_mm, or capture_mode",
            if grows > 0.0 { "grow" } else { "shrink" },
            capture::name(told)
        );
        return Err(Error::new(ErrorKind::InvalidProfile, detail));
    }
    Ok(Some(told))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::{Homography, lens::Lens};

    const LENS: Lens = Lens { focal_mm: 65.0, magnification: 1.0, pupil_ratio: 1.2 };
    const STEP: f64 = 0.4;

    /// A profile without a camera, as a calibration without any number makes it: pixels of 0.01 mm, and dots 100 px
    /// apart.
    fn measured(mode: CaptureMode) -> (ProfileInput, Vec<ProfileSlice>) {
        let homography = |i: i32| {
            let scale = 1.0 / LENS.size(mode, f64::from(i - 4) * STEP);
            Homography([scale, 0.0, 299.5 * (1.0 - scale), 0.0, scale, 199.5 * (1.0 - scale), 0.0, 0.0, 1.0])
        };
        let input = ProfileInput {
            image_width: 600,
            image_height: 400,
            reference_index: 4,
            homographies: (0..9).map(homography).collect(),
            capture_mode: Some(mode),
            ..ProfileInput::default()
        };
        let mut slices = ProfileSlice::all_given(&input);
        slices.iter_mut().for_each(|slice| slice.corner_sigma_px = Some(0.01));
        (input, slices)
    }

    fn numbers() -> CalibrationOptions {
        CalibrationOptions {
            target_pitch_mm: Some(1.0),
            pixel_pitch_mm: Some(0.01),
            rail_step_mm: Some(STEP),
            ..CalibrationOptions::default()
        }
    }

    fn is_near(found: Option<f64>, expected: f64, share: f64) -> bool {
        found.is_some_and(|found| (found / expected - 1.0).abs() < share)
    }

    #[test]
    fn numbers_that_come_later_make_the_camera_that_a_calibration_would_have_measured() {
        let (profile, slices) = measured(CaptureMode::MovingLens);
        let (with, warnings) = add_camera(&profile, &slices, Some(100.0), None, &numbers()).expect("a camera");
        assert!(is_near(with.principal_distance_mm, LENS.principal_distance(), 1e-3), "{with:?}");
        assert_eq!(with.principal_distance_source, Some(PrincipalDistanceSource::CameraRail));
        assert!(with.pupils.principal_distance_sigma_mm.is_some_and(|sigma| sigma < 1.0) && warnings.is_empty());
        assert_eq!(
            (&with.homographies, with.rail_positions_mm.map(|rail| rail[8])),
            (&profile.homographies, Some(3.2))
        );
        // a second number refines the first
        let ratio = CalibrationOptions { pupil_ratio: Some(1.2), ..numbers() };
        let (profile, slices) = measured(CaptureMode::FixedLens);
        let (with, _) = add_camera(&profile, &slices, Some(100.0), None, &ratio).expect("a camera");
        assert!(is_near(with.principal_distance_mm, LENS.principal_distance(), 1e-3), "{with:?}");
        assert_eq!(with.principal_distance_source, Some(PrincipalDistanceSource::PupilRatio));
    }

    #[test]
    fn a_focal_length_and_a_magnification_make_a_rough_camera_of_any_profile() {
        let (profile, slices) = measured(CaptureMode::FixedLens);
        let rough =
            CalibrationOptions { pixel_pitch_mm: Some(0.01), focal_mm: Some(65.0), ..CalibrationOptions::default() };
        let (with, _) = add_camera(&profile, &slices, None, Some(1.0), &rough).expect("a camera");
        assert!(is_near(with.principal_distance_mm, 130.0, 1e-9), "{with:?}");
        assert!(with.pupils.principal_distance_sigma_mm.is_some_and(|sigma| sigma > 10.0), "it is told to be rough");
    }

    #[test]
    fn what_is_missing_or_contradicts_is_told_and_nothing_is_made_up() {
        let (profile, slices) = measured(CaptureMode::FixedLens);
        let told = |given: CalibrationOptions| {
            add_camera(&profile, &slices, Some(100.0), None, &given).expect_err("no camera").detail
        };
        assert!(told(CalibrationOptions::default()).contains("give pixel_pitch_mm"));
        assert!(told(numbers()).contains("measures only half of it"), "{}", told(numbers()));
        let turned = CalibrationOptions { rail_step_mm: Some(-STEP), ..numbers() };
        let unsure = add_camera(&profile, &slices, None, Some(1.0), &numbers()).expect_err("no camera");
        assert!(unsure.detail.contains("and pupil_ratio or focal_mm"), "{unsure}");
        assert!(told(turned).contains("change the sign of rail_step_mm"));
        let alone =
            add_camera(&profile, &slices, None, None, &CalibrationOptions { pixel_pitch_mm: Some(0.01), ..numbers() });
        assert!(alone.expect_err("no camera").detail.contains("give magnification and focal_mm"));
    }
}
