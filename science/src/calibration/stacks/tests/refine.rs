//! Refinement of profiles that a dot target made, and the capture mode that pictures show, against the truth.

use super::*;
use crate::calibration::calibrate as by_target;
use crate::synth::{DotTarget, target_stack};
use crate::types::Homography;
use crate::types::profile::{CaptureMode, ProfileInput};

fn rig() -> Rig {
    Rig { softness_px: 0.5, ..Rig::sized(540, 360, 9) }
}

/// The profile of a rig by its dot target, with a camera that no stack knows.
fn profile(rig: &Rig) -> ProfileInput {
    let slices = target_stack(rig, &DotTarget::for_rig(rig, 14));
    let found = by_target(&&slices[..], &CalibrationOptions::default(), &NoControl).expect("a profile");
    ProfileInput {
        image_width: found.width,
        image_height: found.height,
        reference_index: found.reference_index as u32,
        homographies: found.slices.iter().map(|slice| slice.homography).collect(),
        gains: Some(found.slices.iter().map(|slice| slice.gain).collect()),
        capture_mode: Some(rig.mode),
        principal_distance_mm: Some(121.5),
        pixel_pitch_mm: Some(0.005),
        magnification: Some(1.25),
        ..ProfileInput::default()
    }
}

fn refined(rig: &Rig, scene: &Scene, input: &ProfileInput) -> Calibration {
    let from = Revision { name: "revision 3", input, model: crate::types::profile::HomographyModel::Homography };
    let slices = rendered(rig, scene);
    refine_by_stacks(&[&slices], &from, &CalibrationOptions::default(), &NoControl).expect("a profile")
}

/// Largest distance of a corner from the truth of `rig`, px.
fn off(homographies: &[Homography], rig: &Rig) -> f64 {
    let distance = |(i, h): (usize, &Homography)| h.corner_distance(&rig.homography(i), 540, 360);
    homographies.iter().enumerate().map(distance).fold(0.0, f64::max)
}

fn homographies(found: &Calibration) -> Vec<Homography> {
    found.slices.iter().map(|slice| slice.homography).collect()
}

#[test]
fn a_rig_that_has_not_moved_keeps_the_profile_of_its_target() {
    for rig in [rig(), rig().moving_lens()] {
        let input = profile(&rig);
        for scene in [Scene::weave(1), Scene::plates(2)] {
            let found = refined(&rig, &scene, &input);
            let detail = &found.warnings[0].detail;
            assert!(detail.contains("no drift since revision 3"), "{:?}: {detail}", rig.mode);
            for (kept, before) in homographies(&found).iter().zip(&input.homographies) {
                assert!(kept.corner_distance(before, 540, 360) < 1e-6);
            }
            assert!(found.report.candidates[0].chosen && found.report.model_reason.contains("no change"));
        }
    }
}

#[test]
fn a_rig_that_has_shifted_by_a_known_amount_is_refined_and_keeps_its_camera() {
    for before in [rig(), rig().moving_lens()] {
        let input = profile(&before);
        // the rail was set at another angle, and one slice is displaced
        let mut displaced = vec![[0.0; 2]; 9];
        displaced[6] = [1.5, -1.0];
        let [x, y] = before.drift_px;
        let tilted = Rig { drift_px: [x + 5.0, y - 3.0], ..before.clone() };
        for after in [tilted.clone(), Rig { displaced_px: displaced, ..tilted }] {
            let found = refined(&after, &Scene::weave(3), &input);
            let (old, new) = (off(&input.homographies, &after), off(&homographies(&found), &after));
            assert!(old > 2.0 && new < 0.35, "{:?}: {new} px, before {old} px", after.mode);
            let detail = &found.warnings[0].detail;
            assert!(detail.contains("has drifted since revision 3"), "{detail}");
            let told: f64 = detail.split("up to ").nth(1).and_then(|t| t.split(' ').next()?.parse().ok()).expect("px");
            assert!((told - old).abs() < 0.4, "{told} px told, {old} px true");
            assert!(found.verdict.contains("revision 3 refined"), "{}", found.verdict);
            let camera = &found.report.camera;
            assert_eq!((camera.principal_distance_mm, camera.pixel_pitch_mm), (Some(121.5), Some(0.005)));
            assert_eq!((found.magnification, found.capture_mode), (Some(1.25), Some(after.mode)));
            let gains: Vec<f64> = found.slices.iter().map(|slice| slice.gain).collect();
            assert_eq!(Some(gains), input.gains);
        }
    }
}

#[test]
fn stacks_of_another_shape_than_the_revision_are_refused() {
    let rig = Rig::sized(120, 80, 3);
    let slices = rendered(&rig, &Scene::weave(1));
    let input = ProfileInput {
        image_width: 120,
        image_height: 80,
        reference_index: 1,
        homographies: vec![Homography::IDENTITY; 3],
        ..ProfileInput::default()
    };
    let refused = |input: &ProfileInput| {
        let from = Revision { name: "revision 3", input, model: crate::types::profile::HomographyModel::Homography };
        match refine_by_stacks(&[&slices], &from, &CalibrationOptions::default(), &NoControl) {
            Err(Interrupted::Failed(error)) => error,
            other => panic!("{:?}", other.map(|found| found.verdict)),
        }
    };
    let error = refused(&ProfileInput { homographies: vec![Homography::IDENTITY; 4], ..input.clone() });
    assert_eq!(error.kind, ErrorKind::SliceCountMismatch);
    assert!(error.detail.contains("3 slices") && error.detail.contains("revision 3 has 4"), "{}", error.detail);
    let error = refused(&ProfileInput { image_width: 160, ..input });
    assert_eq!(error.kind, ErrorKind::SizeMismatch);
    assert!(error.detail.contains("160 x 80"), "{}", error.detail);
}

#[test]
fn the_capture_mode_that_pictures_show_is_the_true_one_or_unknown() {
    let fixed = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 7) };
    let equal = Rig { exposure_falls: false, ..fixed.clone() };
    // too little growth for the parallax
    let slight =
        |rig: Rig| Rig { rail_mm: rig.rail_mm.iter().map(|z| z / 5.0).collect(), f_number: rig.f_number / 5.0, ..rig };
    let rigs = [
        (fixed.clone(), true),
        (slight(fixed.clone()), true),
        (equal.clone(), false),
        (fixed.clone().moving_lens(), false),
        (slight(fixed).moving_lens(), false),
    ];
    let mut moving_found = 0;
    for (rig, must_be_found) in rigs {
        for scene in [Scene::insect(1), Scene::plates(3)] {
            let slices = rendered(&rig, &scene);
            let found = calibrate_by_stacks(&[&slices], &CalibrationOptions::default(), &NoControl).expect("a profile");
            let capture = found.report.capture;
            assert!(capture.found.is_none_or(|mode| mode == rig.mode), "{:?}: {capture:?}", rig.mode);
            assert_eq!(capture.found.is_some(), capture.confidence.is_some_and(|p| p > 0.95), "{capture:?}");
            assert!(capture.found.is_some() || !must_be_found, "{capture:?}");
            assert!(found.warnings[0].detail.contains(&capture.detail), "{}", found.warnings[0].detail);
            moving_found += usize::from(capture.found == Some(CaptureMode::MovingLens));
        }
    }
    assert!(moving_found >= 1, "none of 2 with growth enough");
}
