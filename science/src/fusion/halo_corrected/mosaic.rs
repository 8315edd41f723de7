//! The mosaic of a tile: each pixel from the slices that the decision map gives to the pixels around it.
//!
//! Taking each pixel from one slice alone would show borders and keep all noise. Slices that are not separable in focus
//! show the same at a pixel, so they are averaged. With `l` the slice of pixel `p` in the decision map, `n_k` the
//! number of pixels of slice `k` in the 7 x 7 px around `p`, and `u = 100` where `p` has no texture, else 0, the mosaic
//! is
//!
//! `I(p) = sum over k of w_k I_k(p) / sum over k of w_k`, `w_k = n_k + u` where `k` and `l` are not separable, else 0.

use super::{decision_map::DecisionMap, defocus_model::DefocusModel, warped_slices::WarpedSlices};
use crate::{
    imaging::{
        Rect, Sample,
        simd::{self, Avx2},
    },
    types::Interrupted,
};

/// Slices are averaged over a window of `2 * REACH + 1` px.
const REACH: usize = 3;

/// Side of the parts that are averaged in one go, px: few slices are needed in each.
const PART_SIDE: usize = 128;

/// Weight, in pixels of the window, that every slice not separable from a pixel's own gets at textureless pixels: there
/// such slices differ by noise alone.
const TEXTURELESS_WEIGHT: u8 = 100;

/// The mosaic of `rect`: interleaved pixels, in the scale of the samples.
pub(super) fn mosaic<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &DecisionMap,
    model: &DefocusModel,
    rect: Rect,
) -> Result<Vec<f32>, Interrupted> {
    let mut values = vec![0.0; rect.width * rect.height * C];
    let ends = |start: usize, length: usize| {
        // parts end where blocks of the scratch file do
        let first = (start / PART_SIDE + 1) * PART_SIDE;
        let starts = std::iter::once(start).chain((first..start + length).step_by(PART_SIDE));
        starts.map(move |from| (from, ((from / PART_SIDE + 1) * PART_SIDE).min(start + length)))
    };
    for (top, bottom) in ends(rect.y, rect.height) {
        for (left, right) in ends(rect.x, rect.width) {
            let part = Rect { x: left, y: top, width: right - left, height: bottom - top };
            let averaged = average(slices, map, model, part)?;
            for (y, row) in (top - rect.y..).zip(averaged.chunks_exact(part.width * C)) {
                values[(y * rect.width + left - rect.x) * C..][..row.len()].copy_from_slice(row);
            }
        }
    }
    Ok(values)
}

/// The mosaic of one part.
fn average<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &DecisionMap,
    model: &DefocusModel,
    rect: Rect,
) -> Result<Vec<f32>, Interrupted> {
    let (width, height) = slices.size();
    let window = rect.grown(REACH, width, height);
    let needed = needed(map, model, slices.count(), rect, window);
    let pixels = rect.width * rect.height;
    let mut only = (0..needed.len()).filter(|&slice| needed[slice]);
    if let (Some(alone), None) = (only.next(), only.next())
        && slices.covers(alone, rect)
    {
        return slices.read(alone, rect, |samples| samples.iter().map(|sample| sample.value()).collect());
    }
    let (mut values, mut sums) = (vec![0.0f32; pixels * C], vec![0.0f32; pixels]);
    let (mut weights, simd) = (Vec::with_capacity(rect.width), Avx2::detect());
    for slice in (0..needed.len()).filter(|&slice| needed[slice]) {
        let counts = counts(map, slice as u16, rect, window);
        let alike = runs(needed.len(), |other| !model.separable(slice, other));
        let samples = slices.samples(slice, rect)?;
        for y in 0..rect.height {
            let covered = slices.coverage(slice).span(rect.y + y);
            let columns = covered.start.max(rect.x)..covered.end.min(rect.x + rect.width);
            if columns.is_empty() {
                continue;
            }
            let line = y * rect.width + columns.start - rect.x..y * rect.width + columns.end - rect.x;
            let own = &map.slice.row(rect.y + y)[columns.clone()];
            let textured = &map.textured.row(rect.y + y)[columns];
            let counts = &counts[line.clone()];
            weights.clear();
            weights.resize(own.len(), 0.0);
            let equal = if model.is_known() { TEXTURELESS_WEIGHT } else { 0 };
            for &(first, last) in &alike {
                simd::run(
                    simd,
                    #[inline(always)]
                    || {
                        let pixels = own.iter().zip(textured).zip(counts);
                        for (weight, ((&own, &textured), &count)) in weights.iter_mut().zip(pixels) {
                            let count = count + if textured { 0 } else { equal };
                            // uncovered pixels are like no slice
                            *weight += if first <= own && own <= last { f32::from(count) } else { 0.0 };
                        }
                    },
                );
            }
            let samples = &samples[line.start * C..line.end * C];
            let (values, sums) = (&mut values[line.start * C..line.end * C], &mut sums[line]);
            simd::run(
                simd,
                #[inline(always)]
                || add::<S, C>(&weights, samples, values, sums),
            );
        }
    }
    divide::<C>(&mut values, &sums);
    Ok(values)
}

/// Divides each pixel by the sum of its weights; pixels without any weight stay 0. A sample of a single slice comes out
/// as it is in that slice: its product with a weight is a whole number below 2^24, and a quotient is rounded once.
fn divide<const C: usize>(values: &mut [f32], sums: &[f32]) {
    for (pixel, &sum) in values.chunks_exact_mut(C).zip(sums) {
        let sum = if sum > 0.0 { sum } else { 1.0 };
        pixel.iter_mut().for_each(|value| *value /= sum);
    }
}

