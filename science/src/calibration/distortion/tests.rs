//! The estimator on dots with known distortion.

use std::collections::BTreeMap;

use super::super::coarse_registration::SimilarityMotion;
use super::super::detected::{MeasuredDot, Target};
use super::super::dot_photometry::DotBrightness;
use super::super::flat_field::Polarity;
use super::super::identity::Labelling;
use super::super::robust::transfer_error;
use super::super::testkit::Noise;
use super::*;
use crate::types::NoControl;

const SIZE: (usize, usize) = (600, 400);
const REFERENCE: usize = 3;
const SLICES: usize = 7;

fn lens(k1: f64) -> Distortion {
    Distortion { centre_px: [310.0, 192.0], k1, k2: 0.0, radius_px: 360.0 }
}

/// Ideal px of slice `i` to ideal px of the reference slice: 10 % of scale over the stack.
fn truth(i: usize) -> Homography {
    let dz = i as f64 - REFERENCE as f64;
    let scale = 1.0 + 0.1 * dz / (SLICES - 1) as f64;
    Homography::similarity(scale, [300.0 * (1.0 - scale) + 1.3 * dz, 200.0 * (1.0 - scale) - 0.7 * dz])
}

/// The stack whose slice `i` shows the plate's point `p` (px of the reference slice) at `seen(i, p)`, with a noise of
/// 0.02 px. Dots lie `pitch` px apart within `half` px of the middle.
fn stack(half: [i32; 2], pitch: f64, seed: u64, seen: impl Fn(usize, [f64; 2]) -> [f64; 2]) -> Tracked {
    let mut noise = Noise(seed);
    let mut detection = |i: usize| {
        let mut dots = BTreeMap::new();
        for row in -half[1]..=half[1] {
            for column in -half[0]..=half[0] {
                let at = seen(i, [300.3 + pitch * f64::from(column), 199.6 + pitch * f64::from(row)]);
                let at = at.map(|v| v + 0.02 * noise.normal());
                if (0.0..SIZE.0 as f64).contains(&at[0]) && (0.0..SIZE.1 as f64).contains(&at[1]) {
                    let light = DotBrightness { mean: 200.0, linear_mean: None, bright: None };
                    let dot = MeasuredDot {
                        at,
                        sigma: 0.02,
                        light,
                        shared_sigma: 0.0,
                        modulation: 0.5,
                        doubt: [0.0; 2],
                        invalid: 0.0,
                    };
                    dots.insert([column, row], dot);
                }
            }
        }
        let places = dots.iter().map(|(label, dot)| (*label, dot.at)).collect();
        Some(Detection {
            dots,
            places,
            pitch,
            motion: SimilarityMotion::NONE,
            clipped: 0.0,
            modulation: 1.0,
            fill: 0.5,
            merged: false,
            density: 1.0,
            is_tentative: false,
            ripple: None,
            identity: None,
            turned: None,
            tint: None,
            fingerprint: None,
        })
    };
    let detections = (0..SLICES).map(&mut detection).collect();
    let labelling = Labelling { ambiguous: false, confirmed: true };
    let target = Target { polarity: Polarity::DarkOnLight, bin: 1, code: None };
    Tracked {
        width: SIZE.0,
        height: SIZE.1,
        target,
        detections,
        labelling: vec![labelling; SLICES],
        colours: None,
        diagnoses: vec![None; SLICES],
    }
}

/// The analysis, and the stack without the distortion if one was found.
fn analysed(tracked: &Tracked) -> (LensAnalysis, Option<Tracked>) {
    let analysis = analyse(tracked, REFERENCE, &NoControl).expect("not cancelled");
    let straight = analysis.distortion.map(|distortion| without(tracked, &distortion));
    (analysis, straight)
}

fn without(tracked: &Tracked, distortion: &Distortion) -> Tracked {
    let Tracked { width, height, target, colours, .. } = *tracked;
    let (detections, diagnoses) = (tracked.detections.clone(), tracked.diagnoses.clone());
    let labelling = tracked.labelling.clone();
    straightened(Tracked { width, height, target, detections, diagnoses, labelling, colours }, distortion)
}

/// Largest distance, px, between where the corners of the reference slice truly lie in the slices and where the found
/// distortion, and homographies fitted to the dots, put them.
fn worst_corner(straight: &Tracked, found: &Distortion, real: &Distortion) -> f64 {
    let frame = Frame::new(SIZE.0, SIZE.1);
    let base = straight.detections[REFERENCE].as_ref().expect("dots");
    let mut worst = 0.0_f64;
    for i in (0..SLICES).filter(|&i| i != REFERENCE) {
        let inliers = find_inliers(straight.detections[i].as_ref().expect("dots"), base, &frame).expect("inliers");
        let model = TransformModel::Homography;
        let fitted = transform_models::fit(model, &inliers.evidence.matches).expect("a homography");
        let back = frame.homography(&model.parameters(&fitted.free)).and_then(|h| h.inverse()).expect("regular");
        let true_back = truth(i).inverse().expect("regular");
        for corner in Homography::corners(SIZE.0 as u32, SIZE.1 as u32) {
            let place = found.distort(back.apply(found.undistort(corner)));
            let true_place = real.distort(true_back.apply(real.undistort(corner)));
            worst = worst.max((place[0] - true_place[0]).hypot(place[1] - true_place[1]));
        }
    }
    worst
}

