use super::*;
use crate::quality::{piella, sampling::Blocks, two_source, xydeas};
use crate::types::metrics::FusionMetrics;

/// A textured picture, and slices of it as an inclined plane: each is in focus at one column and more blurred farther
/// away.
mod ramp {
    use super::Plane;

    /// Fine and coarse texture, edges and fine lines; 0..255.
    pub(super) fn ideal(width: usize, height: usize) -> Plane<f32> {
        let mut state = 12_345u64;
        let noise: Vec<f32> = (0..width * height)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
            })
            .collect();
        let noise = Plane { width, height, data: noise };
        // octaves of noise, each with the same energy: the spectrum of natural pictures
        let octaves: Vec<(Plane<f32>, f32)> = [1usize, 2, 4, 8]
            .into_iter()
            .map(|radius| (disk(&noise, radius as f32 * 0.75), 40.0 * radius as f32))
            .collect();
        Plane::from_fn(width, height, |x, y| {
            let fine: f32 = octaves.iter().map(|(octave, gain)| octave.at(x, y) * gain).sum();
            let step = if (x / 23 + y / 31) % 2 == 0 { 30.0 } else { -30.0 };
            (128.0 + fine + step).clamp(0.0, 255.0).round()
        })
    }

    /// Mean over a disk with a soft rim, borders replicated.
    pub(super) fn disk(picture: &Plane<f32>, radius: f32) -> Plane<f32> {
        blurred(picture, |_| radius)
    }

    /// Disk blur with a radius that depends on the column.
    pub(super) fn blurred(picture: &Plane<f32>, radius: impl Fn(usize) -> f32) -> Plane<f32> {
        let (width, height) = (picture.width as isize, picture.height as isize);
        let mut out = picture.clone();
        for x in 0..picture.width {
            let radius = radius(x);
            let reach = (radius + 0.5).floor() as isize;
            let mut taps = Vec::new();
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let weight = (radius + 0.5 - ((dx * dx + dy * dy) as f32).sqrt()).clamp(0.0, 1.0);
                    if weight > 0.0 {
                        taps.push((dx, dy, weight));
                    }
                }
            }
            let total: f32 = taps.iter().map(|tap| tap.2).sum();
            for y in 0..picture.height {
                let sum: f32 = taps
                    .iter()
                    .map(|&(dx, dy, weight)| {
                        let (sx, sy) = ((x as isize + dx).clamp(0, width - 1), (y as isize + dy).clamp(0, height - 1));
                        weight * picture.at(sx as usize, sy as usize)
                    })
                    .sum();
                out.data[y * picture.width + x] = sum / total;
            }
        }
        out
    }

    /// `count` slices of a depth that rises over the columns in as many steps; blur up to 8 px.
    pub(super) fn slices(ideal: &Plane<f32>, count: usize) -> Vec<Plane<f32>> {
        let depth = |x: usize| (x * count / ideal.width) as f32 / (count - 1) as f32;
        let focus = |n: usize| n as f32 / (count - 1) as f32;
        (0..count).map(|n| blurred(ideal, |x| 8.0 * (depth(x) - focus(n)).abs()).map(f32::round)).collect()
    }
}

/// Scores one block.
fn score(
    fused: &Plane<f32>,
    slices: &mut dyn Iterator<Item = (Plane<f32>, Option<Plane<u8>>)>,
    object: Option<&Plane<u8>>,
) -> ScoreSums {
    let mut scorer = Scorer::new(fused, object);
    for (luma, valid) in slices {
        scorer.slice(&luma, valid.as_ref());
    }
    scorer.sums()
}

fn scored(fused: &Plane<f32>, slices: &[Plane<f32>]) -> FusionMetrics {
    score(fused, &mut slices.iter().map(|slice| (slice.clone(), None)), None).metrics()
}

fn mean(slices: &[Plane<f32>]) -> Plane<f32> {
    let count = slices.len() as f32;
    Plane::from_fn(slices[0].width, slices[0].height, |x, y| {
        (slices.iter().map(|slice| slice.at(x, y)).sum::<f32>() / count).round()
    })
}

