//! Stacks in which slices are lost: the sentences name the cause of each.

use super::super::testkit::Noise;
use super::super::*;
use super::rig::{blurred, measured, rig, sentence};
use crate::imaging::Raster;
use crate::synth::{DotTarget, Rig, target_stack};

/// A stack with little blur: all of its slices are sharp.
fn sharp_stack(slices: usize) -> Vec<Raster> {
    let rig = rig(slices);
    let target = DotTarget::for_rig(&rig, 16);
    target_stack(&blurred(rig, &target, 0.1), &target)
}

/// A picture with edges and without a grid.
fn another_object(like: &Raster, seed: u64) -> Raster {
    let mut noise = Noise(seed);
    let samples = (0..like.width * like.height).map(|_| (128.0 + 60.0 * noise.even()) as u8).collect();
    Raster::eight(like.width, like.height, 1, samples)
}

fn black(like: &Raster) -> Raster {
    Raster::eight(like.width, like.height, 1, vec![0; like.width * like.height])
}

/// The sentences about predicted slices.
fn predicted(calibration: &Calibration) -> Vec<&str> {
    let of_slices = calibration.warnings.iter().filter(|w| w.code == "slice_interpolated");
    of_slices.map(|w| w.detail.as_str()).collect()
}

fn neighbours_of_another_object(lost: [usize; 2]) {
    let mut pictures = sharp_stack(11);
    for i in lost {
        pictures[i] = another_object(&pictures[i], i as u64);
    }
    let calibration = measured(&pictures);
    let [said] = predicted(&calibration)[..] else { panic!("{:?}", calibration.warnings) };
    assert!(said.contains("another target or object"), "{lost:?}: {said}");
}

#[test]
fn neighbouring_slices_of_another_object_are_not_called_blurred() {
    neighbours_of_another_object([9, 10]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_neighbouring_slices_of_another_object_are_not_called_blurred() {
    neighbours_of_another_object([3, 4]);
}

#[test]
fn slices_that_blur_has_removed_are_called_blurred() {
    let plain: Rig = rig(9);
    let target = DotTarget::for_rig(&plain, 16);
    let calibration = measured(&target_stack(&blurred(plain, &target, 0.9), &target));
    let said = predicted(&calibration);
    assert!(!said.is_empty() && said.iter().all(|said| said.contains("too blurred")), "{said:?}");
    assert!(calibration.verdict.contains("pitch is too fine"), "{}", calibration.verdict);
}

#[test]
fn the_pitch_is_not_blamed_for_a_slice_that_is_lost_for_another_reason() {
    let plain: Rig = rig(9);
    let target = DotTarget::for_rig(&plain, 16);
    let mut pictures = target_stack(&blurred(plain, &target, 0.45), &target);
    pictures[3] = black(&pictures[3]);
    let calibration = measured(&pictures);
    assert!(sentence(&calibration, "slice_interpolated").contains("almost black"));
    assert!(calibration.verdict.contains("slice 3 predicted"), "{}", calibration.verdict);
    assert!(!calibration.verdict.contains("pitch"), "{}", calibration.verdict);
}
