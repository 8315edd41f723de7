//! Optics of the lens: blur, distances, homographies and brightness.

use super::*;

#[test]
fn blur_follows_the_aperture_and_the_distance_of_the_image_from_the_sensor() {
    let rig = Rig::sized(1000, 750, 13);
    for i in 0..13 {
        for fraction in [0.0, 0.3, 0.77, 1.0] {
            let d2_object = rig.focal_mm * rig.object_distance(fraction) / (rig.object_distance(fraction) - 65.0);
            let diameter_mm = rig.aperture_mm() * (rig.principal_distance(i) - d2_object).abs() / d2_object;
            let expected = diameter_mm / 2.0 / rig.pixel_pitch_mm;
            assert!((rig.blur_radius_px(i, fraction) - expected).abs() < 1e-9);
        }
        assert!(rig.blur_radius_px(i, rig.focus_fraction(i)) < 1e-9, "slice {i} is in focus at its own depth");
    }
    assert!(rig.object_distance(0.0) < rig.object_distance(1.0), "the first slice is in focus nearest");
    assert!((rig.blur_radius_px(6, rig.focus_fraction(7)) - 1.0).abs() < 0.05, "a step is 2 px of blur");
}

#[test]
fn a_depth_has_one_distance() {
    for rig in [Rig::default(), Rig::default().moving_lens()] {
        for depth in [-0.2, 0.0, 0.37, 1.0, 1.1] {
            assert!((rig.depth_of(rig.object_distance(depth)) - depth).abs() < 1e-9);
        }
    }
}

#[test]
fn with_a_fixed_lens_one_homography_serves_every_depth() {
    let rig = Rig::default();
    for i in 0..rig.slices() {
        let moved = rig.homography(i).corner_distance(&rig.homography_at(i, 0.05), 640, 480);
        assert!(moved < 1e-9, "slice {i}");
        assert!(rig.homography(i).violation(640, 480).is_none());
    }
    assert!(rig.homography(0).scale_at(rig.centre()) < 0.98, "the first slice is the largest");
    assert!(rig.homography(rig.reference).is_identity());
}

#[test]
fn with_a_moving_lens_depths_part_by_parallax() {
    let rig = Rig::default().moving_lens();
    let last = rig.slices() - 1;
    let parallax = rig.homography_at(last, 0.0).corner_distance(&rig.homography_at(last, 1.0), 640, 480);
    assert!(parallax > 0.5, "{parallax} px");
    for i in 0..=last {
        assert!(rig.blur_radius_px(i, rig.focus_fraction(i)) < 1e-9, "slice {i} is in focus at its own depth");
        assert_eq!(rig.gain(i), 1.0, "the sensor keeps its distance");
    }
}

#[test]
fn the_slice_in_focus_is_the_inverse_of_the_depth_in_focus_on_uneven_rails_too() {
    let mut rig = Rig::sized(320, 240, 5);
    rig.rail_mm = vec![4.0, 3.5, 1.0, 0.5, -2.0];
    for i in 0..5 {
        assert!((rig.slice_in_focus(rig.focus_fraction(i)) - i as f64).abs() < 1e-9);
    }
    let between = rig.slice_in_focus((rig.focus_fraction(1) + rig.focus_fraction(2)) / 2.0);
    assert!((between - 1.5).abs() < 1e-9);
}

#[test]
fn light_falls_with_the_square_of_the_principal_distance() {
    let rig = Rig::sized(320, 240, 5);
    let ratio = rig.principal_distance(0) / rig.principal_distance(rig.reference);
    assert!(ratio > 1.02);
    assert!((rig.gain(0) - ratio * ratio).abs() < 1e-12);
    assert_eq!(rig.gain(rig.reference), 1.0);
}

#[test]
fn a_lens_with_two_pupils_scales_and_blurs_as_its_formulas_whatever_moves() {
    for pupil_ratio in [0.6, 1.8] {
        for (mode, sign) in
            [(CaptureMode::FixedLens, -1.0), (CaptureMode::MovingLens, 1.0), (CaptureMode::LensAlone, 1.0)]
        {
            let rig = Rig { mode, pupil_ratio, magnification: 1.6, ..Rig::sized(320, 240, 5) };
            let lens = rig.lens();
            let in_focus = rig.focus_fraction(rig.reference);
            assert!((rig.object_distance(in_focus) - lens.entrance_pupil_distance()).abs() < 1e-9);
            for i in 0..5 {
                let z = sign * (rig.rail_mm[i] - rig.rail_mm[rig.reference]);
                assert!((rig.scale(i, in_focus) - lens.size(mode, z)).abs() < 1e-12, "{mode:?} {i}");
                assert!((rig.exposure(i) - lens.light(mode, z)).abs() < 1e-12, "{mode:?} {i}");
                let fraction = rig.focus_fraction(i);
                assert!(rig.blur_radius_px(i, fraction) < 1e-9, "slice {i} is in focus at its own depth");
                assert!((rig.depth_of(rig.object_distance(fraction)) - fraction).abs() < 1e-9, "{mode:?} {i}");
                let nearer = rig.object_distance(in_focus) - rig.object_distance(fraction);
                assert!((nearer - lens.focus_shift(mode, z)).abs() < 1e-9, "{mode:?} {i}");
            }
        }
    }
}
