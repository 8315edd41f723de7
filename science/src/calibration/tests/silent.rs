//! Faults that leave no residuals: nothing in the scatter of the dots shows them.

use super::super::*;
use super::rig::{blurred, measured, sentence};
use crate::imaging::{Raster, Samples};
use crate::synth::{Alone, Banding, DotTarget, Faults, Rig, render_target, target_stack};
use crate::types::report::Grade;
use crate::types::{Homography, NoControl};

/// 600 x 400 px, dots 30 px apart that end inside the picture.
fn setup(slices: usize) -> (Rig, DotTarget) {
    let rig = Rig { channels: 1, keystone: [0.0; 2], rotation_deg: 0.0, ..Rig::sized(600, 400, slices) };
    let mut target = DotTarget::for_rig(&rig, 20);
    target.pitch_mm *= 30.0 / target.pitch_px(&rig, rig.reference);
    target.dot_diameter_mm = 0.5 * target.pitch_mm;
    [target.columns, target.rows] = [17, 11];
    (rig, target)
}

/// Largest error of a corner and its told standard deviation, per slice.
fn errors(calibration: &Calibration, rig: &Rig) -> Vec<(f64, f64)> {
    let off = |(i, slice): (usize, &crate::types::profile::ProfileSlice)| {
        (slice.homography.corner_distance(&rig.homography(i), 600, 400), slice.corner_sigma_px.unwrap_or(0.0))
    };
    calibration.slices.iter().enumerate().map(off).collect()
}

/// Checks that no corner errs by more than 0.05 px and three told standard deviations, and a good one by no more than
/// 0.3 px.
fn assert_honest(calibration: &Calibration, rig: &Rig, what: &str) {
    for (i, (error, sigma)) in errors(calibration, rig).into_iter().enumerate() {
        assert!(error < 0.05_f64.max(3.0 * sigma), "{what}: slice {i} is off by {error:.3} px, told {sigma:.3}");
        assert!(calibration.report.grade != Grade::Good || error < 0.3, "{what}: slice {i} is off by {error:.3} px");
    }
}

fn third_slice_differs(cases: &[(&str, Alone, usize)]) {
    for &(what, alone, columns) in cases {
        let (plain, mut target) = setup(9);
        let rows = if columns < 17 { 6 } else { 11 };
        if what.contains("half") {
            target.missing = (0..17 * 11).filter(|dot| dot % 17 > 8).collect();
        }
        [target.columns, target.rows] = [columns, rows];
        let rig = Rig { alone: Some(alone), ..blurred(plain, &target, 0.2) };
        let calibration = super::measured(&target_stack(&rig, &target));
        assert_honest(&calibration, &rig, what);
        let worst = errors(&calibration, &rig).iter().map(|e| e.0).fold(0.0, f64::max);
        assert!(worst < 0.15, "{what}: {worst:.3} px");
        let named: Vec<_> = calibration.warnings.iter().filter(|w| w.code == "slice_displaced").collect();
        let is_third = |detail: &str| detail.starts_with("c.png is tilted");
        assert!(named.len() == 1 && is_third(&named[0].detail), "{what}: {:?}", calibration.warnings);
        assert_eq!(calibration.report.grade, Grade::Usable, "{what}");
    }
}

/// The slice that differs alone.
const THIRD: Alone = Alone { slice: 2, keystone: [0.0; 2], turn_deg: 0.0, shear: 0.0 };