#[test]
fn the_ideal_image_beats_its_blur_and_the_mean_whatever_the_number_of_slices() {
    let ideal = ramp::ideal(200, 96);
    // a disk of radius 2 has the variance of a Gaussian of sigma 1
    let blurred = ramp::disk(&ideal, 2.0).map(f32::round);
    for count in [2, 5, 10, 20] {
        let slices = ramp::slices(&ideal, count);
        let sources: Vec<&Plane<f32>> = slices.iter().collect();
        let numbers = [&ideal, &blurred, &mean(&slices)].map(|fused| {
            let scored = scored(fused, &slices);
            let viff = two_source::viff(&sources, fused);
            [scored.q_g_top.unwrap(), scored.q_w_top.unwrap(), viff.unwrap(), scored.sharpness_retention.unwrap()]
        });
        let [ideal, blur, mean] = numbers;
        for (name, k) in [("q_g_top", 0), ("q_w_top", 1), ("viff", 2), ("retention", 3)] {
            assert!(ideal[k] > blur[k] + 0.1 && ideal[k] > mean[k] + 0.02, "{name}, {count} slices: {numbers:?}");
            // few slices: half of the mean of two is sharp
            assert!(count < 10 || blur[k] > mean[k], "{name}, {count} slices: {numbers:?}");
        }
        assert!(ideal[0] > 0.8 && ideal[1] > 0.98 && ideal[2] > 0.95, "{count} slices: {numbers:?}");
        assert!((0.9..=1.02).contains(&ideal[3]), "{count} slices: {numbers:?}");
    }
}

/// The score in the sampled blocks of a canvas.
fn sampled(fused: &Plane<f32>, slices: &[Plane<f32>]) -> FusionMetrics {
    let blocks = Blocks::of(fused.width, fused.height, None).rects;
    let pixels: usize = blocks.iter().map(|block| block.width * block.height).sum();
    assert!(pixels * 2 < fused.data.len(), "the canvas is too small to be sampled");
    let mut sums = ScoreSums::default();
    for block in blocks {
        sums.merge(&score(&fused.crop(block), &mut slices.iter().map(|slice| (slice.crop(block), None)), None));
    }
    sums.metrics()
}

#[test]
fn the_ranking_is_the_same_on_a_sampled_canvas() {
    let ideal = ramp::ideal(720, 400);
    let blurred = ramp::disk(&ideal, 2.0).map(f32::round);
    for count in [2, 5, 10, 20] {
        let slices = ramp::slices(&ideal, count);
        let numbers = [&ideal, &blurred, &mean(&slices)].map(|fused| {
            let scored = sampled(fused, &slices);
            [scored.q_g_top.unwrap(), scored.q_w_top.unwrap(), scored.sharpness_retention.unwrap()]
        });
        let [ideal, blur, mean] = numbers;
        for (name, k) in [("q_g_top", 0), ("q_w_top", 1), ("retention", 2)] {
            assert!(ideal[k] > blur[k] + 0.1 && ideal[k] > mean[k] + 0.02, "{name}, {count} slices: {numbers:?}");
            assert!(count < 10 || blur[k] > mean[k], "{name}, {count} slices: {numbers:?}");
        }
    }
}