#[test]
fn distortion_on_the_sensor_side_is_measured_and_the_corners_are_right() {
    for (k1, seed) in [(0.025, 1), (-0.03, 2), (0.01, 3)] {
        let real = lens(k1);
        let back = |i: usize, p| truth(i).inverse().expect("regular").apply(p);
        let tracked = stack([12, 8], 23.0, seed, |i, p| real.distort(back(i, p)));
        let (analysis, straight) = analysed(&tracked);
        let found = analysis.distortion.unwrap_or_else(|| panic!("{k1}: {:?}", analysis.finding));
        assert!((found.k1 / k1 - 1.0).abs() < 0.1, "{} for {k1}", found.k1);
        let worst = worst_corner(&straight.expect("the dots without distortion"), &found, &real);
        assert!(worst < 0.08, "{k1}: {worst} px");
        let told = analysis.corner_sigma.iter().fold(0.0_f64, |most, s| most.max(*s));
        assert!(analysis.corner_sigma[REFERENCE] == 0.0 && told < 0.1 && told > 0.0, "{told}");
        let finding = analysis.finding.expect("told");
        assert_eq!((finding.allows, finding.warning.code.as_str()), (Grade::Good, "lens_distortion"));
    }
}

#[test]
fn no_distortion_and_distortion_by_a_fixed_lens_leave_the_dots_as_they_are() {
    for seed in 0..6 {
        for k1 in [0.0, 0.03] {
            // the distorted image scales as a whole
            let back = |i: usize, p| truth(i).inverse().expect("regular").apply(p);
            let tracked = stack([12, 8], 23.0, seed, |i, p| back(i, lens(k1).distort(p)));
            let (analysis, straight) = analysed(&tracked);
            assert!(analysis.distortion.is_none() && straight.is_none(), "{k1}, {seed}: {:?}", analysis.finding);
            assert_eq!(analysis.finding, None, "{k1}, {seed}");
        }
    }
}

#[test]
fn a_bent_target_before_a_moving_lens_is_not_taken_for_distortion() {
    // a part of the plate that is nearer is larger, and grows more as the camera approaches
    let tracked = stack([12, 8], 23.0, 5, |i, [x, y]| {
        let dz = (i as f64 - REFERENCE as f64) / (SLICES - 1) as f64;
        let nearer = 0.02 * ((x - 300.0).powi(2) + (y - 200.0).powi(2)) / (360.0 * 360.0);
        let scale = 1.0 / (1.0 - 0.1 * dz - nearer);
        [300.0 + scale * (x - 300.0), 200.0 + scale * (y - 200.0)]
    });
    let (analysis, straight) = analysed(&tracked);
    assert!(analysis.distortion.is_none() && straight.is_none(), "{analysis:?}");
    let finding = analysis.finding.expect("the residuals are radial");
    assert_eq!(finding.allows, Grade::Usable);
    assert!(finding.warning.detail.contains("check that the target is flat"), "{}", finding.warning.detail);
}

#[test]
fn an_oblique_target_and_print_errors_are_not_taken_for_distortion() {
    for seed in 0..4 {
        let tilt = Homography([1.0, 0.02, -4.0, -0.01, 0.94, 9.0, 1.2e-4, -0.8e-4, 1.0]);
        let print = |p: [f64; 2]| {
            let mut noise = Noise(seed ^ (p[0] * 31.0) as u64 ^ ((p[1] * 77.0) as u64) << 20);
            p.map(|v| v + 0.1 * noise.normal())
        };
        let tracked =
            stack([11, 8], 22.0, seed, |i, p| truth(i).inverse().expect("regular").apply(tilt.apply(print(p))));
        let (analysis, _) = analysed(&tracked);
        assert!(analysis.distortion.is_none() && analysis.finding.is_none(), "{seed}: {analysis:?}");
    }
}

#[test]
fn with_a_small_target_the_distortion_is_modelled_well_or_the_grade_is_limited() {
    let real = lens(0.03);
    let back = |i: usize, p| truth(i).inverse().expect("regular").apply(p);
    let tracked = stack([6, 5], 20.0, 8, |i, p| real.distort(back(i, p)));
    let (analysis, straight) = analysed(&tracked);
    match (analysis.distortion, straight) {
        (Some(found), Some(straight)) => {
            let told = analysis.corner_sigma.iter().fold(0.0_f64, |most, s| most.max(*s));
            let worst = worst_corner(&straight, &found, &real);
            assert!(worst < 0.3 || worst < 3.0 * told, "{worst} px, told {told}");
        }
        _ => assert_eq!(analysis.finding.map(|finding| finding.allows), Some(Grade::Usable)),
    }
}

#[test]
fn dots_seen_through_the_distortion_agree_with_one_homography_without_it() {
    let real = lens(0.03);
    let back = |i: usize, p| truth(i).inverse().expect("regular").apply(p);
    let tracked = stack([12, 8], 23.0, 9, |i, p| real.distort(back(i, p)));
    let straight = without(&tracked, &real);
    let base = straight.detections[REFERENCE].as_ref().expect("dots");
    for (i, detection) in straight.detections.iter().enumerate() {
        for (label, dot) in &detection.as_ref().expect("dots").dots {
            let Some(other) = base.dots.get(label) else { continue };
            assert!(transfer_error(&truth(i), &(dot.at, other.at)) < 0.15, "slice {i}, {label:?}");
        }
    }
}
