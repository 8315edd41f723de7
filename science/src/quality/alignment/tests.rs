use super::*;
use crate::{
    imaging::warp::Warp,
    synth::{Light, Rig, Scene, Stage},
    types::Homography,
};

/// A texture that is defined at any position: waves of many lengths and directions, 0..255.
fn texture(x: f64, y: f64, blur: f64) -> f64 {
    let mut value = 128.0;
    for k in 0..60u32 {
        let angle = f64::from(k) * 2.399_963;
        let frequency = 0.01 * 1.06f64.powi(k as i32);
        let (u, v) = (frequency * angle.cos(), frequency * angle.sin());
        // amplitude of this wave after a symmetric blur
        let left = (-2.0 * (std::f64::consts::PI * blur * frequency).powi(2)).exp();
        let phase = f64::from(k * k) * 0.7;
        value += 9.0 * left * (std::f64::consts::TAU * (u * x + v * y) + phase).sin();
    }
    value
}

const WIDTH: usize = 400;
const HEIGHT: usize = 320;

/// Noise of about one grey level, different for every slice.
fn noise(seed: u64, x: usize, y: usize) -> f64 {
    let mut bits = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ ((x as u64) << 32 | y as u64);
    let mut sum = 0.0;
    for _ in 0..3 {
        bits = (bits ^ (bits >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits ^= bits >> 29;
        sum += (bits >> 11) as f64 / (1u64 << 53) as f64 - 0.5;
    }
    2.0 * sum
}

/// Slices in which pixel (x, y) of slice `n` shows the scene at `place(n, x, y)`, blurred by `blur(n)` px.
fn stack(count: usize, place: impl Fn(usize, f64, f64) -> (f64, f64), blur: impl Fn(usize) -> f64) -> Vec<Plane<f32>> {
    let slice = |n: usize| {
        Plane::from_fn(WIDTH, HEIGHT, |x, y| {
            let (sx, sy) = place(n, x as f64, y as f64);
            (texture(sx, sy, blur(n)) + noise(n as u64 + 1, x, y)) as f32
        })
    };
    (0..count).map(slice).collect()
}

fn measured(stack: &[Plane<f32>], object: Option<&Plane<u8>>) -> Alignment {
    let valid = |window: Rect| Plane::filled(window.width, window.height, 255u8);
    let (width, height) = (stack[0].width, stack[0].height);
    measure(stack.len(), &|n, window| Some((stack[n].crop(window), valid(window))), width, height, object)
}

#[test]
fn a_difference_in_focus_is_not_a_misalignment() {
    let found = measured(&stack(4, |_, x, y| (x, y), |n| 0.3 * n as f64), None);
    assert!(found.metrics.residual_p95_px.unwrap() < 0.15, "{found:?}");
    assert!((found.metrics.residual_scale.unwrap() - 1.0).abs() < 3e-4, "{found:?}");
}

#[test]
fn a_slice_far_out_of_focus_has_no_residual() {
    let found = measured(&stack(2, |_, x, y| (x, y), |n| 5.0 * n as f64), None);
    assert_eq!(found.metrics.residual_p50_px, None, "{found:?}");
    assert_eq!(found.per_slice, [None, None], "{found:?}");
}

/// The slices of the synthetic rig, warped by one `homography` per slice, and the mask of the object.
fn rendered(rig: &Rig, homography: impl Fn(usize) -> Homography) -> (Vec<Plane<f32>>, Plane<u8>) {
    let stage = Stage::new(rig, &Scene::insect(3));
    let slices = (0..rig.slices()).map(|i| {
        let luma = stage.render(Light::Front, i).luma();
        let size = (rig.width, rig.height);
        let warp = Warp::new(&homography(i), rig.gain(i), size, size).expect("the homography is regular");
        let samples = warp.apply(luma.data.iter().map(|v| (v * 257.0) as u16).collect(), 1);
        Plane { width: rig.width, height: rig.height, data: samples.iter().map(|v| f32::from(*v) / 257.0).collect() }
    });
    (slices.collect(), stage.truth().mask)
}

#[test]
fn an_exact_profile_leaves_little_and_a_shifted_slice_is_found_on_a_scene_with_depth() {
    let rig = Rig::sized(600, 400, 7);
    let (exact, object) = rendered(&rig, |i| rig.homography(i));
    let found = measured(&exact, Some(&object));
    assert!(found.metrics.residual_p95_px.is_some_and(|p95| p95 < 0.3), "{found:?}");

    let bump = Homography::similarity(1.0, [1.0, 0.0]);
    let bumped = |i: usize| rig.homography(i).then(&bump).filter(|_| i == 4).unwrap_or(rig.homography(i));
    let (bumped, object) = rendered(&rig, bumped);
    let found = measured(&bumped, Some(&object));
    assert!(found.per_slice[4].is_some_and(|residual| (residual - 1.0).abs() < 0.2), "{found:?}");
}

#[test]
fn a_shift_is_found_to_a_tenth_of_a_pixel_through_defocus() {
    let found = measured(&stack(3, |n, x, y| (x - 0.7 * n as f64, y), |n| 0.3 * n as f64), None);
    for residual in [found.metrics.residual_p50_px, found.per_slice[1], found.per_slice[2]] {
        assert!((residual.unwrap() - 0.7).abs() < 0.1, "{found:?}");
    }
    assert_eq!(found.per_slice[0], None);
}

#[test]
fn a_shift_of_many_pixels_is_found() {
    let found = measured(&stack(2, |n, x, y| (x - 9.0 * n as f64, y + 5.5 * n as f64), |_| 0.5), None);
    assert!((found.metrics.residual_p50_px.unwrap() - 9.0f64.hypot(5.5)).abs() < 0.2, "{found:?}");
}

#[test]
fn the_scale_between_neighbours_is_found() {
    let (cx, cy) = (WIDTH as f64 / 2.0, HEIGHT as f64 / 2.0);
    let scaled = |n: usize, x: f64, y: f64| {
        let scale = 1.002f64.powi(n as i32);
        (cx + (x - cx) / scale, cy + (y - cy) / scale)
    };
    let found = measured(&stack(3, scaled, |n| 0.3 * n as f64), None);
    assert!((found.metrics.residual_scale.unwrap() - 1.002).abs() < 3e-4, "{found:?}");
}

#[test]
fn a_stack_without_texture_has_no_residual() {
    let flat = vec![Plane::filled(WIDTH, HEIGHT, 90.0f32); 3];
    let found = measured(&flat, None);
    assert_eq!(found.metrics, AlignmentMetrics::default());
    assert_eq!(found.per_slice, [None, None, None]);
}

#[test]
fn noise_alone_gives_no_shift() {
    let noisy: Vec<_> =
        (0..3).map(|n| Plane::from_fn(WIDTH, HEIGHT, |x, y| (90.0 + 4.0 * noise(n + 7, x, y)) as f32)).collect();
    assert_eq!(measured(&noisy, None).metrics, AlignmentMetrics::default());
}

#[test]
fn only_the_object_is_measured() {
    // the left half shifts, the right half is the object and does not
    let halves = stack(2, |n, x, y| (if x < 200.0 { x - 1.5 * n as f64 } else { x }, y), |_| 0.5);
    let object = Plane::from_fn(WIDTH, HEIGHT, |x, _| if x >= 200 { 255u8 } else { 0 });
    assert!(measured(&halves, Some(&object)).metrics.residual_p95_px.unwrap() < 0.15);
    assert!(measured(&halves, None).metrics.residual_p95_px.unwrap() > 1.0);
    assert_eq!(measured(&halves, Some(&object.map(|_| 0))).metrics, AlignmentMetrics::default());
}

#[test]
fn windows_that_a_slice_does_not_cover_are_skipped() {
    let slices = stack(2, |_, x, y| (x, y), |_| 0.5);
    let torn = |n: usize, window: Rect| {
        let valid = Plane::from_fn(window.width, window.height, |x, _| if window.x + x < 250 { 255u8 } else { 0 });
        let luma = slices[n].crop(window);
        let data = luma.data.iter().zip(&valid.data).map(|(&v, &c)| if c == 0 { f32::NAN } else { v }).collect();
        Some((Plane { data, ..luma }, valid))
    };
    let found = measure(2, &torn, WIDTH, HEIGHT, None);
    assert!(found.metrics.residual_p95_px.unwrap() < 0.15, "{found:?}");
    assert_eq!(measure(2, &|_, _| None, WIDTH, HEIGHT, None).metrics, AlignmentMetrics::default());
}

#[test]
fn a_single_slice_or_a_tiny_canvas_has_nothing_to_measure() {
    let read = |_: usize, window: Rect| {
        Some((Plane::filled(window.width, window.height, 1.0f32), Plane::filled(window.width, window.height, 255u8)))
    };
    assert_eq!(measure(1, &read, 400, 300, None).per_slice, [None]);
    assert_eq!(measure(0, &read, 400, 300, None).per_slice, []);
    assert_eq!(measure(2, &read, 20, 300, None).metrics, AlignmentMetrics::default());
}
