//! Calibration on synthetic rigs with defects: too much blur, a missing slice, a bump, a tilted target.

use super::super::*;
use super::worst_corner;
use crate::imaging::{Raster, Samples};
use crate::synth::{DotTarget, Rig, target_stack};
use crate::types::profile::{CaptureMode, HomographyModel};
use crate::types::{Homography, NoControl, calibration_options::ModelChoice};

pub(super) fn rig(slices: usize) -> Rig {
    Rig { channels: 1, ..Rig::sized(480, 360, slices) }
}

fn with(pictures: &[Raster], options: &CalibrationOptions) -> Calibration {
    calibrate(&pictures, options, &NoControl).expect("a calibration")
}

pub(super) fn measured(pictures: &[Raster]) -> Calibration {
    with(pictures, &CalibrationOptions::default())
}

fn truths(rig: &Rig) -> Vec<Homography> {
    (0..rig.slices()).map(|i| rig.homography(i)).collect()
}

/// The rig with an aperture that gives this blur radius, as a share of the pitch, at the more blurred end of the stack.
pub(super) fn blurred(rig: Rig, target: &DotTarget, share: f64) -> Rig {
    let last = rig.slices() - 1;
    let now = [0, last].map(|i| target.blur_radius_px(&rig, i) / target.pitch_px(&rig, i));
    Rig { f_number: rig.f_number * now[0].max(now[1]) / share, ..rig }
}

fn codes(calibration: &Calibration) -> Vec<&str> {
    calibration.warnings.iter().map(|w| w.code.as_str()).collect()
}

pub(super) fn sentence<'a>(calibration: &'a Calibration, code: &str) -> &'a str {
    let warning = calibration.warnings.iter().find(|w| w.code == code);
    &warning.unwrap_or_else(|| panic!("no {code} among {:?}", calibration.warnings)).detail
}

#[test]
fn blur_up_to_045_of_the_pitch_is_measured_and_beyond_it_the_rail_law_predicts() {
    for share in [0.45, 0.7] {
        let plain = rig(9);
        let target = DotTarget::for_rig(&plain, 16);
        let rig = blurred(plain, &target, share);
        let calibration = measured(&target_stack(&rig, &target));
        let worst = worst_corner(&calibration, &truths(&rig));
        assert!(worst < 0.3, "blur {share}: {worst} px");
        let honest = calibration.slices.iter().zip(truths(&rig)).filter(|(s, _)| s.corner_sigma_px > Some(0.0));
        for (slice, truth) in honest {
            let error = slice.homography.corner_distance(&truth, 480, 360);
            assert!(error < 4.0 * slice.corner_sigma_px.unwrap_or(0.0), "slice {}: {error}", slice.index);
        }
        for (i, slice) in calibration.report.slices.iter().enumerate() {
            let blur = target.blur_radius_px(&rig, i);
            if let Some(found) = slice.blur_radius_px.filter(|_| blur > 3.0) {
                assert!((found / blur - 1.0).abs() < 0.25, "blur of slice {i}: {found} for {blur}");
            }
        }
    }
}

#[test]
fn a_missing_and_a_doubled_slice_are_reported_and_do_no_harm() {
    let rig = rig(11);
    let target = DotTarget::for_rig(&rig, 16);
    let mut pictures = target_stack(&rig, &target);
    let mut expected = truths(&rig);
    let doubled = pictures[7].clone();
    pictures.insert(8, doubled);
    expected.insert(8, expected[7]);
    pictures.remove(2);
    expected.remove(2);
    let reference = CalibrationOptions { reference_index: Some(4), ..CalibrationOptions::default() };
    let calibration = with(&pictures, &reference);
    assert!(codes(&calibration).contains(&"slice_missing"), "{:?}", calibration.warnings);
    assert!(codes(&calibration).contains(&"slice_doubled"), "{:?}", calibration.warnings);
    // the fifth of the eleven slices is the reference now; the rig's own was the sixth
    let to_reference = expected[4].inverse().expect("regular");
    let rebased: Vec<Homography> = expected.iter().map(|h| h.then(&to_reference).expect("regular")).collect();
    let worst = worst_corner(&calibration, &rebased);
    assert!(worst < 0.3, "{worst}");
}

#[test]
fn a_bump_is_reported_with_its_size() {
    let rig = Rig { drift_px: [1.0, 0.5], ..rig(11) };
    let target = DotTarget::for_rig(&rig, 16);
    let mut pictures = target_stack(&rig, &target);
    for picture in &mut pictures[8..] {
        let Samples::Eight(samples) = &mut picture.samples else { panic!("rendered with 8 bits") };
        samples.chunks_exact_mut(480).for_each(|row| row.rotate_right(4));
    }
    let calibration = measured(&pictures);
    let said = sentence(&calibration, "rig_bumped");
    assert!(said.contains("jumps by 4.") || said.contains("jumps by 3."), "{said}");
}

