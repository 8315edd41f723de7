//! The definition of guided filtering fusion, written out: whole planes, double precision, no shortcuts. The
//! implementation is compared with it.

use super::*;
use crate::imaging::{Samples, warp::Warp};

struct Slice {
    pixels: Vec<f64>,
    grey: Plane<f64>,
    valid: Plane<bool>,
}

/// Asserts that no sample of the result is farther than `tolerance` levels from the definition. Where the two largest
/// saliencies are equal within single precision, the definition uses the choice of the implementation.
pub(super) fn assert_agrees(slices: &[Raster], plan: &Plan, tolerance: f64) {
    let result = fused(slices, plan);
    let warped: Vec<Slice> = slices.iter().enumerate().map(|(i, raster)| warp(raster, plan, i)).collect();
    let index = sharpest(&warped, plan, &result.index);
    assert_eq!(result.index, index, "the chosen slices differ");

    let (channels, full) = (slices[0].channels, f64::from(slices[0].depth().max()));
    let expected = blend(&warped, &index, channels, &plan.params);
    for (i, (got, expected)) in values(&result.image).iter().zip(&expected).enumerate() {
        let expected = expected.clamp(0.0, full);
        let pixel = i / channels;
        let (x, y) = (pixel % plan.width, pixel / plan.width);
        assert!((got - expected).abs() <= tolerance, "at {x}, {y}: {got} instead of {expected}");
    }
}

fn warp(raster: &Raster, plan: &Plan, slice: usize) -> Slice {
    let size = (plan.width, plan.height);
    let warp = Warp::new(&plan.slices[slice].homography, plan.slices[slice].gain, size, size).unwrap();
    let samples = match raster.samples.clone() {
        Samples::Eight(samples) => Samples::Eight(warp.apply(samples, raster.channels)),
        Samples::Sixteen(samples) => Samples::Sixteen(warp.apply(samples, raster.channels)),
    };
    let pixels = values(&Raster { samples, ..raster.clone() });
    let full = f64::from(raster.depth().max());
    let grey = |x: usize, y: usize| match &pixels[(y * size.0 + x) * raster.channels..][..raster.channels] {
        [grey] => grey / full,
        [red, green, blue, ..] => (0.299 * red + 0.587 * green + 0.114 * blue) / full,
        _ => 0.0,
    };
    let grey = Plane::from_fn(size.0, size.1, grey);
    let valid = Plane::from_fn(size.0, size.1, |x, y| warp.coverage().span(y).contains(&x));
    Slice { pixels, grey, valid }
}

fn clamped(value: i64, length: usize) -> usize {
    value.clamp(0, length as i64 - 1) as usize
}

/// Saliency of one slice; -1 where its window is not wholly covered, -2 where the pixel is not covered.
fn saliency(slice: &Slice, params: &GuidedParams) -> Plane<f64> {
    let (width, height) = (slice.grey.width, slice.grey.height);
    let radius = i64::from(params.r_g);
    let lap = Plane::from_fn(width, height, |x, y| {
        let at = |dx: i64, dy: i64| slice.grey.at(clamped(x as i64 + dx, width), clamped(y as i64 + dy, height));
        (at(-1, 0) + at(1, 0) + at(0, -1) + at(0, 1) - 4.0 * at(0, 0)).abs()
    });
    let weight = |d: i64| (-(d * d) as f64 / (2.0 * params.sigma_g * params.sigma_g)).exp();
    let norm: f64 = (-radius..=radius).map(weight).sum();
    Plane::from_fn(width, height, |x, y| {
        if !slice.valid.at(x, y) {
            return -2.0;
        }
        let place = |dx: i64, dy: i64| (clamped(x as i64 + dx, width), clamped(y as i64 + dy, height));
        let taps = -radius - 1..=radius + 1;
        let all = taps.clone().all(|dy| taps.clone().all(|dx| slice.valid.at(place(dx, dy).0, place(dx, dy).1)));
        if !all {
            return -1.0;
        }
        let mut sum = 0.0;
        for dy in -radius..=radius {
            for dx in -radius..=radius {
                sum += weight(dx) * weight(dy) * lap.at(place(dx, dy).0, place(dx, dy).1);
            }
        }
        sum / (norm * norm)
    })
}

