//! Blend weights between the corrected mosaic and the pyramid image.
//!
//! The mosaic has no halos and the least noise, but seams where the decision map changes, and it is wrong where no
//! slice is sharp. The pyramid image has no seams, but halos. Let `I0` and `I1` be the mosaic before and after the
//! correction of defocus spread, `P` the pyramid image, all in grey levels of 255; `mean_n` the mean over `n x n` px;
//! `E` the focus energy at fine scale; and `ramp(x, a, b)` 1 up to `a`, 0 from `b` on, and linear between. The output
//! is `w I1 + (1 - w) P`:
//!
//! ```text
//! v   = mean_9 mean_9 |I1 - I0|                                        size of the correction
//! e   = mean_19 (distance of P from the interval [I0, I1], both smoothed by mean_9 mean_9) - 0.2 v
//! d   = mean_19 |mean_9 mean_9 (I1 - P)|, largest channel              disagreement at low frequencies
//! w_c = min(v / 3, 1) ramp(e, 2, 4)                                    corrected, and consistent with P
//! w_a = (0.45 + 0.45 E(I1) / (E(I1) + 20)) ramp(d, 1.5, 3)             equal at low frequencies
//! w   = max(w_c, w_a) (1 - l(q / 1.3)) (1 - l(1 / (q g)))              l(x) = ln x, clamped to 0..1
//!       q = (E(P) + 0.5) / (E(I1) + 0.5),  g = 1.2 + 1.5 (E(P) + 0.5) / (E(P) + 5.5)
//! ```
//!
//! - `w_c`: a pyramid image contains all of a near part's blur, a part of it or none, so `P` lies between `I0` and
//!   `I1`. Where it does not, the decision map is wrong, and what was removed is no blur.
//! - `w_a`: where both agree, no seam can show. Their noise differs, so a mean has less of it: half of each without
//!   detail, but mostly the mosaic among detail, where one slice is better than many.
//! - The last two factors: `P` is used where it alone kept a fine line (`q` large), and where the mosaic is ragged (`q`
//!   small).

mod box_sum;

use crate::imaging::{
    Plane, Rect, Sample,
    filter::focus::{FocusEnergy, Rows},
    grey,
    simd::{self, Avx2},
};
use box_sum::{BoxSum, Int};

/// Side of the two means, one after the other, of the correction, px.
const CORRECTION_SIDE: usize = 9;

/// Mean correction, grey levels of 255, from which the mosaic is used completely.
const CORRECTION: f32 = 3.0;

/// Distance of the pyramid image from the interval between both mosaics, grey levels of 255, up to which it is
/// consistent with the correction, and from which it is used itself. Both are larger by this share of the correction.
const CONSISTENT: f32 = 2.0;
const INCONSISTENT: f32 = 4.0;
const OF_CORRECTION: f32 = 0.2;

/// Side of the two means, one after the other, of the difference between the images, px: their noise is left out ...
const COARSE_SIDE: usize = 9;
/// ... and of the mean of its absolute value: a seam differs on both sides.
const AROUND_SIDE: usize = 19;

/// Difference at low frequencies, grey levels of 255, up to which the images agree, and from which they do not at all.
const EQUAL: f32 = 1.5;
const DIFFERENT: f32 = 3.0;

/// Weight of the mosaic where both agree: without detail, and with much; and the energy, squared grey levels, at which
/// it is half-way.
const WEIGHT_TEXTURELESS: f32 = 0.45;
const WEIGHT_TEXTURED: f32 = 0.9;
const HALF_TEXTURED: f32 = 20.0;

/// How far around a pixel differences are looked at, px; energies look less far.
pub(super) const REACH: usize = 2 * (COARSE_SIDE / 2) + AROUND_SIDE / 2;

/// Fine energy of the pyramid image, in multiples of the mosaic's, from which it has kept more detail (completely, from
/// e times as much); and the energy, squared grey levels, that is added to both.
const FINER: f32 = 1.3;
const NOISE_ENERGY: f32 = 0.5;

/// Fine energy of the mosaic, in multiples of the pyramid image's, from which it counts as ragged borders of the
/// decision map and not as detail: where the pyramid image has no detail, and where it has much. Among much detail the
/// mosaic keeps more of it than pyramids do, and ragged borders are not visible.
const RAGGED: f32 = 1.2;
const RAGGED_IN_DETAIL: f32 = 2.7;
/// Energy of the pyramid image, squared grey levels, at which that limit is half-way.
const HALF_DETAIL: f32 = 5.0;

/// The mosaic and the pyramid image of the rectangle `window`: interleaved samples of `C` channels.
pub(super) struct ImagePair<'a, S> {
    pub window: Rect,
    /// The corrected mosaic.
    pub corrected: &'a [S],
    /// The same before rounding, so that the output is rounded once.
    pub values: &'a [f32],
    /// The mosaic before the correction.
    pub uncorrected: &'a [S],
    pub pyramid: &'a [S],
    /// Per pixel: the absolute change by the correction, in the scale of the samples.
    pub change: &'a [f32],
}

