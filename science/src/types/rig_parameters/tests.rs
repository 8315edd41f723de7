//! Profiles from rig parameters, and what is refused.

use proptest::prelude::*;

use super::*;

fn macro_rig(capture_mode: CaptureMode) -> RigParameters {
    RigParameters {
        image_width: 1200,
        image_height: 800,
        reference_index: Some(1),
        slice_count: Some(3),
        focal_mm: 65.0,
        magnification: 1.0,
        pupil_ratio: None,
        pixel_pitch_mm: Some(0.004),
        rail_positions_mm: None,
        rail_step_mm: Some(0.5),
        capture_mode,
        principal_point_px: None,
        drift_px_per_mm: [0.0, 0.0],
        gains: GainLaw::Optics,
        note: None,
    }
}

fn refused(rig: &RigParameters) -> String {
    rig.profile().expect_err("the test gives something wrong").detail
}

#[test]
fn a_sensor_closer_to_the_lens_sees_a_smaller_image_and_its_slice_is_scaled_up() {
    let profile = macro_rig(CaptureMode::FixedLens).profile().expect("sound");
    let scale = |i: usize| profile.homographies[i].0[0];
    assert!(scale(0) < 1.0 && scale(2) > 1.0, "{profile:?}");
    // d2 = 130 mm at magnification 1
    assert!((scale(2) - 130.0 / 129.5).abs() < 1e-12);
    assert_eq!(profile.principal_distance_mm, Some(130.0));
    assert_eq!(profile.principal_distance_px(), Some(32_500.0));
    assert_eq!(profile.rail_positions_mm, Some(vec![0.0, 0.5, 1.0]));
}

#[test]
fn a_camera_closer_to_the_object_sees_a_larger_image_and_its_slice_is_scaled_down() {
    let profile = macro_rig(CaptureMode::MovingLens).profile().expect("sound");
    let scale = |i: usize| profile.homographies[i].0[0];
    assert!(scale(0) > 1.0 && scale(2) < 1.0, "{profile:?}");
    assert!((scale(2) - 129.5 / 130.0).abs() < 1e-12);
    assert_eq!(profile.gains, None);
}

#[test]
fn a_sensor_farther_from_the_lens_receives_less_light_and_its_slice_is_brightened() {
    let rig = macro_rig(CaptureMode::FixedLens);
    let gains = rig.profile().expect("sound").gains.expect("gains by the optics");
    assert_eq!(gains[1], 1.0);
    assert!((gains[0] - (130.5_f64 / 130.0).powi(2)).abs() < 1e-12 && gains[2] < 1.0, "{gains:?}");
    assert_eq!(RigParameters { gains: GainLaw::None, ..rig }.profile().expect("sound").gains, None);
}

#[test]
fn scales_gains_and_the_principal_distance_follow_the_pupil_ratio() {
    for (pupil_ratio, magnification) in [(0.6, 1.0), (0.6, 2.5), (1.8, 1.0), (1.8, 2.5)] {
        let lens = Lens { focal_mm: 65.0, magnification, pupil_ratio };
        let (e, d) = (65.0 * (magnification + pupil_ratio), 65.0 / magnification + 65.0 / pupil_ratio);
        for (mode, size) in [
            (CaptureMode::FixedLens, 1.0 - 0.5 / e),
            (CaptureMode::MovingLens, d / (d - 0.5)),
            (CaptureMode::LensAlone, (1.0 + 0.5 / e) * d / (d - 0.5)),
        ] {
            let rig = RigParameters { pupil_ratio: Some(pupil_ratio), magnification, ..macro_rig(mode) };
            let profile = rig.profile().expect("sound");
            assert!((profile.homographies[2].0[0] - 1.0 / size).abs() < 1e-12, "{lens:?} {mode:?}");
            let c = profile.principal_distance_mm.expect("known");
            assert!((c - e / pupil_ratio).abs() < 1e-9 && (c - magnification * d).abs() < 1e-9, "{lens:?}");
            assert_eq!(profile.principal_distance_source, Some(PrincipalDistanceSource::PupilRatio));
            let gain = profile.gains.as_ref().map_or(1.0, |gains| gains[2]);
            let distance = match mode {
                CaptureMode::FixedLens => e - 0.5,
                CaptureMode::MovingLens => e,
                CaptureMode::LensAlone => e + 0.5,
            };
            assert!((gain - (distance / e).powi(2)).abs() < 1e-12, "{lens:?} {mode:?}");
        }
    }
    let assumed = macro_rig(CaptureMode::FixedLens).profile().expect("sound");
    assert_eq!(assumed.principal_distance_source, Some(PrincipalDistanceSource::FocalLength));
    assert_eq!((assumed.pupils.pupil_ratio, assumed.pupils.principal_distance_sigma_mm), (Some(1.0), None));
    let wrong = RigParameters { pupil_ratio: Some(0.0), ..macro_rig(CaptureMode::FixedLens) };
    assert_eq!(refused(&wrong), "pupil_ratio is 0; it must be 0.05 to 20");
}

