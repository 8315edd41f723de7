//! Calibration end to end, on targets with known truth.

mod camera;
mod degenerate;
mod gains;
mod lost;
mod rig;
mod silent;

use std::path::PathBuf;

use super::testkit::{Noise, Shot, render};
use super::*;
use crate::imaging::Raster;
use crate::synth::{DotTarget, Rendered, Rig};
use crate::types::profile::CaptureMode;
use crate::types::{Homography, NoControl};

/// A stack of a fixed lens with drift, rotation and keystone, and its true homographies.
pub(super) fn stack(
    shot: &Shot,
    count: usize,
    blur_per_slice: f64,
    seed: u64,
    jitter: f64,
) -> (Vec<Raster>, Vec<Homography>) {
    let mut noise = Noise(seed);
    let reference = count / 2;
    let (cx, cy) = (0.5 * shot.width as f64 + 11.0, 0.5 * shot.height as f64 - 7.0);
    let mut truths = Vec::new();
    let mut rasters = Vec::new();
    for index in 0..count {
        let dz = index as f64 - reference as f64;
        let s = 1.0 / (1.0 + 0.02 * dz);
        let turn: f64 = if dz == 0.0 || jitter == 0.0 { 0.0 } else { 0.002 * noise.even() };
        let mut drift = || if dz == 0.0 { 0.0 } else { jitter * shot.pitch * noise.even() };
        let (dx, dy) = (drift() + 0.9 * dz, drift());
        let keystone = if dz == 0.0 { 0.0 } else { 1.5e-6 * dz };
        let (c, n) = (s * turn.cos(), s * turn.sin());
        let truth = Homography([
            c,
            -n,
            cx - c * cx + n * cy + dx,
            n,
            c,
            cy - n * cx - c * cy + dy,
            keystone,
            -0.5 * keystone,
            1.0,
        ]);
        truths.push(truth);
        rasters.push(render(&Shot {
            homography: truth,
            blur: shot.blur + blur_per_slice * dz.abs(),
            white: shot.white / (1.0 + 0.02 * dz).powi(2),
            seed: seed * 100 + index as u64,
            ..shot.clone()
        }));
    }
    (rasters, truths)
}

pub(super) fn worst_corner(calibration: &Calibration, truths: &[Homography]) -> f64 {
    let (w, h) = (calibration.width, calibration.height);
    calibration.slices.iter().zip(truths).map(|(s, t)| s.homography.corner_distance(t, w, h)).fold(0.0, f64::max)
}

fn worst_rms(calibration: &Calibration) -> f64 {
    calibration.slices.iter().filter_map(|s| s.rms_px).fold(0.0, f64::max)
}

pub(super) fn print(calibration: &Calibration, truths: &[Homography]) {
    for ((s, t), r) in calibration.slices.iter().zip(truths).zip(&calibration.report.slices) {
        println!(
            "{} blur {:.3} contrast {:.3} scale {:.5} gain {:.4} dots {:?}/{:?} rms {:.4} p95 {:.4} sigma {:.4} error {:.4}",
            s.index,
            r.blur_radius_px.unwrap_or(f64::NAN) / calibration.dot_pitch_px * s.scale,
            r.contrast.unwrap_or(f64::NAN),
            s.scale,
            s.gain,
            s.inliers,
            s.dots_found,
            s.rms_px.unwrap_or(f64::NAN),
            s.p95_px.unwrap_or(f64::NAN),
            s.corner_sigma_px.unwrap_or(f64::NAN),
            s.homography.corner_distance(t, calibration.width, calibration.height)
        );
    }
    println!("{} {:?} {:?}", calibration.verdict, calibration.capture_mode, calibration.warnings);
    println!(
        "{:?} fill {:.3}",
        calibration.model,
        calibration.report.target.as_ref().map_or(0.0, |target| target.fill)
    );
}

/// Slices in memory.
pub(super) struct Stack<'a>(pub &'a [Raster]);

impl Slices for Stack<'_> {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn name(&self, index: usize) -> &str {
        ["a.png", "b.png", "c.png", "d.png", "e.png", "f.png", "g.png", "h.png", "i.png"].get(index).unwrap_or(&"z.png")
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        Ok(self.0[index].clone())
    }
}