/// The metrics by their definition: per pixel the sharpest gradient, per window the largest variance.
fn by_definition(fused: &Plane<f32>, slices: &[Plane<f32>]) -> (f64, f64) {
    let gradient = |p: &Plane<f32>, x: usize, y: usize| {
        let v = |dx: usize, dy: usize| p.at(x + dx - 1, y + dy - 1);
        let gx = v(2, 0) + 2.0 * v(2, 1) + v(2, 2) - v(0, 0) - 2.0 * v(0, 1) - v(0, 2);
        let gy = v(0, 2) + 2.0 * v(1, 2) + v(2, 2) - v(0, 0) - 2.0 * v(1, 0) - v(2, 0);
        (gx, gy)
    };
    let strength = |(gx, gy): (f32, f32)| f64::from(gx).hypot(f64::from(gy));
    let (mut kept, mut weights) = (0.0, 0.0);
    for y in 1..fused.height - 1 {
        for x in 1..fused.width - 1 {
            // of equally sharp slices the first
            let of_slices = slices.iter().rev().map(|slice| gradient(slice, x, y));
            let sharpest = of_slices.max_by(|a, b| strength(*a).total_cmp(&strength(*b))).unwrap();
            let preserved = xydeas::preservation(sharpest, gradient(fused, x, y));
            kept += strength(sharpest) * f64::from(preserved);
            weights += strength(sharpest);
        }
    }
    let windows: Vec<_> = slices.iter().map(|slice| piella::moments(slice, fused).unwrap()).collect();
    let (mut quality, mut variances) = (0.0, 0.0);
    for i in 0..windows[0].len() {
        let of_slices = windows.iter().map(|windows| &windows[i]);
        let best = of_slices.max_by(|a, b| a.source.variance.total_cmp(&b.source.variance)).unwrap();
        quality += best.source.variance * piella::index(best.source, best.fused, best.covariance);
        variances += best.source.variance;
    }
    (kept / weights, quality / variances)
}

#[test]
fn streaming_gives_what_the_definition_gives() {
    let ideal = ramp::ideal(60, 40);
    let slices = ramp::slices(&ideal, 4);
    let fused = mean(&slices);
    let (found, (q_g, q_w)) = (scored(&fused, &slices), by_definition(&fused, &slices));
    assert!((found.q_g_top.unwrap() - q_g).abs() < 1e-5, "{found:?}, {q_g}");
    assert!((found.q_w_top.unwrap() - q_w).abs() < 1e-5, "{found:?}, {q_w}");
}

#[test]
fn an_image_that_equals_its_only_slice_preserves_everything() {
    let picture = ramp::ideal(48, 40);
    let found = scored(&picture, std::slice::from_ref(&picture));
    assert!((found.q_g_top.unwrap() - xydeas::UPPER_BOUND).abs() < 2e-4, "{found:?}");
    assert!((found.q_w_top.unwrap() - 1.0).abs() < 1e-6, "{found:?}");
    assert_eq!((found.sharpness_retention, found.overshoot_fraction), (Some(1.0), Some(0.0)));
    // these metrics depend on the image alone
    let alone = two_source::spatial_frequency(&picture).unwrap();
    assert!((found.spatial_frequency.unwrap() / alone - 1.0).abs() < 0.02, "{found:?}, {alone}");
    let variance = two_source::laplacian_variance(&picture).unwrap();
    assert!((found.laplacian_variance.unwrap() / variance - 1.0).abs() < 1e-6, "{found:?}, {variance}");
}

#[test]
fn ringing_raises_the_retention_and_the_overshoot() {
    let picture = ramp::ideal(64, 48);
    let soft = ramp::disk(&picture, 1.5);
    let ringing = Plane::from_fn(64, 48, |x, y| 2.0 * picture.at(x, y) - soft.at(x, y));
    let found = scored(&ringing, &[picture, soft]);
    assert!(found.sharpness_retention.unwrap() > 1.5, "{found:?}");
    assert!(found.overshoot_fraction.unwrap() > 0.3, "{found:?}");
}

#[test]
fn uncovered_pixels_enter_no_sum() {
    let picture = ramp::ideal(64, 48);
    let valid = Plane::from_fn(64, 48, |x, _| if x < 40 { 255u8 } else { 0 });
    for wild in [f32::NAN, f32::INFINITY, 1e30] {
        let torn = Plane::from_fn(64, 48, |x, y| if x < 40 { picture.at(x, y) } else { wild });
        let with =
            score(&picture, &mut [(picture.clone(), None), (torn.clone(), Some(valid.clone()))].into_iter(), None);
        assert_eq!(with.metrics(), scored(&picture, std::slice::from_ref(&picture)));
        let cut = |p: &Plane<f32>| Plane::from_fn(40, 48, |x, y| p.at(x, y));
        // uncovered pixels of a fused image are finite but arbitrary
        let fused = Plane::from_fn(64, 48, |x, y| if x < 40 { picture.at(x, y) } else { ((x * y) % 251) as f32 });
        let alone = score(&fused, &mut std::iter::once((torn.clone(), Some(valid.clone()))), None).metrics();
        let expected = scored(&cut(&picture), &[cut(&picture)]);
        assert_eq!(alone.tenengrad, expected.tenengrad);
        // rows have another length, so floats are added in another order
        let near = |a: Option<f64>, b: Option<f64>| (a.unwrap() - b.unwrap()).abs() < 1e-6;
        assert!(near(alone.q_g_top, expected.q_g_top) && near(alone.q_w_top, expected.q_w_top), "{alone:?}");
        assert_eq!((alone.spatial_frequency, alone.overshoot_fraction), (expected.spatial_frequency, Some(0.0)));
    }
}