#[test]
fn the_capture_mode_is_found_and_a_wrong_specification_is_reported() {
    let fixed = Rig { drift_px: [0.0; 2], rotation_deg: 0.0, keystone: [0.0; 2], noise: 0.5, ..rig(9) };
    let target = DotTarget::for_rig(&fixed, 16);
    let options = CalibrationOptions { capture_mode: Some(CaptureMode::MovingLens), ..CalibrationOptions::default() };
    let calibration = with(&target_stack(&fixed, &target), &options);
    assert_eq!(calibration.report.capture.found, Some(CaptureMode::FixedLens), "{:?}", calibration.report.capture);
    assert!(sentence(&calibration, "capture_mode_disagrees").contains("a fixed lens"));
}

#[test]
fn rail_positions_and_target_pitch_give_the_principal_distance_independently() {
    let rig = rig(9);
    let target = DotTarget::for_rig(&rig, 16);
    let options = CalibrationOptions {
        // the renderer counts positions of the sensor away from the lens
        rail_positions_mm: Some(rig.rail_mm.iter().map(|z| -z).collect()),
        focal_mm: Some(rig.focal_mm),
        pixel_pitch_mm: Some(rig.pixel_pitch_mm),
        target_pitch_mm: Some(target.pitch_mm),
        ..CalibrationOptions::default()
    };
    let calibration = with(&target_stack(&rig, &target), &options);
    let camera = &calibration.report.camera;
    for distance in [camera.principal_distance_mm, camera.pupils.exit_pupil_distance_mm] {
        assert!((distance.expect("known") / 130.0 - 1.0).abs() < 0.005, "{camera:?}");
    }
    assert!((calibration.magnification.expect("known") - 1.0).abs() < 0.01);
    assert_eq!(calibration.capture_mode, Some(CaptureMode::FixedLens));
    assert!(!codes(&calibration).contains(&"focal_length_disagrees"));
}

#[test]
fn the_requested_model_is_used_and_all_models_are_reported() {
    let rig = rig(7);
    let target = DotTarget::for_rig(&rig, 14);
    let pictures = target_stack(&rig, &target);
    for (requested, model) in [
        (ModelChoice::RailLinear, HomographyModel::RailLinear),
        (ModelChoice::Similarity, HomographyModel::Similarity),
        (ModelChoice::Affine, HomographyModel::Affine),
        (ModelChoice::Homography, HomographyModel::Homography),
    ] {
        let calibration = with(&pictures, &CalibrationOptions { model: requested, ..CalibrationOptions::default() });
        assert_eq!(calibration.model, model);
        let report = &calibration.report;
        assert_eq!(report.candidates.iter().filter(|c| c.chosen).map(|c| c.model).collect::<Vec<_>>(), [model]);
        assert!(report.candidates.iter().all(|c| c.rms_px.is_some() && c.corner_sigma_px.is_some()));
    }
}

fn grids(change: impl Fn(DotTarget) -> [DotTarget; 2]) {
    let rig = rig(5);
    for target in change(DotTarget::for_rig(&rig, 16)) {
        let calibration = measured(&target_stack(&rig, &target));
        let worst = worst_corner(&calibration, &truths(&rig));
        assert!(worst < 0.1, "{}: {worst}", target.rotation_deg);
    }
}

#[test]
fn grids_at_any_angle_asymmetric_ones_and_ones_with_gaps_are_measured() {
    grids(|upright| {
        let mut asymmetric = DotTarget { asymmetric: true, rotation_deg: 31.0, ..upright.clone() };
        asymmetric.rows *= 2;
        asymmetric.dot_diameter_mm *= 0.7;
        [asymmetric, upright.without(0.1, 3)]
    });
}

#[test]
#[ignore = "more cases of a test"]
fn more_grids_at_any_angle_are_measured() {
    grids(|upright| [45.0, 90.0].map(|rotation_deg| DotTarget { rotation_deg, ..upright.clone() }));
}

#[test]
fn an_oblique_target_or_one_on_a_monitor_is_refused_or_solved_correctly() {
    let rig = rig(5);
    for target in [DotTarget::oblique(&rig, 14), DotTarget::on_monitor(&rig, 14)] {
        let pictures = target_stack(&rig, &target);
        match calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl) {
            Err(Interrupted::Failed(fault)) => assert_eq!(fault.kind, ErrorKind::TargetNotFound, "{fault}"),
            Err(Interrupted::Cancelled(_)) => panic!("not cancelled"),
            Ok(calibration) => {
                let worst = worst_corner(&calibration, &truths(&rig));
                assert!(worst < 0.5, "{worst}: {}", calibration.verdict);
            }
        }
    }
}
