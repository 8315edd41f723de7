//! Weighted sums of the base and detail layers of a tile over the slices, row by row.

use crate::imaging::{
    Sample,
    simd::{self, Avx2},
};

/// Added to the weights of the sharpest slice, so that no sum of weights is 0 (as in `GFF.m` of Li, Kang & Hu).
const MIN_WEIGHT: f32 = 1e-12;

/// Pixels that are processed at a time.
const PART: usize = 64;
/// Samples of [`PART`] pixels of three channels.
const PART_SAMPLES: usize = 3 * PART;

/// A row of one slice after its filters.
#[derive(Debug, Default)]
pub(super) struct LayerRow {
    /// Weights of the base layer and of the detail layer.
    pub weights: [Vec<f32>; 2],
    /// The base layer, interleaved.
    pub means: Vec<f32>,
}

/// The two layers of a tile.
#[derive(Debug, Default)]
pub(super) struct Layers {
    width: usize,
    base: Layer,
    detail: Layer,
}

/// One layer, summed over the slices: weight times value (interleaved), and weight.
#[derive(Debug, Default)]
struct Layer {
    sums: Vec<f32>,
    weights: Vec<f32>,
}

impl Layers {
    /// Begins a tile of `width` x `height` px.
    pub(super) fn clear(&mut self, width: usize, height: usize, channels: usize) {
        self.width = width;
        for layer in [&mut self.base, &mut self.detail] {
            for (values, length) in [(&mut layer.sums, width * height * channels), (&mut layer.weights, width * height)]
            {
                values.clear();
                values.resize(length, 0.0);
            }
        }
    }

    /// Adds row `y` of a slice; `sharpest` is where it is the sharpest slice. The weights in `row` are clamped in
    /// place.
    pub(super) fn add<S: Sample, const C: usize>(
        &mut self,
        simd: Option<Avx2>,
        y: usize,
        samples: &[S],
        sharpest: &[bool],
        row: &mut LayerRow,
    ) {
        let pixels = y * self.width..(y + 1) * self.width;
        let range = pixels.start * C..pixels.end * C;
        let [for_base, for_detail] = &mut row.weights;
        let base = (&mut self.base.sums[range.clone()], &mut self.base.weights[pixels.clone()]);
        let detail = (&mut self.detail.sums[range], &mut self.detail.weights[pixels]);
        simd::run(
            simd,
            #[inline(always)]
            || {
                let base = base.0.chunks_mut(PART * C).zip(base.1.chunks_mut(PART));
                let detail = detail.0.chunks_mut(PART * C).zip(detail.1.chunks_mut(PART));
                let weights = for_base.chunks_mut(PART).zip(for_detail.chunks_mut(PART)).zip(sharpest.chunks(PART));
                let pixels = samples.chunks(PART * C).zip(row.means.chunks(PART * C));
                // one buffer for all parts: to zero a new one would cost as much as the sums
                let mut repeated = [0.0; PART_SAMPLES];
                for (((base, detail), ((for_base, for_detail), sharpest)), (samples, means)) in
                    base.zip(detail).zip(weights).zip(pixels)
                {
                    if clamp(for_base, sharpest) {
                        add_base::<C>(base.0, base.1, for_base, means, &mut repeated);
                    }
                    if clamp(for_detail, sharpest) {
                        add_detail::<S, C>(detail.0, detail.1, for_detail, samples, means, &mut repeated);
                    }
                }
            },
        );
    }

    /// Writes row `y` as samples: base plus detail, clamped and rounded; 0 where no slice has any weight. Returns the
    /// number of pixels with a sample more than one grey level of 255 out of range.
    pub(super) fn finish<S: Sample, const C: usize>(&self, simd: Option<Avx2>, y: usize, out: &mut [S]) -> usize {
        let pixels = y * self.width..(y + 1) * self.width;
        let range = pixels.start * C..pixels.end * C;
        let base = (&self.base.sums[range.clone()], &self.base.weights[pixels.clone()]);
        let detail = (&self.detail.sums[range], &self.detail.weights[pixels]);
        simd::run(
            simd,
            #[inline(always)]
            || {
                let base = base.0.chunks(PART * C).zip(base.1.chunks(PART));
                let detail = detail.0.chunks(PART * C).zip(detail.1.chunks(PART));
                let parts = out.chunks_mut(PART * C).zip(base.zip(detail));
                let mut repeated = [[0.0; PART_SAMPLES]; 2];
                let mut outside = 0;
                for (out, (base, detail)) in parts {
                    outside += finish_part::<S, C>(base, detail, out, &mut repeated);
                }
                outside
            },
        )
    }
}

