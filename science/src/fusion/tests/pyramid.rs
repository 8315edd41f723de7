//! Tests of pyramid fusion: against its definition, and by property.

use super::*;
use crate::imaging::Coverage;

fn plan(plan: Plan) -> Plan {
    Plan { method: Method::Pyramid, ..plan }
}

/// A channel of a level, whole, in double precision.
type Level = Plane<f64>;

const KERNEL: [f64; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];

/// Sum of `kernel(dx) kernel(dy) value`, and of the kernel, over the neighbours that lie in the plane.
fn around(plane: &Level, x: usize, y: usize, kernel: &[f64]) -> [f64; 2] {
    let reach = (kernel.len() / 2) as i64;
    let mut sums = [0.0; 2];
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (u, v) = (x as i64 + dx, y as i64 + dy);
            if u >= 0 && v >= 0 && u < plane.width as i64 && v < plane.height as i64 {
                let weight = kernel[(dx + reach) as usize] * kernel[(dy + reach) as usize];
                sums[0] += weight * plane.at(u as usize, v as usize);
                sums[1] += weight;
            }
        }
    }
    sums
}

/// The weighted mean of the coarse pixels within the kernel around each fine pixel.
fn expanded(coarse: &Level, width: usize, height: usize) -> Level {
    Plane::from_fn(width, height, |x, y| {
        let (mut sum, mut total) = (0.0, 0.0);
        for v in 0..coarse.height {
            for u in 0..coarse.width {
                let (dx, dy) = (x.abs_diff(2 * u), y.abs_diff(2 * v));
                if dx <= 2 && dy <= 2 {
                    let weight = KERNEL[2 + dx] * KERNEL[2 + dy];
                    sum += weight * coarse.at(u, v);
                    total += weight;
                }
            }
        }
        sum / total
    })
}

/// Energy of three channels, smoothed by `kernel`.
fn energy(detail: &[Level; 3], kernel: &[f64]) -> Level {
    let (width, height) = (detail[0].width, detail[0].height);
    let own = Plane::from_fn(width, height, |x, y| {
        let of = |c: usize, part: f64| part * detail[c].at(x, y).powi(2);
        of(0, 0.299) + of(1, 0.587) + of(2, 0.114)
    });
    Plane::from_fn(width, height, |x, y| around(&own, x, y, kernel)[0])
}

/// The definition for slices that cover the whole canvas: interleaved samples before they are clamped.
fn definition(slices: &[Raster]) -> Vec<f64> {
    let (width, height) = (slices[0].width, slices[0].height);
    let channel = |slice: &Raster, c: usize| {
        let values = values(slice);
        Plane::from_fn(width, height, |x, y| values[(y * width + x) * 3 + c])
    };
    let mut current: Vec<[Level; 3]> = slices.iter().map(|slice| std::array::from_fn(|c| channel(slice, c))).collect();
    // levels carry their normalisation, as for slices that do not cover the canvas
    let mut weights = Plane::filled(width, height, 1.0);
    let twice: Vec<f64> = [1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0].map(|v| v / 256.0).to_vec();
    let mut fused: Vec<[Level; 3]> = Vec::new();
    let choose = |parts: &[[Level; 3]], energies: &[Level]| -> [Level; 3] {
        std::array::from_fn(|c| {
            Plane::from_fn(parts[0][0].width, parts[0][0].height, |x, y| {
                let weight = |i: usize| (energies[i].at(x, y) + 1e-3).powi(4);
                let total: f64 = (0..parts.len()).map(weight).sum();
                (0..parts.len()).map(|i| weight(i) * parts[i][c].at(x, y)).sum::<f64>() / total
            })
        })
    };
    for _ in 0..4 {
        let (w, h) = (weights.width, weights.height);
        if w.min(h) < 8 {
            break;
        }
        let half = (w.div_ceil(2), h.div_ceil(2));
        let next_weights = Plane::from_fn(half.0, half.1, |x, y| around(&weights, 2 * x, 2 * y, &KERNEL)[0]);
        let reduce = |plane: &Level| {
            let held = Plane::from_fn(w, h, |x, y| plane.at(x, y) * weights.at(x, y));
            Plane::from_fn(half.0, half.1, |x, y| around(&held, 2 * x, 2 * y, &KERNEL)[0] / next_weights.at(x, y))
        };
        let next: Vec<[Level; 3]> = current.iter().map(|of| std::array::from_fn(|c| reduce(&of[c]))).collect();
        let details: Vec<[Level; 3]> = current
            .iter()
            .zip(&next)
            .map(|(fine, coarse)| {
                std::array::from_fn(|c| {
                    let coarse = expanded(&coarse[c], w, h);
                    Plane::from_fn(w, h, |x, y| fine[c].at(x, y) - coarse.at(x, y))
                })
            })
            .collect();
        let energies: Vec<Level> = details.iter().map(|detail| energy(detail, &twice)).collect();
        fused.push(choose(&details, &energies));
        (current, weights) = (next, next_weights);
    }
    let deviations: Vec<Level> = current
        .iter()
        .map(|base| {
            let away = std::array::from_fn(|c| {
                let held = Plane::from_fn(weights.width, weights.height, |x, y| base[c].at(x, y) * weights.at(x, y));
                Plane::from_fn(weights.width, weights.height, |x, y| {
                    base[c].at(x, y) - around(&held, x, y, &KERNEL)[0] / around(&weights, x, y, &KERNEL)[0]
                })
            });
            energy(&away, &KERNEL)
        })
        .collect();
    let mut result = choose(&current, &deviations);
    for detail in fused.iter().rev() {
        result = std::array::from_fn(|c| {
            let (w, h) = (detail[c].width, detail[c].height);
            let coarse = expanded(&result[c], w, h);
            Plane::from_fn(w, h, |x, y| detail[c].at(x, y) + coarse.at(x, y))
        });
    }
    (0..width * height).flat_map(|at| std::array::from_fn::<f64, 3, _>(|c| result[c].data[at])).collect()
}

