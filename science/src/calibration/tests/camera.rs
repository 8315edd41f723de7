//! The camera of rendered targets: lenses with pupils of different width, and whatever moves.

use super::super::*;
use crate::synth::{DotTarget, Rig, target_stack};
use crate::types::{NoControl, profile::CaptureMode, pupils::PrincipalDistanceSource};

/// A rig of 9 slices at a magnification of 1.6, whose image grows by about 5 %.
fn rig(pupil_ratio: f64, mode: CaptureMode) -> Rig {
    breathing(pupil_ratio, mode, 0.025)
}

/// The same, whose image grows by `share` either way.
fn breathing(pupil_ratio: f64, mode: CaptureMode, share: f64) -> Rig {
    let base = Rig { channels: 1, pupil_ratio, magnification: 1.6, noise: 0.5, ..Rig::sized(480, 360, 9) }.ideal();
    let lens = base.lens();
    let reach = match mode {
        CaptureMode::FixedLens => share * lens.exit_pupil_distance(),
        CaptureMode::MovingLens => share * lens.entrance_pupil_distance(),
        CaptureMode::LensAlone => share / (1.0 / lens.exit_pupil_distance() + 1.0 / lens.entrance_pupil_distance()),
    };
    // the renderer counts the sensor away from the lens, and the others towards the object
    let sign = if mode == CaptureMode::FixedLens { -1.0 } else { 1.0 };
    Rig { mode, rail_mm: (-4..=4).map(|i| sign * reach * f64::from(i) / 4.0).collect(), ..base }
}

/// The target, with an aperture that blurs it by up to 0.1 pitches.
fn with_target(rig: Rig) -> (Rig, DotTarget) {
    let target = DotTarget::for_rig(&rig, 16);
    (super::rig::blurred(rig, &target, 0.1), target)
}

fn options(rig: &Rig, target: &DotTarget) -> CalibrationOptions {
    let sign = if rig.mode == CaptureMode::FixedLens { -1.0 } else { 1.0 };
    CalibrationOptions {
        rail_positions_mm: Some(rig.rail_mm.iter().map(|z| sign * z).collect()),
        pixel_pitch_mm: Some(rig.pixel_pitch_mm),
        target_pitch_mm: Some(target.pitch_mm),
        ..CalibrationOptions::default()
    }
}

fn measured(rig: &Rig, target: &DotTarget, options: &CalibrationOptions) -> Calibration {
    calibrate(&&target_stack(rig, target)[..], options, &NoControl).expect("a calibration")
}

fn is_near(found: Option<f64>, truth: f64) -> bool {
    found.is_some_and(|found| (found / truth - 1.0).abs() < 0.005)
}

fn measured_by_a_rail_of_the_camera(pupil_ratios: &[f64]) {
    for &pupil_ratio in pupil_ratios {
        let (rig, target) = with_target(rig(pupil_ratio, CaptureMode::MovingLens));
        let calibration = measured(&rig, &target, &options(&rig, &target));
        let camera = &calibration.report.camera;
        assert_eq!(calibration.capture_mode, Some(CaptureMode::MovingLens), "{:?}", calibration.report.capture);
        assert_eq!(camera.source, PrincipalDistanceSource::CameraRail);
        assert!(is_near(camera.principal_distance_mm, rig.lens().principal_distance()), "P {pupil_ratio}: {camera:?}");
        assert!(calibration.verdict.contains("; principal distance "), "{}", calibration.verdict);
    }
}