/// The slices below `slices` for which `is_sought` holds, as runs of consecutive slices: the first and the last of
/// each. The slices that are not separable from one slice are a single run, unless the rail moved back and forth.
fn runs(slices: usize, is_sought: impl Fn(usize) -> bool) -> Vec<(u16, u16)> {
    let mut runs: Vec<(u16, u16)> = Vec::new();
    for slice in (0..slices).filter(|&slice| is_sought(slice)).map(|slice| slice as u16) {
        match runs.last_mut() {
            Some((_, last)) if *last + 1 == slice => *last = slice,
            _ => runs.push((slice, slice)),
        }
    }
    runs
}

/// Per slice, out of `slices`: whether it can have a weight in `rect`, which lies in `window`.
fn needed(map: &DecisionMap, model: &DefocusModel, slices: usize, rect: Rect, window: Rect) -> Vec<bool> {
    let mut needed = vec![false; slices];
    for y in window.y..window.y + window.height {
        for &slice in &map.slice.row(y)[window.x..window.x + window.width] {
            if let Some(needed) = needed.get_mut(usize::from(slice)) {
                *needed = true;
            }
        }
    }
    let mut textureless = vec![false; slices];
    for y in rect.y..rect.y + rect.height {
        let columns = rect.x..rect.x + rect.width;
        for (&slice, &textured) in map.slice.row(y)[columns.clone()].iter().zip(&map.textured.row(y)[columns]) {
            if let (false, Some(textureless)) = (textured, textureless.get_mut(usize::from(slice))) {
                *textureless = model.is_known();
            }
        }
    }
    for own in (0..textureless.len()).filter(|&slice| textureless[slice]) {
        for (slice, needed) in needed.iter_mut().enumerate() {
            *needed |= !model.separable(slice, own);
        }
    }
    needed
}

/// Adds weighted samples to the values, and weights to the sums. Runs of pixels without any weight are skipped.
#[inline(always)]
fn add<S: Sample, const C: usize>(weights: &[f32], samples: &[S], values: &mut [f32], sums: &mut [f32]) {
    const RUN: usize = 32;
    let runs = weights.chunks(RUN).zip(sums.chunks_mut(RUN));
    let pixels = samples.chunks(RUN * C).zip(values.chunks_mut(RUN * C));
    for ((weights, sums), (samples, values)) in runs.zip(pixels) {
        if weights.iter().fold(0, |bits, weight| bits | weight.to_bits()) == 0 {
            continue;
        }
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight);
        let pixels = values.chunks_exact_mut(C).zip(samples.chunks_exact(C));
        for (&weight, (value, sample)) in weights.iter().zip(pixels) {
            for c in 0..C {
                value[c] += weight * sample[c].value();
            }
        }
    }
}

/// How many pixels of the window around each pixel of `rect` are of `slice` in the decision map.
fn counts(map: &DecisionMap, slice: u16, rect: Rect, window: Rect) -> Vec<u8> {
    let simd = Avx2::detect();
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let mut across = vec![0u8; rect.width * window.height];
    // `REACH` columns on either side of the rectangle; 0 beyond the canvas
    let mut line = vec![0u8; rect.width + 2 * REACH];
    for (y, out) in across.chunks_exact_mut(rect.width).enumerate() {
        let slices = &map.slice.row(window.y + y)[window.x..window.x + window.width];
        let line = &mut line[..];
        simd::run(
            simd,
            #[inline(always)]
            || {
                let inside = &mut line[REACH - left..];
                inside.iter_mut().zip(slices).for_each(|(is, &of)| *is = u8::from(of == slice));
                for by in 0..2 * REACH + 1 {
                    out.iter_mut().zip(&line[by..]).for_each(|(sum, is)| *sum += is);
                }
            },
        );
    }
    let mut counts = vec![0u8; rect.width * rect.height];
    for (y, out) in counts.chunks_exact_mut(rect.width).enumerate() {
        let middle = y + top;
        for row in middle.saturating_sub(REACH)..(middle + REACH + 1).min(window.height) {
            let row = &across[row * rect.width..(row + 1) * rect.width];
            out.iter_mut().zip(row).for_each(|(count, more)| *count += more);
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_of_a_single_slice_is_exact_whatever_its_weight() {
        let most = (2 * REACH + 1).pow(2) as u8 + TEXTURELESS_WEIGHT;
        let weights: Vec<f32> = (1..=most).map(f32::from).collect();
        for sample in (0..=u16::MAX).step_by(253).map(f32::from) {
            let mut values: Vec<f32> = weights.iter().map(|weight| weight * sample).collect();
            divide::<1>(&mut values, &weights);
            assert!(values.iter().all(|&value| value == sample), "{sample}: {values:?}");
        }
        let mut uncovered = [0.0; 3];
        divide::<3>(&mut uncovered, &[0.0]);
        assert_eq!(uncovered, [0.0; 3]);
    }

    #[test]
    fn runs_end_where_a_slice_is_not_among_those_sought() {
        let of = |sought: &[usize]| runs(7, |slice| sought.contains(&slice));
        assert_eq!(of(&[]), []);
        assert_eq!(of(&[0, 1, 2, 3, 4, 5, 6]), [(0, 6)]);
        assert_eq!(of(&[0, 2, 3, 6]), [(0, 0), (2, 3), (6, 6)]);
    }
}