/// Clamps weights to 0..=1 and adds [`MIN_WEIGHT`] where the slice is the sharpest. Returns whether any weight is above
/// 0.
#[inline(always)]
fn clamp(weights: &mut [f32], sharpest: &[bool]) -> bool {
    // a weight is not negative, so it is above 0 if any bit is set; a maximum would be a chain of comparisons
    let mut bits = 0;
    for (weight, &sharpest) in weights.iter_mut().zip(sharpest) {
        let least = if sharpest { MIN_WEIGHT } else { 0.0 };
        *weight = weight.clamp(0.0, 1.0) + least;
        bits |= weight.to_bits();
    }
    bits != 0
}

/// Writes each of `values` `C` times to `out`; the rest of `out` is unchanged.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn repeat<const C: usize>(values: &[f32], out: &mut [f32; PART_SAMPLES]) {
    if let (Some(values), 3) = (values.first_chunk::<PART>(), C) {
        for i in 0..PART {
            (out[3 * i], out[3 * i + 1], out[3 * i + 2]) = (values[i], values[i], values[i]);
        }
        return;
    }
    for (out, value) in out.chunks_exact_mut(C).zip(values) {
        out.fill(*value);
    }
}

#[inline(always)]
fn add_base<const C: usize>(
    sums: &mut [f32],
    totals: &mut [f32],
    weights: &[f32],
    means: &[f32],
    repeated: &mut [f32; PART_SAMPLES],
) {
    for (total, weight) in totals.iter_mut().zip(weights) {
        *total += weight;
    }
    repeat::<C>(weights, repeated);
    for ((sum, weight), mean) in sums.iter_mut().zip(repeated).zip(means) {
        *sum += *weight * mean;
    }
}

#[inline(always)]
fn add_detail<S: Sample, const C: usize>(
    sums: &mut [f32],
    totals: &mut [f32],
    weights: &[f32],
    samples: &[S],
    means: &[f32],
    repeated: &mut [f32; PART_SAMPLES],
) {
    for (total, weight) in totals.iter_mut().zip(weights) {
        *total += weight;
    }
    repeat::<C>(weights, repeated);
    for (((sum, weight), sample), mean) in sums.iter_mut().zip(repeated).zip(samples).zip(means) {
        *sum += *weight * (sample.value() - mean);
    }
}

#[inline(always)]
fn finish_part<S: Sample, const C: usize>(
    base: (&[f32], &[f32]),
    detail: (&[f32], &[f32]),
    out: &mut [S],
    [base_totals, detail_totals]: &mut [[f32; PART_SAMPLES]; 2],
) -> usize {
    // a sample up to one grey level of 8 bits out of range is not visible as a halo
    let level = S::DEPTH.max() / 255.0;
    let (low, high) = (-level, S::DEPTH.max() + level);
    repeat::<C>(base.1, base_totals);
    repeat::<C>(detail.1, detail_totals);
    let mut values = [0.0f32; PART_SAMPLES];
    let layers = base.0.iter().zip(base_totals).zip(detail.0.iter().zip(detail_totals));
    let mut outside = false;
    for (value, ((base, base_total), (detail, detail_total))) in values.iter_mut().zip(layers) {
        // NaN where both are 0: it compares as neither below nor above, and is rounded to 0
        *value = base / *base_total + detail / *detail_total;
        outside |= (*value < low) | (*value > high);
    }
    for (out, value) in out.iter_mut().zip(values) {
        *out = S::rounded(value);
    }
    if !outside {
        return 0;
    }
    let pixels = values.chunks_exact(C).take(base.1.len());
    pixels.filter(|pixel| pixel.iter().any(|&v| v < low || v > high)).count()
}