#[test]
fn an_arbitrary_background_does_not_change_the_score_of_the_object() {
    let picture = ramp::ideal(64, 48);
    let object = Plane::from_fn(64, 48, |x, _| if x < 40 { 255u8 } else { 0 });
    // changed from two columns beyond the object on: outside the neighbourhood of its gradients
    let spoiled = Plane::from_fn(64, 48, |x, y| if x < 42 { picture.at(x, y) } else { ((x * y) % 251) as f32 });
    let slices = || [(picture.clone(), None)].into_iter();
    let (clean, wild) = (score(&picture, &mut slices(), Some(&object)), score(&spoiled, &mut slices(), Some(&object)));
    let (clean, wild) = (clean.metrics(), wild.metrics());
    // the mean of the block, which includes the background, changes the rounding
    assert!((clean.q_w_top.unwrap() - wild.q_w_top.unwrap()).abs() < 1e-6, "{clean:?}, {wild:?}");
    assert_eq!(FusionMetrics { q_w_top: clean.q_w_top, ..wild }, clean);
    assert!(score(&spoiled, &mut slices(), None).metrics().q_w_top.unwrap() < 0.9);
}

#[test]
fn nothing_to_measure_gives_no_numbers() {
    let none = FusionMetrics::default();
    let flat = Plane::filled(20, 20, 100.0f32);
    assert_eq!(score(&flat, &mut std::iter::empty(), None).metrics(), none);
    let object = Plane::filled(20, 20, 0u8);
    assert_eq!(score(&flat, &mut std::iter::once((flat.clone(), None)), Some(&object)).metrics(), none);
    let found = scored(&flat, std::slice::from_ref(&flat));
    assert_eq!((found.q_g_top, found.q_w_top, found.sharpness_retention), (None, None, None));
    assert_eq!((found.tenengrad, found.overshoot_fraction), (Some(0.0), Some(0.0)));
    for (width, height) in [(0, 0), (1, 1), (2, 9), (9, 2), (7, 7)] {
        let tiny = Plane::filled(width, height, 5.0f32);
        assert_eq!(scored(&tiny, std::slice::from_ref(&tiny)).q_w_top, None);
    }
}

#[test]
fn tiles_merge_to_the_sums_of_all_their_pixels() {
    let picture = ramp::ideal(64, 48);
    let soft = ramp::disk(&picture, 1.0);
    let part = |from: usize, to: usize| {
        let cut = |p: &Plane<f32>| Plane::from_fn(to - from, 48, |x, y| p.at(from + x, y));
        let slices = [cut(&picture), cut(&soft)];
        score(&cut(&soft), &mut slices.iter().map(|slice| (slice.clone(), None)), None)
    };
    let mut merged = part(0, 32);
    merged.merge(&part(32, 64));
    let whole = part(0, 64).metrics();
    let merged = merged.metrics();
    assert_eq!(merged.overshoot_fraction, whole.overshoot_fraction);
    for (a, b) in
        [(merged.q_g_top, whole.q_g_top), (merged.q_w_top, whole.q_w_top), (merged.tenengrad, whole.tenengrad)]
    {
        assert!((a.unwrap() / b.unwrap() - 1.0).abs() < 0.05, "{merged:?}, {whole:?}");
    }
}