#[test]
fn the_result_agrees_with_the_definition_clamped_to_the_range_of_the_slices() {
    let (width, height) = (77, 58);
    let slices = strips(width, height, 3);
    let found = values(&fused(&slices, &plan(Plan::aligned(width, height, 3))).image);
    let expected = definition(&slices);
    let sources: Vec<Vec<f64>> = slices.iter().map(values).collect();
    for y in 0..height {
        for x in 0..width {
            for c in 0..3 {
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                for v in y.saturating_sub(1)..(y + 2).min(height) {
                    for u in x.saturating_sub(1)..(x + 2).min(width) {
                        for source in &sources {
                            low = low.min(source[(v * width + u) * 3 + c]);
                            high = high.max(source[(v * width + u) * 3 + c]);
                        }
                    }
                }
                let at = (y * width + x) * 3 + c;
                let expected = expected[at].clamp(low, high);
                assert!((found[at] - expected).abs() < 0.51, "{} for {expected} at {x}, {y}", found[at]);
            }
        }
    }
}

#[test]
fn each_strip_has_the_texture_of_the_slice_that_shows_it_sharp() {
    let (width, height, count) = (180, 90, 3);
    let slices = strips(width, height, count);
    let image = values(&fused(&slices, &plan(Plan::aligned(width, height, count))).image);
    let sources: Vec<Vec<f64>> = slices.iter().map(values).collect();
    for y in 0..height {
        for x in (0..width).filter(|x| (16..44).contains(&(x % 60))) {
            for c in 0..3 {
                let at = (y * width + x) * 3 + c;
                let away = image[at] - sources[x * count / width][at];
                assert!(away.abs() < 12.0, "{away} levels from the sharp slice at {x}, {y}");
            }
        }
    }
}

#[test]
fn identical_slices_are_returned_unchanged_in_every_sample_format() {
    let (width, height) = (70, 61);
    let image = strip(width, height, 2, 0);
    let grey = image.iter().step_by(3).map(|v| (v * 255.0).round() as u8).collect();
    for (one, slack) in [
        (eight(width, height, &image), 0.0),
        (sixteen(width, height, &image), 1.0),
        (Raster::eight(width, height, 1, grey), 0.0),
    ] {
        let stack = [one.clone(), one.clone(), one.clone()];
        let result = fused(&stack, &plan(Plan::aligned(width, height, 3)));
        assert_eq!((result.image.channels, result.image.depth()), (one.channels, one.depth()));
        for (found, given) in values(&result.image).iter().zip(values(&one)) {
            assert!((found - given).abs() <= slack, "{found} for {given}");
        }
        assert_eq!(result.warnings, []);
    }
}