#[test]
fn the_middle_slice_is_the_reference_unless_another_is_named() {
    let rig = RigParameters { reference_index: None, slice_count: Some(7), ..macro_rig(CaptureMode::FixedLens) };
    let profile = rig.profile().expect("sound");
    assert_eq!((profile.reference_index, profile.homographies[3]), (3, Homography::IDENTITY));
}

#[test]
fn impossible_parameters_are_refused_with_a_remedy() {
    let rig = macro_rig(CaptureMode::FixedLens);
    let wrong = RigParameters { rail_step_mm: None, ..rig.clone() };
    assert!(refused(&wrong).starts_with("the rail is missing: give rail_positions_mm"));
    let wrong = RigParameters { rail_positions_mm: Some(vec![0.0, 1.0]), ..rig.clone() };
    assert!(refused(&wrong).contains("both given"));
    let wrong = RigParameters { rail_positions_mm: Some(vec![0.0, 1.0]), rail_step_mm: None, ..rig.clone() };
    assert_eq!(refused(&wrong), "2 rail positions for 3 slices: give one per slice");
    let wrong = RigParameters { slice_count: None, ..rig.clone() };
    assert!(refused(&wrong).starts_with("slice_count is missing"));
    let wrong = RigParameters { rail_step_mm: Some(40.0), slice_count: Some(5), ..rig.clone() };
    assert!(refused(&wrong).contains("where nothing is in focus; check the sign of the rail"));
    let wrong = RigParameters { rail_step_mm: Some(0.0), ..rig.clone() };
    assert!(refused(&wrong).starts_with("rail_step_mm is 0"));
    let wrong = RigParameters { magnification: f64::NAN, ..rig.clone() };
    assert!(refused(&wrong).starts_with("magnification is NaN; it must be 0.0001 to 1000"));
    let wrong = RigParameters { reference_index: Some(3), ..rig };
    assert_eq!(refused(&wrong), "reference_index is 3, but the stack has 3 slices: use an index from 0 to 2");
    let near = RigParameters { rail_step_mm: Some(140.0), ..macro_rig(CaptureMode::MovingLens) };
    assert!(refused(&near).contains("towards an object that is 130.00 mm away"));
}

#[test]
fn every_error_points_at_a_parameter() {
    let rig = macro_rig(CaptureMode::FixedLens);
    let positions = |rail: &[f64]| RigParameters {
        reference_index: None,
        slice_count: None,
        rail_step_mm: None,
        rail_positions_mm: Some(rail.to_vec()),
        ..rig.clone()
    };
    let moving = macro_rig(CaptureMode::MovingLens);
    let far = RigParameters { focal_mm: 10_000.0, magnification: 10.0, ..moving.clone() };
    let grown = RigParameters { reference_index: Some(0), rail_step_mm: Some(-200.0), ..moving };
    let near = RigParameters { rail_step_mm: Some(40.0), slice_count: Some(5), ..rig.clone() };
    for (wrong, pointer, part) in [
        (positions(&[]), "/rail_positions_mm", "has 0 entries"),
        (positions(&[0.0]), "/rail_positions_mm", "has 1 entries"),
        (positions(&[0.0, 1.0, 0.5]), "/rail_positions_mm", "slice 2 at 0.5 mm"),
        (far, "/magnification", "110000 mm from the lens"),
        (grown, "/rail_step_mm", "scales the image"),
        (near, "/rail_step_mm", "check the sign of the rail"),
    ] {
        let error = wrong.profile().expect_err("impossible");
        let own = |location: &ErrorLocation| location.pointer.as_deref() == Some(pointer);
        assert!(error.detail.contains(part) && error.locations.iter().all(own), "{pointer}: {error:?}");
    }
}