impl<S: Sample> ImagePair<'_, S> {
    /// The blended samples of `rect`, which is at least [`REACH`] inside the window where that does not end at the
    /// border of the canvas.
    pub(super) fn blend<const C: usize>(&self, rect: Rect, rows: &mut Rows, out: &mut Vec<S>) {
        let weights = self.weights::<C>(rows);
        let (left, top) = (rect.x - self.window.x, rect.y - self.window.y);
        out.resize(rect.width * rect.height * C, S::default());
        for (y, out) in (top..).zip(out.chunks_exact_mut(rect.width * C)) {
            let at = (y * self.window.width + left) * C..(y * self.window.width + left + rect.width) * C;
            let (values, pyramid) = (&self.values[at.clone()], &self.pyramid[at]);
            let weights = &weights.row(y)[left..left + rect.width];
            simd::run(
                Avx2::detect(),
                #[inline(always)]
                || blend_row::<S, C>(values, pyramid, weights, out),
            );
        }
    }

    /// Weight of the mosaic at each pixel of the window, 0 to 1.
    fn weights<const C: usize>(&self, rows: &mut Rows) -> Plane<f32> {
        match S::BYTES {
            // no sum is larger than 3 * 255 * 9^4 * 19^2
            1 => self.weights_by::<i32, C>(rows),
            _ => self.weights_by::<i64, C>(rows),
        }
    }

    /// The same with sums of type `N`.
    fn weights_by<N: Int, const C: usize>(&self, rows: &mut Rows) -> Plane<f32> {
        let (width, height) = (self.window.width, self.window.height);
        let level = S::DEPTH.max() / 255.0;
        let mut box_sum = BoxSum::new(width, height);
        // 16ths of a grey level, as integers
        let mut change = vec![N::default(); self.change.len()];
        simd::run(
            Avx2::detect(),
            #[inline(always)]
            || {
                for (sixteenths, &change) in change.iter_mut().zip(self.change) {
                    *sixteenths = N::from(simd::truncated(16.0 * change.min(64.0 * level) / level, u16::MAX));
                }
            },
        );
        box_sum.apply(&mut change, CORRECTION_SIDE, 2);
        let change_scale = 1.0 / (16 * CORRECTION_SIDE.pow(4)) as f32;
        let any_change = change.iter().any(|&change| change > N::default());
        let [different, outside] = self.differences::<N, C>(any_change, &mut box_sum);
        let scale = 1.0 / ((COARSE_SIDE.pow(4) * AROUND_SIDE.pow(2)) as f32 * level);
        let [mosaic, pyramid] = [self.corrected, self.pyramid].map(|samples| {
            let mut luma = Plane::filled(width, height, 0.0f32);
            grey::luma_row(samples, C, &mut luma.data);
            FocusEnergy::for_edges().plane(&luma, rows)
        });
        let scales = Scales { change: change_scale, difference: scale, channels: C as f32 };
        let mut weights = Plane::filled(width, height, 0.0f32);
        let parts = change.chunks(PART).zip(different.chunks(PART)).zip(outside.chunks(PART));
        let energies = mosaic.data.chunks(PART).zip(pyramid.data.chunks(PART));
        let simd = Avx2::detect();
        for ((weights, sums), energies) in weights.data.chunks_mut(PART).zip(parts).zip(energies) {
            let ((change, different), outside) = sums;
            let (mut finer, mut ragged) = ([0.0f32; PART], [0.0f32; PART]);
            simd::run(
                simd,
                #[inline(always)]
                || {
                    consistency([change, different, outside], energies.0, &scales, weights);
                    detail_ratios(energies, &mut finer, &mut ragged);
                },
            );
            for (weight, (finer, ragged)) in weights.iter_mut().zip(finer.into_iter().zip(ragged)) {
                // a ratio of up to 1 changes nothing: its logarithm need not be computed
                if finer > 1.0 && *weight > 0.0 {
                    *weight *= 1.0 - finer.ln().min(1.0);
                }
                if ragged > 1.0 && *weight > 0.0 {
                    *weight *= 1.0 - ragged.ln().min(1.0);
                }
            }
        }
        weights
    }

    /// Box sums of two differences at low frequencies: of the pyramid image from the corrected mosaic (the largest over
    /// channels), and, if there is any correction, of the pyramid image from the interval between both mosaics (the sum
    /// over channels).
    fn differences<N: Int, const C: usize>(&self, any_change: bool, box_sum: &mut BoxSum<N>) -> [Vec<N>; 2] {
        let zeros = || vec![N::default(); self.window.width * self.window.height];
        let (mut different, mut coarse, mut after, simd) = (zeros(), zeros(), zeros(), Avx2::detect());
        let pyramid = self.pyramid.as_chunks::<C>().0;
        for channel in 0..C {
            let pixels = self.corrected.as_chunks::<C>().0.iter().zip(pyramid);
            simd::run(
                simd,
                #[inline(always)]
                || {
                    for (coarse, (one, other)) in coarse.iter_mut().zip(pixels) {
                        *coarse = N::from(one[channel].integer() as i32 - other[channel].integer() as i32);
                    }
                },
            );
            box_sum.apply(&mut coarse, COARSE_SIDE, 2);
            simd::run(
                simd,
                #[inline(always)]
                || {
                    for ((largest, sum), coarse) in different.iter_mut().zip(&mut after).zip(&coarse) {
                        *largest = (*largest).max(coarse.abs());
                        *sum += *coarse;
                    }
                },
            );
        }
        box_sum.apply(&mut different, AROUND_SIDE, 1);
        let mut outside = zeros();
        if any_change {
            let (mut before, pixels) = (coarse, self.uncorrected.as_chunks::<C>().0.iter().zip(pyramid));
            simd::run(
                simd,
                #[inline(always)]
                || {
                    let all = |pixel: &[S; C]| pixel.iter().map(|sample| sample.integer() as i32).sum::<i32>();
                    for (before, (one, other)) in before.iter_mut().zip(pixels) {
                        *before = N::from(all(one) - all(other));
                    }
                },
            );
            box_sum.apply(&mut before, COARSE_SIDE, 2);
            let both = after.iter().zip(&before);
            outside.iter_mut().zip(both).for_each(|(outside, (&after, &before))| *outside = distance(after, before));
            box_sum.apply(&mut outside, AROUND_SIDE, 1);
        }
        [different, outside]
    }
}