/// The sharpest slice per pixel.
fn sharpest(slices: &[Slice], plan: &Plan, chosen: &Plane<u16>) -> Plane<u16> {
    let saliencies: Vec<Plane<f64>> = slices.iter().map(|slice| saliency(slice, &plan.params)).collect();
    Plane::from_fn(plan.width, plan.height, |x, y| {
        let of = |slice: usize| saliencies[slice].at(x, y);
        let best = (0..slices.len()).map(of).fold(-2.0, f64::max);
        if best == -2.0 {
            return UNCOVERED;
        }
        if best <= 0.0 && of(plan.reference) == best {
            return plan.reference as u16;
        }
        let choice = chosen.at(x, y);
        let near_tie = choice != UNCOVERED && best > 0.0 && of(usize::from(choice)) >= best * (1.0 - 1e-5);
        if near_tie { choice } else { (0..slices.len()).find(|&slice| of(slice) == best).unwrap() as u16 }
    })
}

/// Calls `each` with the index of every valid pixel in the window around (x, y).
fn window(valid: &Plane<bool>, x: usize, y: usize, radius: usize, mut each: impl FnMut(usize)) {
    for v in y.saturating_sub(radius)..(y + radius + 1).min(valid.height) {
        for u in x.saturating_sub(radius)..(x + radius + 1).min(valid.width) {
            if valid.at(u, v) {
                each(v * valid.width + u);
            }
        }
    }
}

/// The guided filter of `map`, guided by the luma of a slice.
fn guided(slice: &Slice, map: &[f64], radius: usize, eps: f64) -> Vec<f64> {
    let (width, height) = (slice.grey.width, slice.grey.height);
    let grey = &slice.grey.data;
    let lines = Plane::from_fn(width, height, |x, y| {
        let (mut n, mut i, mut p) = (0.0, 0.0, 0.0);
        window(&slice.valid, x, y, radius, |at| {
            n += 1.0;
            i += grey[at];
            p += map[at];
        });
        let (mean_i, mean_p, mut cov, mut var) = (i / n, p / n, 0.0, 0.0);
        window(&slice.valid, x, y, radius, |at| {
            cov += (grey[at] - mean_i) * (map[at] - mean_p) / n;
            var += (grey[at] - mean_i) * (grey[at] - mean_i) / n;
        });
        let a = cov / (var + eps);
        (a, mean_p - a * mean_i)
    });
    let mean = |x: usize, y: usize| {
        let (mut n, mut a, mut b) = (0.0, 0.0, 0.0);
        window(&slice.valid, x, y, radius, |at| {
            n += 1.0;
            a += lines.data[at].0;
            b += lines.data[at].1;
        });
        if slice.valid.at(x, y) { (a * slice.grey.at(x, y) + b) / n } else { 0.0 }
    };
    Plane::from_fn(width, height, mean).data
}

/// The base layer of a slice.
fn base(slice: &Slice, channels: usize, side: usize) -> Vec<f64> {
    let (width, height, radius) = (slice.grey.width, slice.grey.height, side as i64 / 2);
    let mut out = vec![0.0; slice.pixels.len()];
    for y in 0..height {
        for x in 0..width {
            let mut count = 0.0;
            let sums = &mut out[(y * width + x) * channels..][..channels];
            for dy in -radius..=radius {
                for dx in -radius..=radius {
                    let (u, v) = (clamped(x as i64 + dx, width), clamped(y as i64 + dy, height));
                    if slice.valid.at(u, v) {
                        count += 1.0;
                        (0..channels).for_each(|c| sums[c] += slice.pixels[(v * width + u) * channels + c]);
                    }
                }
            }
            sums.iter_mut().for_each(|sum| *sum /= f64::max(count, 1.0));
        }
    }
    out
}

/// The fused samples.
fn blend(slices: &[Slice], index: &Plane<u16>, channels: usize, params: &GuidedParams) -> Vec<f64> {
    let pixels = index.data.len();
    let (mut bases, mut details) = (vec![0.0; pixels * channels], vec![0.0; pixels * channels]);
    let mut totals = vec![[1e-12, 1e-12]; pixels];
    for (n, slice) in slices.iter().enumerate() {
        let map: Vec<f64> = index.data.iter().map(|&slice| f64::from(u8::from(usize::from(slice) == n))).collect();
        let coarse = guided(slice, &map, params.r1 as usize, params.eps1);
        let fine = guided(slice, &map, params.r2 as usize, params.eps2);
        let base = base(slice, channels, params.average as usize);
        for at in 0..pixels {
            let (wb, wd) = (coarse[at].clamp(0.0, 1.0), fine[at].clamp(0.0, 1.0));
            totals[at][0] += wb;
            totals[at][1] += wd;
            for c in at * channels..(at + 1) * channels {
                bases[c] += wb * base[c];
                details[c] += wd * (slice.pixels[c] - base[c]);
            }
        }
    }
    (0..pixels * channels).map(|c| bases[c] / totals[c / channels][0] + details[c] / totals[c / channels][1]).collect()
}
