//! Gains and lost slices: blur of any shape, any tone curve, slices with a fault of the light.

use std::f64::consts::{PI, TAU};

use super::super::*;
use super::Stack;
use crate::imaging::{Plane, Raster};
use crate::types::NoControl;

const WIDTH: usize = 264;
const HEIGHT: usize = 204;
const PITCH: f64 = 22.0;
const SLICES: usize = 7;

/// Light of a sharp target, scaled by `scale` about the middle of the image: 0.82 between the dots, 0.05 on them.
fn target(scale: f64) -> Plane<f32> {
    let cover = |x: f64, y: f64| {
        let place = |v: f64, middle: f64, count: f64| {
            let at = (v - middle) / (scale * PITCH) + 0.5 * (count - 1.0);
            let nearest = at.round().clamp(0.0, count - 1.0);
            (at - nearest) * scale * PITCH
        };
        let away = place(x, 131.8, 11.0).hypot(place(y, 101.3, 8.0));
        // anti-aliased by one pixel
        (0.25 * scale * PITCH + 0.5 - away).clamp(0.0, 1.0)
    };
    Plane::from_fn(WIDTH, HEIGHT, |x, y| (0.82 - 0.77 * cover(x as f64, y as f64)) as f32)
}

type Kernel = (&'static str, fn(f64, f64, f64) -> f64);

/// Blur shapes: weight at (x, y) for a radius of about `r` px.
const KERNELS: [Kernel; 5] = [
    ("disc", |x, y, r| (r + 0.5 - x.hypot(y)).clamp(0.0, 1.0)),
    ("gaussian", |x, y, r| (-2.0 * (x * x + y * y) / (r * r)).exp()),
    ("core and halo", |x, y, r| {
        let core = 0.6 * r;
        let halo = (-0.5 * (x * x + y * y) / (r * r)).exp() / (TAU * r * r);
        0.7 * (core + 0.5 - x.hypot(y)).clamp(0.0, 1.0) / (PI * core * core).max(1.0) + 0.3 * halo
    }),
    ("hexagon", |x, y, r| {
        let side = x.abs().max((0.5 * x + 0.866 * y).abs()).max((0.5 * x - 0.866 * y).abs());
        (0.95 * r + 0.5 - side).clamp(0.0, 1.0)
    }),
    ("ring", |x, y, r| (r + 0.5 - x.hypot(y)).clamp(0.0, 1.0) * (x.hypot(y) - 0.5 * r + 0.5).clamp(0.0, 1.0)),
];

type Curve = (&'static str, fn(f64) -> f64);

/// Tone curves: stored value of light, both 0..1.
const CURVES: [Curve; 3] = [
    ("linear", |l| l),
    ("srgb", srgb),
    ("filmic", |l| {
        let v = srgb(l);
        v + 0.35 * v * (1.0 - v) * (2.0 * v - 1.0)
    }),
];

fn srgb(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// The plane convolved with a kernel of about `radius` px; borders are repeated.
fn blurred(plane: &Plane<f32>, kernel: fn(f64, f64, f64) -> f64, radius: f64) -> Plane<f32> {
    if radius < 0.3 {
        return plane.clone();
    }
    let reach = (2.2 * radius).ceil() as i64 + 1;
    let taps: Vec<(i64, i64, f64)> = (-reach..=reach)
        .flat_map(|y| (-reach..=reach).map(move |x| (x, y, kernel(x as f64, y as f64, radius))))
        .filter(|t| t.2 > 1e-7)
        .collect();
    let sum: f64 = taps.iter().map(|t| t.2).sum();
    let taps: Vec<(i64, i64, f32)> = taps.into_iter().map(|(x, y, w)| (x, y, (w / sum) as f32)).collect();
    // rows with their ends repeated, so that the inner loop has no borders
    let width = plane.width + 2 * reach as usize;
    let wide = Plane::from_fn(width, plane.height, |x, y| {
        plane.at((x as i64 - reach).clamp(0, plane.width as i64 - 1) as usize, y)
    });
    let mut out = Plane::filled(plane.width, plane.height, 0.0_f32);
    for (dx, dy, weight) in taps {
        for y in 0..plane.height {
            let from = wide.row((y as i64 + dy).clamp(0, plane.height as i64 - 1) as usize);
            let to = &mut out.data[y * plane.width..(y + 1) * plane.width];
            to.iter_mut().zip(&from[(reach + dx) as usize..]).for_each(|(to, from)| *to += weight * from);
        }
    }
    out
}

/// Position of a slice on the rail relative to the reference slice.
fn dz(slice: usize) -> f64 {
    slice as f64 - (SLICES / 2) as f64
}

/// Light of a slice relative to the reference slice.
fn exposure(slice: usize) -> f64 {
    (1.0 + 0.015 * dz(slice)).powi(-2)
}

/// The stack in light, blurred up to 0.5 of the pitch, focused one slice from the reference.
fn in_light(kernel: fn(f64, f64, f64) -> f64) -> Vec<Plane<f32>> {
    (0..SLICES)
        .map(|i| blurred(&target(1.0 / (1.0 + 0.015 * dz(i))), kernel, PITCH * 0.125 * (dz(i) + 1.0).abs()))
        .collect()
}

/// What a camera with this tone curve stores. `factor`: light per slice besides the exposure.
fn stored(light: &[Plane<f32>], curve: fn(f64) -> f64, factor: impl Fn(usize) -> f64) -> Vec<Raster> {
    let slice = |(i, light): (usize, &Plane<f32>)| {
        let level = |l: &f32| 65_535.0 * curve((f64::from(*l) * exposure(i) * factor(i)).min(1.0));
        Raster::sixteen(WIDTH, HEIGHT, 1, light.data.iter().map(|l| level(l).round() as u16).collect())
    };
    light.iter().enumerate().map(slice).collect()
}

fn calibrated(rasters: &[Raster]) -> Calibration {
    calibrate(&Stack(rasters), &CalibrationOptions::default(), &NoControl).expect("a calibration")
}

/// Relative error of the gain of each measured slice.
fn errors(found: &Calibration, curve: fn(f64) -> f64, factor: impl Fn(usize) -> f64) -> Vec<f64> {
    let white = |i: usize| curve(0.82 * exposure(i) * factor(i));
    let truth = |i: usize| white(SLICES / 2) / white(i);
    (0..SLICES).map(|i| found.slices[i].gain / truth(i) - 1.0).collect()
}

#[test]
fn gains_are_right_to_half_a_percent_for_any_shape_of_blur_and_any_tone_curve_or_named_uncertain() {
    let mut failed = Vec::new();
    for (shape, kernel) in KERNELS {
        let light = in_light(kernel);
        // one linear camera is enough besides the disc
        let curves = if ["disc", "core and halo"].contains(&shape) { &CURVES[..] } else { &CURVES[1..] };
        for &(name, curve) in curves {
            let found = calibrated(&stored(&light, curve, |_| 1.0));
            let all = errors(&found, curve, |_| 1.0);
            let worst = all.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
            let percent: Vec<String> = all.iter().map(|e| format!("{:+.2}", 100.0 * e)).collect();
            let told = found.warnings.iter().map(|w| w.code.as_str()).collect::<Vec<_>>();
            println!("{shape:14} {name:7} worst {:.2} %: {} {told:?}", 100.0 * worst, percent.join(" "));
            let limit = if told.contains(&"uncertain_gains") { 0.01 } else { 0.005 };
            if worst > limit || told.contains(&"exposure_outlier") {
                failed.push(format!("{shape}, {name}: {:.2} %", 100.0 * worst));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}

/// Slices, each with the share of its light: blurred by a kernel, which is given by its place in [`KERNELS`].
fn odd_light(cases: &[(usize, &[(usize, f64)])]) {
    for &(kernel, cases) in cases {
        let (name, kernel) = KERNELS[kernel];
        let light = in_light(kernel);
        for &(index, factor) in cases {
            let case = format!("{name}, slice {index}, {factor}");
            let factor_of = |i: usize| if i == index { factor } else { 1.0 };
            let found = calibrated(&stored(&light, srgb, factor_of));
            let warning = found.warnings.iter().find(|w| w.code == "exposure_outlier");
            let warning = warning.unwrap_or_else(|| panic!("{case}: no finding"));
            let file = |i: usize| format!("{}.png", char::from(b'a' + i as u8));
            for i in 0..SLICES {
                assert_eq!(warning.detail.contains(&file(i)), i == index, "{case}: {}", warning.detail);
            }
            let word = if factor < 1.0 { "darker" } else { "brighter" };
            assert!(warning.detail.contains(word), "{case}: {}", warning.detail);
            let errors = errors(&found, srgb, factor_of);
            let worst = errors.iter().fold(0.0_f64, |m, e| m.max(e.abs()));
            println!("{case}: worst {:.2} %", 100.0 * worst);
            assert!(worst < 0.005, "{case}: {errors:.4?}");
        }
    }
}

// sharp and blurred slices; the bright level of f.png and g.png is not visible

#[test]
fn a_slice_with_too_little_or_too_much_light_keeps_its_own_gain_and_is_named() {
    odd_light(&[(0, &[(1, 0.65), (5, 1.15)]), (2, &[(5, 0.9), (6, 0.5)])]);
}

#[test]
#[ignore = "more cases of a test"]
fn more_slices_with_too_little_or_too_much_light_keep_their_own_gain_and_are_named() {
    let of_core_and_halo = [(1, 0.65), (2, 0.8), (3, 0.65), (5, 0.65), (5, 1.15)];
    odd_light(&[(0, &[(2, 0.8), (3, 0.65), (5, 0.65), (5, 0.9), (6, 0.5)]), (2, &of_core_and_halo)]);
}

#[test]
fn a_black_slice_a_blank_slice_and_an_overexposed_slice_are_not_called_blurred() {
    let light: Vec<Plane<f32>> = (0..7).map(|i| target(1.0 + 0.01 * f64::from(i - 3))).collect();
    let even = |value: u16| Raster::sixteen(WIDTH, HEIGHT, 1, vec![value; WIDTH * HEIGHT]);
    for (value, word) in [(300, "black"), (30_000, "without dots"), (65_535, "over-exposed")] {
        let mut rasters = stored(&light, srgb, |_| 1.0);
        rasters[5] = even(value);
        let found = calibrated(&rasters);
        let warning = found.warnings.iter().find(|w| w.code == "slice_interpolated").expect("a finding");
        assert!(warning.detail.contains(word) && warning.detail.contains("f.png"), "{}", warning.detail);
        assert!(!found.verdict.contains("pitch is too fine"), "{}", found.verdict);
        // the same slice as the reference, in a stack too short to predict it
        let three = [rasters[4].clone(), rasters[5].clone(), rasters[6].clone()];
        let refused = calibrate(&Stack(&three), &CalibrationOptions::default(), &NoControl);
        let Err(Interrupted::Failed(fault)) = refused else { panic!("a calibration without a reference") };
        assert!(fault.detail.contains(word) && !fault.detail.contains("blurred"), "{}", fault.detail);
    }
}
