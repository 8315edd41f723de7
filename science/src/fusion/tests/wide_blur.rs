//! Stacks whose ends are far out of focus: blur of large radius is computed at a reduced size.

use super::*;
use crate::{fusion::shown::MARGIN, imaging::filter::disc::Disc};

const SIZE: (usize, usize) = (420, 300);
const COUNT: usize = 14;
/// Blur radius per step, px. The near part is sharp in the first slice and the far part in the last: 52 px apart.
const STEP: f32 = 4.0;

fn is_near(x: usize, y: usize) -> bool {
    5 * x + y < 900
}

/// A textured near part, left, before a textured far part.
fn stack() -> Vec<Raster> {
    let (width, height) = SIZE;
    let plane = |value: &dyn Fn(usize, usize) -> f64| Plane::from_fn(width, height, |x, y| value(x, y) as f32);
    let texture = |x: usize, y: usize, seed: usize| 140.0 * noise(x / 3, y / 3, seed);
    let far = Disc::new(1.0).blurred(&plane(&|x, y| 90.0 + texture(x, y, 1)));
    let cover = plane(&|x, y| f64::from(u8::from(is_near(x, y))));
    let near = plane(&|x, y| if is_near(x, y) { 20.0 + texture(x, y, 2) } else { 0.0 });
    let of_slice = |slice: usize| {
        let [of_near, of_far] = [0, COUNT - 1].map(|sharp| Disc::new(STEP * slice.abs_diff(sharp) as f32));
        let (far, cover, near) = (of_far.blurred(&far), of_near.blurred(&cover), of_near.blurred(&near));
        let value = |at: usize| {
            let shown = far.data[at] * (1.0 - cover.data[at]) + near.data[at];
            (f64::from(shown) + 2.0 * (noise(at, slice, 7) - 0.5)) / 255.0
        };
        eight(width, height, &(0..width * height * 3).map(|at| value(at / 3)).collect::<Vec<f64>>())
    };
    (0..COUNT).map(of_slice).collect()
}

/// Asserts that the images are the same at the `counted` pixels, except for the rounding of sums of floats: one grey
/// level at one sample in 10 000.
fn assert_same(found: &Raster, expected: &Raster, counted: impl Fn(usize, usize) -> bool, what: &str) {
    let width = expected.width;
    let (found, expected) = (values(found), values(expected));
    let counted: Vec<usize> = (0..expected.len()).filter(|at| counted(at / 3 % width, at / 3 / width)).collect();
    let differences = counted.iter().map(|&at| (found[at] - expected[at]).abs()).filter(|&difference| difference > 0.0);
    let differences: Vec<f64> = differences.collect();
    let largest = differences.iter().copied().fold(0.0, f64::max);
    let (wrong, all) = (differences.len(), counted.len());
    assert!(wrong * 10_000 <= all && largest <= 1.0, "{what}: {wrong} of {all} samples differ, by up to {largest}");
}

#[test]
fn neither_tiles_nor_a_mask_affect_pixels_that_are_corrected_by_a_large_disc() {
    let slices = stack();
    let plan = |method| Plan { method, near_first: Some(true), ..Plan::aligned(SIZE.0, SIZE.1, COUNT) };
    let halo_corrected = plan(Method::HaloCorrected);
    let whole = fused_in_tiles(&slices, &halo_corrected, 1000);
    let pyramid = fused(&slices, &plan(Method::Pyramid));
    assert!(whole.image != pyramid.image, "the blur is measured");
    for tile in [65, 100] {
        let tiled = fused_in_tiles(&slices, &halo_corrected, tile);
        assert_same(&tiled.image, &whole.image, |_, _| true, &format!("tiles of {tile} px"));
        assert_eq!(tiled.index, whole.index);
    }
    for [left, top] in [[171, 33], [203, 150]] {
        let shown = Plane::from_fn(SIZE.0, SIZE.1, |x, y| {
            if (left..left + 30).contains(&x) && (top..top + 21).contains(&y) { 255u8 } else { 0 }
        });
        let request = FusionRequest { shown: Some(&shown), ..FusionRequest::default() };
        let part = fused_as_asked(&slices, &halo_corrected, &request, 1000);
        let near = |x: usize, y: usize| {
            (left - MARGIN..left + 30 + MARGIN).contains(&x) && (top - MARGIN..top + 21 + MARGIN).contains(&y)
        };
        assert_same(&part.image, &whole.image, near, &format!("shown from {left}, {top}"));
    }
}