fn measured(rasters: &[Raster]) -> Calibration {
    calibrate(&Stack(rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration")
}

#[test]
fn a_stack_with_drift_rotation_keystone_and_blur_is_measured_to_a_tenth_of_a_pixel() {
    for seed in [1, 2] {
        // blur radius up to 0.3 of the pitch
        let (rasters, truths) = stack(&Shot::default(), 5, 4.1, seed, 0.08);
        let calibration = measured(&rasters);
        print(&calibration, &truths);
        assert!(worst_corner(&calibration, &truths) < 0.3);
        assert!(worst_rms(&calibration) < 0.1);
        for (index, slice) in calibration.slices.iter().enumerate() {
            let dz = index as f64 - 2.0;
            let truth = (1.0 + 0.02 * dz).powi(2);
            assert!((slice.gain / truth - 1.0).abs() < 0.01, "gain of {index}: {} for {truth}", slice.gain);
            assert_eq!(slice.inliers.map(|n| n > 100), Some(true));
        }
    }
}

#[test]
fn bright_dots_on_black_are_measured_too() {
    let shot = Shot { inverted: true, ..Shot::default() };
    let (rasters, truths) = stack(&shot, 5, 2.0, 4, 0.08);
    let calibration = measured(&rasters);
    print(&calibration, &truths);
    assert!(worst_corner(&calibration, &truths) < 0.3);
    for (index, slice) in calibration.slices.iter().enumerate() {
        let truth = (1.0 + 0.02 * (index as f64 - 2.0)).powi(2);
        assert!((slice.gain / truth - 1.0).abs() < 0.02, "gain of {index}: {} for {truth}", slice.gain);
    }
}

#[test]
fn a_grid_larger_than_the_picture_is_measured_with_its_cut_dots_left_out() {
    let shot = Shot { grid: [23, 17], ..Shot::default() };
    let (rasters, truths) = stack(&shot, 5, 2.0, 5, 0.08);
    let calibration = measured(&rasters);
    print(&calibration, &truths);
    assert!(worst_corner(&calibration, &truths) < 0.15);
}

#[test]
#[ignore = "needs the pictures of PINSTACK_SHARED"]
fn the_turntable_target_is_measured_to_a_tenth_of_a_pixel() {
    let root = std::env::var_os("PINSTACK_SHARED")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared"), PathBuf::from);
    let folder = root.join("data/turntable_stack/calib");
    let rasters: Vec<Raster> = (0..9)
        .map(|k| {
            let picture =
                image::open(folder.join(format!("calib_f{k:03}.png"))).expect("a picture of PINSTACK_SHARED").to_rgb8();
            Raster::eight(picture.width() as usize, picture.height() as usize, 3, picture.into_raw())
        })
        .collect();
    let calibration = measured(&rasters);
    // in focus at 129.042 mm, 132.042 mm, ... with f = 65 mm: d2 = f d1 / (d1 - f)
    let d2 = |d1: f64| 65.0 * d1 / (d1 - 65.0);
    let truths: Vec<Homography> = (0..9)
        .map(|k| {
            let dz = f64::from(k) - 4.0;
            let s = d2(141.042) / d2(141.042 + 3.0 * dz);
            // about the image centre, with a drift of (0.6, 0.35) px per slice
            Homography::similarity(s, [404.5 * (1.0 - s) - s * 0.6 * dz, 269.5 * (1.0 - s) - s * 0.35 * dz])
        })
        .collect();
    print(&calibration, &truths);
    assert!(worst_corner(&calibration, &truths) < 0.3);
    assert!(worst_rms(&calibration) < 0.1);
    assert!(calibration.slices.iter().all(|s| s.inliers == Some(165) && (s.gain - 1.0).abs() < 0.01));
    if let Some(out) = std::env::var_os("PINSTACK_TEST_OVERLAYS") {
        for (k, raster) in rasters.iter().enumerate() {
            let picture = overlay(raster, &calibration, k);
            let crate::imaging::Samples::Eight(samples) = picture.samples else { panic!("an overlay has 8 bits") };
            let file = PathBuf::from(&out).join(format!("overlay-{k}.png"));
            image::RgbImage::from_raw(810, 540, samples).expect("the size").save(file).expect("saved");
        }
    }
}

/// Renders a target on a rig of [`crate::synth`] and calibrates it. Returns the calibration and the truth.
fn on_rig(rig: &Rig, columns: usize) -> (Calibration, Vec<Homography>) {
    let target = DotTarget::for_rig(rig, columns);
    let slices = Rendered::target(rig, &target);
    let calibration = calibrate(&slices, &CalibrationOptions::default(), &NoControl).expect("a calibration");
    let truths: Vec<Homography> = (0..rig.slices()).map(|i| rig.homography(i)).collect();
    let pitch = target.pitch_px(rig, rig.reference);
    println!("blur {:.2} of the pitch {pitch:.1}", target.blur_radius_px(rig, 0) / pitch);
    print(&calibration, &truths);
    (calibration, truths)
}

#[test]
fn rigs_with_all_imperfections_are_measured_for_every_seed() {
    for seed in [1, 2, 3] {
        let rig = Rig { seed, noise: 2.0, channels: 1, ..Rig::sized(400, 300, 4) };
        let (calibration, truths) = on_rig(&rig, 14);
        assert!(worst_corner(&calibration, &truths) < 0.3);
        assert!(worst_rms(&calibration) < 0.1);
        for (i, slice) in calibration.slices.iter().enumerate() {
            assert!((slice.gain / rig.gain(i) - 1.0).abs() < 0.01, "gain of {i}: {} for {}", slice.gain, rig.gain(i));
        }
    }
}

#[test]
fn a_strongly_disturbed_rig_and_a_moving_lens_are_measured() {
    let disturbed = Rig {
        drift_px: [20.0, -14.0],
        rotation_deg: 0.6,
        keystone: [3e-3, -2e-3],
        vignetting: 0.3,
        noise: 2.0,
        channels: 1,
        ..Rig::sized(480, 360, 3)
    };
    let (calibration, truths) = on_rig(&disturbed, 14);
    assert!(worst_corner(&calibration, &truths) < 0.3);
    assert!(worst_rms(&calibration) < 0.1);
    let (calibration, truths) = on_rig(&Rig { channels: 1, ..Rig::sized(400, 300, 5) }.moving_lens(), 14);
    assert!(worst_corner(&calibration, &truths) < 0.3);
    assert_eq!(calibration.capture_mode, Some(CaptureMode::MovingLens));
}