#[test]
fn the_order_of_the_slices_does_not_matter() {
    let (slices, given) = unaligned(120, 80, 4);
    let turned =
        Plan { slices: given.slices.iter().rev().copied().collect(), reference: 3 - given.reference, ..given.clone() };
    let backwards: Vec<Raster> = slices.iter().rev().cloned().collect();
    let (one, other) = (fused(&slices, &plan(given)), fused(&backwards, &plan(turned)));
    let worst = values(&one.image).iter().zip(values(&other.image)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst <= 1.0, "{worst} levels apart");
}

#[test]
fn tiles_and_threads_do_not_affect_the_result() {
    let (slices, given) = unaligned(203, 141, 3);
    let given = plan(given);
    let whole = fused_in_tiles(&slices, &given, 1000);
    for tile in [31, 64, 101] {
        assert_eq!(fused_in_tiles(&slices, &given, tile), whole, "tiles of {tile} px");
    }
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| fused_in_tiles(&slices, &given, 64)), whole, "{threads} threads");
    }
}

#[test]
fn borders_of_slices_inside_the_canvas_do_not_show() {
    // slices of one uniform colour that end inside the canvas
    let (width, height) = (150, 110);
    let (_, given) = unaligned(width, height, 5);
    let even = eight(width, height, &vec![0.6; width * height * 3]);
    let stack = vec![even.clone(); 5];
    let mut given = plan(given);
    given.slices.iter_mut().for_each(|slice| slice.gain = 1.0);
    let result = fused(&stack, &given);
    let full = Coverage::full(width, height).pixels();
    let covered = result.valid.data.iter().filter(|&&v| v != 0).count();
    assert!(covered < full || result.warnings.is_empty());
    for (pixel, &valid) in values(&result.image).chunks_exact(3).zip(&result.valid.data) {
        let expected = if valid == 0 { 0.0 } else { 153.0 };
        assert_eq!(pixel, [expected; 3]);
    }
}

#[test]
fn a_pixel_that_only_one_slice_covers_is_taken_from_it() {
    let (width, height) = (120, 90);
    let slices = strips(width, height, 2);
    let mut given = plan(Plan::aligned(width, height, 2));
    // the other slice covers the left half only
    given.reference = 0;
    given.slices[1].homography = Homography::similarity(1.0, [-60.0, 0.0]);
    let result = fused(&slices, &given);
    let (found, source) = (values(&result.image), values(&slices[0]));
    for y in 0..height {
        for x in 100..width {
            for c in 0..3 {
                let at = (y * width + x) * 3 + c;
                assert!((found[at] - source[at]).abs() <= 3.0, "{} for {} at {x}, {y}", found[at], source[at]);
            }
        }
    }
}

#[test]
fn noise_is_averaged_where_slices_show_nothing_else() {
    let (width, height, count) = (96, 80, 9);
    let noisy = |slice: usize| {
        let level = |i: usize| 0.5 + 0.02 * (noise(i % width, i / width, 77 + slice) - 0.5);
        eight(width, height, &(0..width * height).flat_map(|i| [level(i); 3]).collect::<Vec<_>>())
    };
    let slices: Vec<Raster> = (0..count).map(noisy).collect();
    let spread = |raster: &Raster| {
        let values = values(raster);
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let result = fused(&slices, &plan(Plan::aligned(width, height, count)));
    assert!(spread(&result.image) < 0.8 * spread(&slices[0]), "{} of {}", spread(&result.image), spread(&slices[0]));
}

#[test]
fn the_parameters_of_guided_filtering_have_no_effect() {
    let (slices, given) = unaligned(120, 90, 4);
    let params = GuidedParams { r1: 20, eps1: 0.1, r2: 4, eps2: 1e-4, average: 15, r_g: 1, sigma_g: 0.5 };
    let of = |method: Method| {
        let default = Plan { method, ..given.clone() };
        [fused(&slices, &default), fused(&slices, &Plan { params, ..default.clone() })]
    };
    let [default, other] = of(Method::Pyramid);
    assert_eq!(default, other);
    let [default, other] = of(Method::Guided);
    assert!(default.index != other.index, "the saliency of guided filtering depends on them");
}