#[test]
fn a_slice_that_differs_alone_is_measured_by_its_own_dots_and_named() {
    third_slice_differs(&[("tilted, the right half without dots", Alone { keystone: [4e-3, 0.0], ..THIRD }, 17)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_slices_that_differ_alone_are_measured_by_their_own_dots_and_named() {
    third_slice_differs(&[
        ("tilted, a small target", Alone { keystone: [2e-3, 1e-3], ..THIRD }, 10),
        ("sheared", Alone { shear: 2e-3, ..THIRD }, 17),
    ]);
}

#[test]
fn two_slices_that_differ_leave_the_others_as_exact_as_without_them() {
    let (plain, mut target) = setup(13);
    [target.columns, target.rows] = [12, 8];
    let plain = blurred(plain, &target, 0.2);
    let tilted =
        |slice| Rig { alone: Some(Alone { slice, keystone: [3e-3, 0.0], ..Alone::default() }), ..plain.clone() };
    let mut pictures = target_stack(&plain, &target);
    for slice in [1, 9] {
        pictures[slice] = render_target(&tilted(slice), &target, slice);
    }
    let calibration = measured(&pictures);
    let named: Vec<_> = calibration.warnings.iter().filter(|w| w.code == "slice_displaced").collect();
    assert_eq!(named.len(), 2, "{:?}", calibration.warnings);
    for (i, slice) in calibration.slices.iter().enumerate() {
        let truth = if [1, 9].contains(&i) { tilted(i).homography(i) } else { plain.homography(i) };
        let error = slice.homography.corner_distance(&truth, 600, 400);
        assert!(error < 0.06, "slice {i}: {error:.3} px");
    }
}

fn light_from_one_side(cases: &[(&str, [f64; 2], f64, bool)]) {
    for &(what, light, blur, gamma) in cases {
        let (plain, mut target) = setup(7);
        target.flaws.gamma = gamma;
        target.flaws.faults = Faults { illumination: light, ..Faults::default() };
        let rig = blurred(plain, &target, blur);
        assert_honest(&measured(&target_stack(&rig, &target)), &rig, what);
    }
}

#[test]
fn light_from_one_side_and_blur_are_in_the_told_uncertainty() {
    light_from_one_side(&[("a half at the far side, aslant", [0.02, 0.03], 0.45, true)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_light_from_one_side_and_blur_are_in_the_told_uncertainty() {
    light_from_one_side(&[
        ("a sixth at the far side", [0.07, 0.0], 0.35, true),
        ("linear values", [0.06, 0.0], 0.4, false),
    ]);
}

fn under_a_lamp(cases: &[([f64; 2], f64)]) {
    for &(tilt_deg, spot) in cases {
        let (plain, mut target) = setup(9);
        target.tilt_deg = tilt_deg;
        target.flaws.gamma = true;
        target.flaws.faults = Faults { spot, ..Faults::default() };
        let rig = blurred(plain, &target, 0.42);
        assert_honest(&measured(&target_stack(&rig, &target)), &rig, &format!("{tilt_deg:?}"));
    }
}

#[test]
fn a_tilted_target_under_a_lamp_in_the_middle_is_judged_where_it_is_blurred_most() {
    under_a_lamp(&[([4.0, 5.0], 0.0025)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_targets_under_a_lamp_in_the_middle_are_judged_where_they_are_blurred_most() {
    under_a_lamp(&[([0.0; 2], 0.0025), ([0.0, 7.0], 0.0035)]);
}

#[test]
fn uneven_blur_of_a_tilted_target_is_no_lamp_banding() {
    let (plain, mut target) = setup(7);
    target.rotation_deg = 0.0;
    target.tilt_deg = [0.0, 5.0];
    // all four edges of the grid are in view in every slice: nothing else is to be told
    [target.columns, target.rows] = [15, 10];
    let rig = blurred(plain, &target, 0.4);
    let calibration = measured(&target_stack(&rig, &target));
    assert!(calibration.warnings.iter().all(|w| w.code != "lamp_banding"), "{:?}", calibration.warnings);
    assert_eq!(calibration.report.grade, Grade::Good, "{}", calibration.verdict);
}

/// Period of the stripes in px, their strength, and the blur.
fn stripes(cases: &[(f64, f64, f64)]) {
    for &(period_px, strength, blur) in cases {
        let (plain, mut target) = setup(5);
        target.rotation_deg = 0.0;
        target.flaws.faults.banding = Some(Banding { period_px, strength });
        let rig = blurred(plain, &target, blur);
        let calibration = measured(&target_stack(&rig, &target));
        let told = sentence(&calibration, "lamp_banding");
        assert!(told.contains("flickers"), "{told}");
        assert_eq!(calibration.report.grade, Grade::Usable, "{period_px} px, {strength}");
    }
}

#[test]
fn stripes_at_the_pitch_of_the_dots_are_reported() {
    stripes(&[(29.0, 0.02, 0.05), (30.0, 0.003, 0.1)]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_stripes_at_the_pitch_of_the_dots_are_reported() {
    stripes(&[(30.0, 0.03, 0.05), (30.0, 0.01, 0.3), (15.0, 0.03, 0.2)]);
}

#[test]
fn a_slice_that_strong_stripes_hide_is_diagnosed_and_not_good() {
    let (plain, target) = setup(7);
    let target = DotTarget { rotation_deg: 0.0, ..target };
    let rig = blurred(plain, &target, 0.1);
    let mut pictures = target_stack(&rig, &target);
    let Samples::Eight(samples) = &mut pictures[5].samples else { panic!("rendered with 8 bits") };
    for (y, row) in samples.chunks_exact_mut(600).enumerate() {
        let light = 0.5 + 0.5 * (std::f64::consts::TAU * y as f64 / 30.0).cos();
        row.iter_mut().for_each(|v| *v = (f64::from(*v) * light) as u8);
    }
    assert_eq!(detection::diagnose(&pictures[5]), detection::Diagnosis::Striped);
    assert_ne!(detection::diagnose(&pictures[4]), detection::Diagnosis::Striped);
    if let Ok(calibration) = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl) {
        assert_ne!(calibration.report.grade, Grade::Good);
    }
}

#[test]
fn a_rail_that_does_not_move_is_reported_and_a_telecentric_one_that_does_is_not() {
    let (plain, target) = setup(7);
    let one = render_target(&plain, &target, 3);
    let middle = plain.rail_mm[3];
    let still = Rig { rail_mm: plain.rail_mm.iter().map(|z| middle + 1e-5 * (z - middle)).collect(), ..plain.ideal() };
    let still = Rig { noise: 1.0, ..still };
    for pictures in [vec![one.clone(); 7], vec![one; 2], target_stack(&still, &target)] {
        let calibration = measured(&pictures);
        assert!(sentence(&calibration, "rail_still").contains("did not move"));
        assert_eq!(calibration.report.grade, Grade::Usable, "{}", calibration.verdict);
    }
    let shot = super::Shot { vignetting: 0.0, ..super::Shot::default() };
    let telecentric: Vec<Raster> = (0..7)
        .map(|i| {
            super::render(&super::Shot { blur: 0.8 + 2.5 * (f64::from(i) - 3.0).abs(), seed: i as u64, ..shot.clone() })
        })
        .collect();
    let calibration = measured(&telecentric);
    assert!(calibration.slices.iter().all(|s| s.homography.corner_distance(&Homography::IDENTITY, 480, 360) < 0.05));
    assert!(calibration.warnings.iter().all(|w| w.code != "rail_still"), "{:?}", calibration.warnings);
}

#[test]
fn a_rail_that_is_stuck_for_most_of_the_stack_is_reported() {
    let (plain, target) = setup(9);
    let rig = blurred(plain, &target, 0.2);
    let pictures = target_stack(&rig, &target);
    let stuck: Vec<Raster> = [1, 2, 3, 4, 4, 4, 4, 4, 4].iter().map(|&i| pictures[i].clone()).collect();
    let calibration = measured(&stuck);
    let doubled = calibration.warnings.iter().filter(|w| w.code == "slice_doubled").count();
    assert_eq!(doubled, 5, "{:?}", calibration.warnings);
}

#[test]
fn dots_of_a_few_pixels_are_called_too_fine() {
    for pitch in [3.0, 4.0] {
        let shot = super::Shot { grid: [90, 60], pitch, blur: 0.3, ..super::Shot::default() };
        let pictures: Vec<Raster> = (0..3).map(|seed| super::render(&super::Shot { seed, ..shot.clone() })).collect();
        let refused = calibrate(&&pictures[..], &CalibrationOptions::default(), &NoControl).map(|c| c.verdict);
        assert!(format!("{refused:?}").contains("less than 5 px"), "{pitch}: {refused:?}");
    }
}