/// Pixels whose weights are computed at a time.
const PART: usize = 64;

/// What turns box sums into means in grey levels of 255.
struct Scales {
    /// Factor of the sums of the change.
    change: f32,
    /// Factor of the sums of differences and of distances.
    difference: f32,
    /// Number of channels, over which distances are summed.
    channels: f32,
}

/// Writes `max(w_c, w_a)` of the module comment per pixel, 0 to 1, before fine energies reduce it. `sums` are box sums:
/// of the change by the correction, of the difference from the pyramid image, and of the distance of the pyramid image
/// from the interval between both mosaics. `energies` are the fine energies of the mosaic, squared grey levels.
#[inline(always)]
fn consistency<N: Int>(sums: [&[N]; 3], energies: &[f32], scales: &Scales, weights: &mut [f32]) {
    let [change, different, outside] = sums;
    let pixels = change.iter().zip(different).zip(outside).zip(energies);
    for (weight, (((change, different), outside), energy)) in weights.iter_mut().zip(pixels) {
        let change = change.value() * scales.change;
        let outside = (outside.value() * scales.difference / scales.channels - OF_CORRECTION * change).max(0.0);
        let different = different.value() * scales.difference;
        let corrected = (change / CORRECTION).min(1.0) * ramp(outside, CONSISTENT, INCONSISTENT);
        let mean = WEIGHT_TEXTURELESS + (WEIGHT_TEXTURED - WEIGHT_TEXTURELESS) * energy / (energy + HALF_TEXTURED);
        *weight = corrected.max(ramp(different, EQUAL, DIFFERENT) * mean);
    }
}

/// 1 up to `from`, 0 from `to` on, and linear between.
#[inline(always)]
fn ramp(value: f32, from: f32, to: f32) -> f32 {
    ((to - value) / (to - from)).clamp(0.0, 1.0)
}

/// How much more fine energy one image has than the other, in multiples of what is accepted: `finer` the pyramid image,
/// `ragged` the mosaic. `energies` are the fine energies of the mosaic and of the pyramid image.
#[inline(always)]
fn detail_ratios((mosaic, pyramid): (&[f32], &[f32]), finer: &mut [f32; PART], ragged: &mut [f32; PART]) {
    let pixels = mosaic.iter().zip(pyramid);
    for ((finer, ragged), (mosaic, pyramid)) in finer.iter_mut().zip(ragged).zip(pixels) {
        let (mosaic, pyramid) = (mosaic + NOISE_ENERGY, pyramid + NOISE_ENERGY);
        let limit = RAGGED + (RAGGED_IN_DETAIL - RAGGED) * pyramid / (pyramid + HALF_DETAIL);
        (*finer, *ragged) = (pyramid / mosaic / FINER, mosaic / pyramid / limit);
    }
}

/// Distance of 0 from the interval between two numbers.
fn distance<N: Int>(one: N, other: N) -> N {
    let zero = N::default();
    match (one > zero) == (other > zero) {
        true => one.abs().min(other.abs()),
        false => zero,
    }
}

/// One row of the output: `weights` are those of `values`.
#[inline(always)]
fn blend_row<S: Sample, const C: usize>(values: &[f32], pyramid: &[S], weights: &[f32], out: &mut [S]) {
    let pixels = values.as_chunks::<C>().0.iter().zip(pyramid.as_chunks::<C>().0);
    for ((out, (values, pyramid)), weight) in out.as_chunks_mut::<C>().0.iter_mut().zip(pixels).zip(weights) {
        for c in 0..C {
            let from = pyramid[c].value();
            out[c] = S::rounded((from + weight * (values[c] - from)).max(0.0));
        }
    }
}

#[cfg(test)]
mod tests;