prop_compose! {
    fn any_rig()(
        moving: bool, focal_mm in 20.0..200.0_f64, magnification in 0.2..5.0_f64, point in [300.0..900.0_f64, 200.0..600.0_f64],
        drift_px_per_mm in [-20.0..20.0_f64, -20.0..20.0_f64], step in 0.01..0.2_f64, falls: bool, reference in 0..9_u32,
    ) -> RigParameters {
        RigParameters {
            focal_mm,
            magnification,
            principal_point_px: Some(point),
            drift_px_per_mm,
            rail_step_mm: Some(if falls { -step } else { step }),
            reference_index: Some(reference),
            slice_count: Some(9),
            ..macro_rig(if moving { CaptureMode::MovingLens } else { CaptureMode::FixedLens })
        }
    }
}

proptest! {
    #[test]
    fn the_reference_is_the_identity_and_every_principal_point_maps_to_the_reference(rig in any_rig()) {
        let profile = rig.profile().expect("every rig of this kind is sound");
        let reference = rig.reference_index.expect("named") as usize;
        let rail = profile.rail_positions_mm.as_ref().expect("kept");
        let point = profile.principal_point_px.expect("kept");
        prop_assert!(profile.homographies[reference].is_identity());
        for (homography, z) in profile.homographies.iter().zip(rail) {
            let dz = z - rail[reference];
            let wandered = [0, 1].map(|axis| point[axis] + rig.drift_px_per_mm[axis] * dz);
            let home = homography.apply(wandered);
            prop_assert!((home[0] - point[0]).hypot(home[1] - point[1]) < 1e-6);
        }
    }

    #[test]
    fn the_scale_follows_the_sign_of_the_rail(rig in any_rig()) {
        let profile = rig.profile().expect("every rig of this kind is sound");
        let rail = profile.rail_positions_mm.as_ref().expect("kept");
        let reference = rig.reference_index.expect("named") as usize;
        for (homography, z) in profile.homographies.iter().zip(rail) {
            // towards the object the image shrinks with a fixed lens and grows with a moving one
            let dz = z - rail[reference];
            let larger = (dz > 0.0) == (rig.capture_mode == CaptureMode::MovingLens);
            prop_assert!(dz == 0.0 || (homography.0[0] < 1.0) == larger);
        }
    }

    #[test]
    fn with_a_fixed_lens_a_profile_rebased_on_another_slice_is_the_profile_of_that_reference(rig in any_rig(), other in 0..9_u32) {
        let rig = RigParameters { capture_mode: CaptureMode::FixedLens, drift_px_per_mm: [0.0; 2], ..rig };
        let profile = rig.profile().expect("sound");
        let reference = rig.reference_index.expect("named");
        let step = rig.rail_step_mm.expect("a step");
        // the same lens and sensor, described from the other slice
        let distance = rig.lens().image_distance() - (f64::from(other) - f64::from(reference)) * step;
        let other_rig = RigParameters { magnification: distance / rig.focal_mm - 1.0, reference_index: Some(other), ..rig };
        let expected = other_rig.profile().expect("sound");
        let back = profile.homographies[other as usize].inverse().expect("invertible");
        for (a, b) in profile.homographies.iter().zip(&expected.homographies) {
            let a = a.then(&back).expect("finite");
            prop_assert!(a.corner_distance(b, 1200, 800) < 1e-6);
        }
    }
}
