//! The camera of every mode, with right, missing and wrong numbers.

use super::*;
use crate::calibration::size_law::ScaleSample;
use crate::types::{WarningCode, profile::CaptureMode};

const RIG: Lens = Lens { focal_mm: 65.0, magnification: 1.0, pupil_ratio: 1.0 };

fn sizes(lens: Lens, mode: CaptureMode) -> Vec<ScaleSample> {
    let z = |i: i32| f64::from(i) * 0.6;
    (-4..=4).map(|i| ScaleSample { position: z(i), size: lens.size(mode, z(i)), sigma: 2e-5 }).collect()
}

fn numbers() -> CalibrationOptions {
    CalibrationOptions { target_pitch_mm: Some(1.0), pixel_pitch_mm: Some(0.01), ..CalibrationOptions::default() }
}

/// With a moved target: its pitch follows from D.
fn with_target_moved(lens: Lens, by: f64) -> CalibrationOptions {
    let depth = lens.entrance_pupil_distance();
    let pitch = 100.0 * lens.magnification * depth / (depth - by);
    CalibrationOptions { target_advance_mm: Some(by), moved_target_pitch_px: Some(pitch), ..numbers() }
}

fn of(lens: Lens, mode: CaptureMode, options: &CalibrationOptions) -> (CameraReport, Vec<Contradiction>) {
    let sizes = sizes(lens, mode);
    let pitch_px = [100.0 * lens.magnification, 2e-5];
    camera(options, Known { magnification: Some(lens.magnification), sizes: &sizes, capture: Some(mode), pitch_px })
}

fn lenses() -> impl Iterator<Item = Lens> {
    let all = |pupil_ratio| [0.5, 1.0, 2.5].map(|magnification| Lens { focal_mm: 65.0, magnification, pupil_ratio });
    [0.6, 1.0, 1.8].into_iter().flat_map(all)
}

fn is(found: Option<f64>, expected: f64) -> bool {
    found.is_some_and(|found| (found / expected - 1.0).abs() < 1e-4)
}

#[test]
fn a_rail_of_the_camera_measures_the_principal_distance_without_a_focal_length() {
    for lens in lenses() {
        for focal_mm in [None, Some(65.0)] {
            let (report, contradictions) =
                of(lens, CaptureMode::MovingLens, &CalibrationOptions { focal_mm, ..numbers() });
            assert!(is(report.principal_distance_mm, lens.principal_distance()), "{lens:?}: {report:?}");
            assert!(is(report.pupils.entrance_pupil_distance_mm, lens.entrance_pupil_distance()));
            assert_eq!((report.source, contradictions), (PrincipalDistanceSource::CameraRail, Vec::new()));
            let sigma = report.pupils.principal_distance_sigma_mm.expect("known") / lens.principal_distance();
            assert!((1e-3..5e-3).contains(&sigma), "{sigma}");
        }
    }
}

#[test]
fn a_rail_of_the_sensor_or_of_the_lens_alone_leaves_it_unknown_without_another_fact() {
    for lens in lenses() {
        for mode in [CaptureMode::FixedLens, CaptureMode::LensAlone] {
            let (report, contradictions) = of(lens, mode, &numbers());
            assert_eq!((report.principal_distance_mm, report.source), (None, PrincipalDistanceSource::Unknown));
            assert!(report.detail.contains("folder moved/") && contradictions.is_empty(), "{}", report.detail);
            let exit = report.pupils.exit_pupil_distance_mm;
            assert!(if mode == CaptureMode::FixedLens { is(exit, lens.exit_pupil_distance()) } else { exit.is_none() });
        }
    }
}

#[test]
fn a_moved_target_measures_the_whole_lens_whatever_moves() {
    for lens in lenses() {
        for (mode, by) in [(CaptureMode::FixedLens, 5.0), (CaptureMode::FixedLens, -3.0), (CaptureMode::LensAlone, 5.0)]
        {
            let options = CalibrationOptions { focal_mm: Some(65.0), ..with_target_moved(lens, by) };
            let (report, contradictions) = of(lens, mode, &options);
            assert!(is(report.principal_distance_mm, lens.principal_distance()), "{lens:?} {mode:?}: {report:?}");
            assert!(is(report.pupils.exit_pupil_distance_mm, lens.exit_pupil_distance()), "{lens:?} {mode:?}");
            assert!(is(report.pupils.pupil_ratio, lens.pupil_ratio) && is(report.measured_focal_mm, 65.0));
            assert_eq!((report.source, contradictions), (PrincipalDistanceSource::MovedTarget, Vec::new()));
        }
    }
}

#[test]
fn a_specified_ratio_or_focal_length_gives_the_distance_with_its_error_carried_through() {
    for lens in lenses() {
        let ratio = CalibrationOptions { pupil_ratio: Some(lens.pupil_ratio), ..numbers() };
        for mode in [CaptureMode::FixedLens, CaptureMode::LensAlone] {
            let (report, contradictions) = of(lens, mode, &ratio);
            assert!(is(report.principal_distance_mm, lens.principal_distance()), "{lens:?} {mode:?}: {report:?}");
            assert_eq!((report.source, contradictions), (PrincipalDistanceSource::PupilRatio, Vec::new()));
        }
        let focal = CalibrationOptions { focal_mm: Some(65.0), ..numbers() };
        let (report, contradictions) = of(lens, CaptureMode::FixedLens, &focal);
        assert!(is(report.principal_distance_mm, lens.principal_distance()), "{lens:?}: {report:?}");
        assert_eq!((report.source, contradictions), (PrincipalDistanceSource::FocalLength, Vec::new()));
        // (1 + M / P) times the error of the focal length
        let share = 1.0 + lens.magnification / lens.pupil_ratio;
        let sigma = report.pupils.principal_distance_sigma_mm.expect("known") / lens.principal_distance();
        assert!((sigma / (0.1 * share) - 1.0).abs() < 0.01, "{lens:?}: {sigma}");
    }
}