#[test]
fn a_rail_of_the_camera_measures_the_principal_distance_of_any_lens() {
    measured_by_a_rail_of_the_camera(&[1.8]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_lenses_are_measured_by_a_rail_of_the_camera() {
    measured_by_a_rail_of_the_camera(&[0.6, 1.0]);
}

fn measured_by_a_rail_of_the_sensor(pupil_ratios: &[f64]) {
    for &pupil_ratio in pupil_ratios {
        let (rig, target) = with_target(rig(pupil_ratio, CaptureMode::FixedLens));
        let lens = rig.lens();
        let alone = options(&rig, &target);
        let calibration = measured(&rig, &target, &alone);
        let camera = &calibration.report.camera;
        assert_eq!((camera.principal_distance_mm, camera.source), (None, PrincipalDistanceSource::Unknown));
        assert!(is_near(camera.pupils.exit_pupil_distance_mm, lens.exit_pupil_distance()), "{camera:?}");
        assert!(calibration.verdict.contains("principal distance not known"), "{}", calibration.verdict);

        // nearer than what is in focus in the first slice, and blurred by up to 0.4 pitches
        let near = DotTarget { depth: Some(-1.0), ..target.clone() };
        let advance = rig.object_distance(rig.focus_fraction(rig.reference)) - rig.object_distance(-1.0);
        let pitch = measured(&rig, &near, &alone).dot_pitch_px;
        let moved = CalibrationOptions {
            focal_mm: Some(65.0),
            target_advance_mm: Some(advance),
            moved_target_pitch_px: Some(pitch),
            ..alone
        };
        let calibration = measured(&rig, &target, &moved);
        let camera = &calibration.report.camera;
        assert_eq!(camera.source, PrincipalDistanceSource::MovedTarget);
        assert!(is_near(camera.principal_distance_mm, lens.principal_distance()), "P {pupil_ratio}: {camera:?}");
        assert!(
            is_near(camera.pupils.pupil_ratio, pupil_ratio) && is_near(camera.measured_focal_mm, 65.0),
            "{camera:?}"
        );
        let codes: Vec<&str> = calibration.warnings.iter().map(|w| w.code.as_str()).collect();
        assert!(!codes.iter().any(|code| code.ends_with("_disagrees")), "{codes:?}");
    }
}

#[test]
fn a_rail_of_the_sensor_measures_it_with_a_moved_target_and_says_unknown_without() {
    measured_by_a_rail_of_the_sensor(&[0.6]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_lenses_are_measured_by_a_rail_of_the_sensor() {
    measured_by_a_rail_of_the_sensor(&[1.8]);
}

#[test]
fn one_picture_of_the_moved_target_measures_what_a_second_calibration_does() {
    let (rig, target) = with_target(rig(1.8, CaptureMode::FixedLens));
    let near = DotTarget { depth: Some(-1.0), ..target.clone() };
    let advance = rig.object_distance(rig.focus_fraction(rig.reference)) - rig.object_distance(-1.0);
    let (slices, moved) = (target_stack(&rig, &target), target_stack(&rig, &near));
    let alone = CalibrationOptions { target_advance_mm: Some(advance), ..options(&rig, &target) };
    let pitch = calibrate(&&moved[..], &options(&rig, &target), &NoControl).expect("a calibration").dot_pitch_px;
    let by_id = CalibrationOptions { moved_target_pitch_px: Some(pitch), ..alone.clone() };
    let by_id = calibrate(&&slices[..], &by_id, &NoControl).expect("a calibration").report.camera;
    assert!(is_near(by_id.principal_distance_mm, rig.lens().principal_distance()), "{by_id:?}");
    let one = rig.reference..=rig.reference;
    for moved in [&moved[..], &moved[one]] {
        let calibration = calibrate_with_moved(&&slices[..], Some(&moved), &alone, &NoControl).expect("a calibration");
        assert_eq!(calibration.report.camera, by_id);
    }

    let dark = moved[0].clone();
    let dark = crate::imaging::Raster::eight(dark.width, dark.height, 1, vec![9; dark.width * dark.height]);
    let refused = calibrate_with_moved(&&slices[..], Some(&&[dark][..]), &alone, &NoControl);
    assert!(matches!(refused, Err(Interrupted::Failed(error)) if error.kind == ErrorKind::TargetNotFound));
}

#[test]
fn a_lens_that_moves_alone_is_recognised_and_leaves_the_distance_unknown() {
    let (rig, target) = with_target(rig(0.6, CaptureMode::LensAlone));
    let calibration = measured(&rig, &target, &options(&rig, &target));
    assert_eq!(calibration.capture_mode, Some(CaptureMode::LensAlone), "{:?}", calibration.report.capture);
    assert_eq!(calibration.report.camera.principal_distance_mm, None);
}

#[test]
fn a_wrong_focal_length_is_named_and_the_verdict_says_so() {
    let (rig, target) = with_target(rig(1.0, CaptureMode::MovingLens));
    let wrong = CalibrationOptions { focal_mm: Some(120.0), ..options(&rig, &target) };
    let calibration = measured(&rig, &target, &wrong);
    let finding = super::rig::sentence(&calibration, "focal_length_disagrees");
    assert!(finding.starts_with("focal_mm is 120,"), "{finding}");
    assert!(calibration.verdict.ends_with("; see focal_length_disagrees"), "{}", calibration.verdict);
    assert!(is_near(calibration.report.camera.principal_distance_mm, rig.lens().principal_distance()));
}

/// Each capture mode, with the numbers of the rig given or not.
fn predicted_slices(cases: &[(CaptureMode, bool)]) {
    for &(mode, is_specified) in cases {
        let (rig, target) = with_target(breathing(1.0, mode, 0.08));
        let mut slices = target_stack(&rig, &target);
        for lost in [0, 6] {
            slices[lost] = crate::imaging::Raster::eight(rig.width, rig.height, 1, vec![150; rig.width * rig.height]);
        }
        let options = if is_specified { options(&rig, &target) } else { CalibrationOptions::default() };
        let calibration = calibrate(&&slices[..], &options, &NoControl).expect("a calibration");
        for lost in [0, 6] {
            let slice = &calibration.slices[lost];
            let error = slice.homography.corner_distance(&rig.homography(lost), 480, 360);
            assert!(slice.interpolated && error < 0.1, "{mode:?}, slice {lost}: {error} px");
            let sigma = slice.corner_sigma_px.expect("known");
            assert!(sigma < 0.15 && error < 4.0 * sigma, "{mode:?}, slice {lost}: {sigma} px");
        }
    }
}

#[test]
fn slices_that_show_no_dots_are_predicted_whatever_moves() {
    predicted_slices(&[
        (CaptureMode::FixedLens, false),
        (CaptureMode::MovingLens, true),
        (CaptureMode::LensAlone, false),
    ]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_slices_that_show_no_dots_are_predicted_whatever_moves() {
    predicted_slices(&[
        (CaptureMode::FixedLens, true),
        (CaptureMode::MovingLens, false),
        (CaptureMode::LensAlone, true),
    ]);
}

#[test]
fn a_slice_without_dots_is_predicted_where_the_camera_took_a_longer_step() {
    let (rig, target) = with_target(breathing(1.0, CaptureMode::MovingLens, 0.08));
    let mut slices = target_stack(&rig, &target);
    slices[0] = crate::imaging::Raster::eight(rig.width, rig.height, 1, vec![150; rig.width * rig.height]);
    slices.remove(6);
    let options = CalibrationOptions {
        capture_mode: Some(CaptureMode::MovingLens),
        reference_index: Some(4),
        ..CalibrationOptions::default()
    };
    let calibration = calibrate(&&slices[..], &options, &NoControl).expect("a calibration");
    let first = &calibration.slices[0];
    let error = first.homography.corner_distance(&rig.homography(0), 480, 360);
    let sigma = first.corner_sigma_px.expect("known");
    assert!(first.interpolated && error < 0.3_f64.max(3.0 * sigma), "{error} px, told {sigma}");
}
