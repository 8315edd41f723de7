//! The turntable against what it claims.

use nalgebra::Vector3;

use super::super::Light;
use super::*;
use crate::imaging::{Plane, Samples};

fn angles(pan_deg: f64, tilt_deg: f64) -> ViewAngles {
    ViewAngles { pan_deg, tilt_deg }
}

/// One ball, so that its picture can be computed by hand.
fn ball(centre: [f64; 3], radius: f64) -> Specimen {
    let mut specimen = Specimen::beetle(1);
    let solid = Solid::Ellipsoid {
        centre: centre.into(),
        turn: nalgebra::Matrix3::identity(),
        radii: Vector3::new(radius, radius, radius),
    };
    specimen.limbs = vec![Limb { solid, colour: [0.5; 3] }];
    specimen
}

fn centroid(mask: &Plane<u8>) -> [f64; 2] {
    let (mut sum, mut count) = ([0.0, 0.0], 0.0);
    for (at, &value) in mask.data.iter().enumerate() {
        let cover = f64::from(value) / 255.0;
        sum[0] += cover * (at % mask.width) as f64;
        sum[1] += cover * (at / mask.width) as f64;
        count += cover;
    }
    sum.map(|sum| sum / count)
}

#[test]
fn a_ball_is_seen_where_the_pose_projects_it() {
    let rig = scan_rig(300, 5);
    let focal_px = rig.principal_distance(rig.reference) / rig.pixel_pitch_mm;
    let [cx, cy] = rig.centre();
    let centre = [3.0, -4.0, 2.0];
    for (pan, tilt) in [(0.0, 0.0), (75.0, 20.0), (210.0, -15.0), (300.0, 60.0)] {
        let angles = angles(pan, tilt);
        let truth = view(&rig, &ball(centre, 0.8), angles).truth();
        let [right, down, forward] = angles.rotation().map(Vector3::from);
        let from = scan_radius(&rig) * Vector3::from(angles.direction());
        let seen = Vector3::from(centre) - from;
        let depth = forward.dot(&seen);
        let expected = [cx + focal_px * right.dot(&seen) / depth, cy + focal_px * down.dot(&seen) / depth];
        let found = centroid(&truth.cover);
        for axis in 0..2 {
            assert!((found[axis] - expected[axis]).abs() < 0.05, "{angles:?}: {found:?}, expected {expected:?}");
        }
        let radius_px = focal_px * 0.8 / depth;
        let area: f64 = truth.cover.data.iter().map(|&value| f64::from(value) / 255.0).sum();
        assert!((area / (std::f64::consts::PI * radius_px * radius_px) - 1.0).abs() < 0.02, "{angles:?}: {area}");
    }
}

#[test]
fn a_ball_is_sharpest_in_the_slice_that_is_focused_on_its_surface() {
    for rig in [scan_rig(300, 7), scan_rig(300, 7).moving_lens()] {
        let rig = rig.ideal();
        for toward_camera in [6.0, 1.0, -7.0] {
            let stage = view(&rig, &ball([toward_camera, 0.0, 0.0], 2.0), angles(0.0, 0.0));
            let truth = stage.truth();
            let [cx, cy] = rig.centre().map(|middle| middle as usize);
            // of the surface that faces the camera, 2 mm before the centre of the ball
            let expected = f64::from(truth.slice.at(cx, cy));
            assert!((expected - rig.slice_in_focus(rig.depth_of(scan_radius(&rig) - toward_camera - 2.0))).abs() < 0.2);
            let sharpness: Vec<f32> = (0..rig.slices())
                .map(|i| {
                    let luma = stage.render(Light::Front, i).luma();
                    let differences = (cy - 12..cy + 12).flat_map(|y| (cx - 12..cx + 12).map(move |x| (x, y)));
                    differences.map(|(x, y)| (luma.at(x, y) - luma.at(x + 1, y)).powi(2)).sum()
                })
                .collect();
            let sharpest = (0..rig.slices()).max_by(|&a, &b| sharpness[a].total_cmp(&sharpness[b])).expect("slices");
            assert!((sharpest as f64 - expected).abs() <= 1.0, "{sharpest} of {sharpness:?}, expected {expected}");
        }
    }
}

#[test]
fn what_is_nearer_hides_what_is_farther_also_where_limbs_penetrate_each_other() {
    let rig = scan_rig(300, 5).ideal();
    let limb = |x: f64, radius: f64, colour: [f32; 3]| Limb {
        solid: Solid::Ellipsoid {
            centre: Vector3::new(x, 0.0, 0.0),
            turn: nalgebra::Matrix3::identity(),
            radii: Vector3::new(radius, radius, radius),
        },
        colour,
    };
    // the middle of the green ball is nearer, but the surface of the red one is
    let mut specimen = ball([0.0; 3], 1.0);
    specimen.limbs = vec![limb(0.0, 5.0, [0.6, 0.02, 0.02]), limb(2.0, 2.0, [0.02, 0.6, 0.02])];
    let [cx, cy] = rig.centre().map(|middle| middle as usize);
    let seen = |specimen: &Specimen, pan: f64| {
        let sharp = view(&rig, specimen, angles(pan, 0.0)).truth().sharp;
        let Samples::Eight(samples) = &sharp.samples else { panic!("rendered with 8 bits") };
        let [red, green] = [0, 1].map(|channel| u32::from(samples[(cy * sharp.width + cx) * 3 + channel]));
        (red > 3 * green, green > 3 * red)
    };
    assert_eq!(seen(&specimen, 0.0), (true, false));
    specimen.limbs[1] = limb(4.0, 2.0, [0.02, 0.6, 0.02]);
    assert_eq!(seen(&specimen, 0.0), (false, true));
    assert_eq!(seen(&specimen, 180.0), (true, false), "from behind");
}

#[test]
fn the_whole_beetle_is_in_the_picture_and_between_the_first_and_the_last_slice() {
    let rig = scan_rig(300, 9);
    for (pan, tilt) in [(0.0, 0.0), (40.0, 24.0), (130.0, -10.0), (250.0, 12.0)] {
        let truth = view(&rig, &Specimen::beetle(3), angles(pan, tilt)).truth();
        let Plane { width, height, .. } = truth.mask;
        let border = (0..width).flat_map(|x| [(x, 0), (x, height - 1)]);
        let border = border.chain((0..height).flat_map(|y| [(0, y), (width - 1, y)]));
        assert!(border.into_iter().all(|(x, y)| truth.mask.at(x, y) == 0), "at pan {pan}");
        let share = truth.mask.data.iter().filter(|&&value| value > 0).count() as f64 / (width * height) as f64;
        assert!((0.1..0.5).contains(&share), "{share} at pan {pan}");
        let slices: Vec<f32> = truth.slice.data.iter().copied().filter(|slice| slice.is_finite()).collect();
        assert!(slices.iter().all(|slice| (0.0..=8.0).contains(slice)), "at pan {pan}");
    }
}