#[test]
fn a_wrong_focal_length_is_named_or_covered_and_never_passes() {
    let wrong =
        |focal: f64, mode: CaptureMode| of(RIG, mode, &CalibrationOptions { focal_mm: Some(focal), ..numbers() });
    for mode in [CaptureMode::FixedLens, CaptureMode::MovingLens] {
        let (report, contradictions) = wrong(100.0, mode);
        let [named] = &contradictions[..] else { panic!("{contradictions:?}") };
        assert_eq!(named.code, WarningCode::FocalLengthDisagrees);
        assert!(named.detail.contains("focal_mm is 100"), "{}", named.detail);
        let measured = if mode == CaptureMode::MovingLens { Some(130.0) } else { None };
        assert!(report.principal_distance_mm.is_none_or(|c| is(measured, c)), "{report:?}");
    }
    for focal in [54.0, 78.0] {
        let (report, _) = wrong(focal, CaptureMode::FixedLens);
        let (found, sigma) = (report.principal_distance_mm, report.pupils.principal_distance_sigma_mm);
        assert!((found.expect("rough") - 130.0).abs() < 3.0 * sigma.expect("known"), "{report:?}");
    }
    // without a rail: the pupil ratio is assumed
    let known = Known { magnification: Some(1.0), sizes: &[], capture: None, pitch_px: [100.0, 2e-5] };
    let (report, _) = camera(&CalibrationOptions { focal_mm: Some(65.0), ..numbers() }, known);
    let truth = Lens { pupil_ratio: 1.6, ..RIG }.principal_distance();
    let (found, sigma) = (report.principal_distance_mm, report.pupils.principal_distance_sigma_mm);
    assert!((found.expect("rough") - truth).abs() < 3.0 * sigma.expect("known"), "{report:?}");
}

#[test]
fn numbers_that_are_wrong_by_five_percent_are_named_where_the_lens_is_measured() {
    for lens in lenses() {
        let right = CalibrationOptions {
            focal_mm: Some(65.0),
            pupil_ratio: Some(lens.pupil_ratio),
            ..with_target_moved(lens, 5.0)
        };
        assert_eq!(of(lens, CaptureMode::FixedLens, &right).1, []);
        for (wrong, code) in [
            (CalibrationOptions { focal_mm: Some(68.3), ..right.clone() }, "focal_length_disagrees"),
            (
                CalibrationOptions { pupil_ratio: Some(1.06 * lens.pupil_ratio), ..right.clone() },
                "pupil_ratio_disagrees",
            ),
            (CalibrationOptions { target_advance_mm: Some(5.5), ..right.clone() }, "pupil_ratio_disagrees"),
            (CalibrationOptions { target_advance_mm: Some(-5.0), ..right.clone() }, "target_advance_disagrees"),
        ] {
            let (_, contradictions) = of(lens, CaptureMode::FixedLens, &wrong);
            assert!(contradictions.iter().any(|c| c.code == code), "{lens:?}, {code}: {contradictions:?}");
        }
        let advance = CalibrationOptions { target_advance_mm: Some(5.5), ..right };
        let (_, contradictions) = of(lens, CaptureMode::MovingLens, &advance);
        assert_eq!(contradictions[0].code, WarningCode::TargetAdvanceDisagrees);
        assert!(contradictions[0].detail.contains("5.000 mm would agree"), "{}", contradictions[0].detail);
    }
}

#[test]
fn two_specified_numbers_that_contradict_each_other_are_named_and_put_the_distance_in_doubt() {
    let options = CalibrationOptions { focal_mm: Some(65.0), pupil_ratio: Some(1.2), ..numbers() };
    let (report, contradictions) = of(RIG, CaptureMode::FixedLens, &options);
    assert_eq!(contradictions[0].code, WarningCode::FocalLengthDisagrees);
    let (found, sigma) = (report.principal_distance_mm, report.pupils.principal_distance_sigma_mm);
    assert!((found.expect("known") - 130.0).abs() < 2.0 * sigma.expect("known"), "{report:?}");
}

#[test]
fn what_would_make_it_known_is_said() {
    let none = Known { magnification: None, sizes: &[], capture: None, pitch_px: [100.0, 2e-5] };
    let detail = |known: Known| camera(&numbers(), known).0.detail;
    assert!(detail(none).contains("target_pitch_mm"));
    assert!(detail(Known { magnification: Some(1.0), ..none }).contains("rail_step_mm"));
    let sizes = sizes(RIG, CaptureMode::MovingLens);
    assert!(detail(Known { magnification: Some(1.0), sizes: &sizes, ..none }).contains("capture_mode"));
}
