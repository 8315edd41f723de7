//! One tile: slices mixed over the borders of their labels, the veil taken off, and pyramids where labels are no good.

use super::{labels::Labels, optics::Optics, pictures::Pictures, trust, veil::Veil};
use crate::{
    fusion::{
        Run,
        blend::{Blended, in_tiles},
    },
    imaging::{
        Rect, Sample,
        filter::focus::{FocusEnergy, Rows},
        simd::{self, Avx2},
    },
    types::Interrupted,
};

/// Labels of neighbouring slices are mixed over a square of `2 * MIX + 1` px: no border shows, and noise is averaged.
const MIX: usize = 3;

/// Side of the parts that are mixed in one go, px.
const PART_SIDE: usize = 128;

/// What each slice weighs that is not apart from a pixel's own, in labels of that square, where there is no detail: there
/// such slices differ by noise alone.
const WITHOUT_DETAIL: u8 = 100;

/// Runs the pass that takes the veil off; `pyramids` are the samples of the picture put together from pyramids.
pub(super) fn blend<S: Sample, const C: usize>(
    run: &Run<'_>,
    pictures: &Pictures<'_, S, C>,
    labels: &Labels,
    optics: &Optics,
    pyramids: &[S],
) -> Result<Blended<S>, Interrupted> {
    let veil = Veil { pictures, labels, optics };
    in_tiles::<S, C, _>(run, "unveiling", Rows::default, |rows, rect, out| tile(&veil, pyramids, rect, out, rows))
}

/// Fuses `rect` into `out`; the number of pixels with a sample that had to be clamped by more than a grey level.
fn tile<S: Sample, const C: usize>(
    veil: &Veil<'_, S, C>,
    pyramids: &[S],
    rect: Rect,
    out: &mut Vec<S>,
    rows: &mut Rows,
) -> Result<usize, Interrupted> {
    let (width, height) = veil.pictures.size();
    let window = rect.grown(trust::REACH.max(FocusEnergy::fine().reach()), width, height);
    let mut values = in_parts(veil, window)?;
    let before = values.clone();
    veil.take_off(window, &mut values)?;
    let (taken, labelled, veiled) = (taken::<C>(&before, &values), rounded::<S>(&values), rounded::<S>(&before));
    let mut near = Vec::with_capacity(labelled.len());
    for y in window.y..window.y + window.height {
        near.extend_from_slice(&pyramids[(y * width + window.x) * C..][..window.width * C]);
    }
    let pair =
        trust::Pair { window, labelled: &labelled, values: &values, veiled: &veiled, pyramids: &near, veil: &taken };
    pair.mixed::<C>(rect, rows, out);

    let level = S::DEPTH.max() / 255.0;
    let (low, high) = (-level, S::DEPTH.max() + level);
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let outside = (top..top + rect.height).map(|y| {
        let row = values[(y * window.width + left) * C..][..rect.width * C].as_chunks::<C>().0;
        let outside = |pixel: &[f32; C]| pixel.iter().fold(false, |is, &value| is | (value < low) | (value > high));
        row.iter().map(|pixel| usize::from(outside(pixel))).sum::<usize>()
    });
    Ok(outside.sum())
}

/// Values as samples.
fn rounded<S: Sample>(values: &[f32]) -> Vec<S> {
    let mut samples = vec![S::default(); values.len()];
    simd::run(
        Avx2::detect(),
        #[inline(always)]
        || samples.iter_mut().zip(values).for_each(|(sample, &value)| *sample = S::rounded(value.max(0.0))),
    );
    samples
}

/// By how much pixels have changed, on the mean of their channels.
fn taken<const C: usize>(before: &[f32], after: &[f32]) -> Vec<f32> {
    let mut taken = vec![0.0; after.len() / C];
    simd::run(
        Avx2::detect(),
        #[inline(always)]
        || {
            let pixels = before.as_chunks::<C>().0.iter().zip(after.as_chunks::<C>().0);
            for (taken, (before, after)) in taken.iter_mut().zip(pixels) {
                *taken = (0..C).map(|c| (after[c] - before[c]).abs()).sum::<f32>() / C as f32;
            }
        },
    );
    taken
}

/// The pixels of `rect`, [`mixed`] part by part: in each part few slices are needed.
fn in_parts<S: Sample, const C: usize>(veil: &Veil<'_, S, C>, rect: Rect) -> Result<Vec<f32>, Interrupted> {
    let mut values = vec![0.0; rect.width * rect.height * C];
    let ends = |start: usize, length: usize| {
        // parts end where squares of the scratch file do
        let first = (start / PART_SIDE + 1) * PART_SIDE;
        let starts = std::iter::once(start).chain((first..start + length).step_by(PART_SIDE));
        starts.map(move |from| (from, ((from / PART_SIDE + 1) * PART_SIDE).min(start + length)))
    };
    for (top, bottom) in ends(rect.y, rect.height) {
        for (left, right) in ends(rect.x, rect.width) {
            let part = Rect { x: left, y: top, width: right - left, height: bottom - top };
            let mixed = mixed(veil, part)?;
            for (y, row) in (top - rect.y..).zip(mixed.chunks_exact(part.width * C)) {
                values[(y * rect.width + left - rect.x) * C..][..row.len()].copy_from_slice(row);
            }
        }
    }
    Ok(values)
}

/// Each pixel from the slices of the labels around it that are not apart from its own, weighted by their number; where
/// there is no detail, from all slices that are not apart.
fn mixed<S: Sample, const C: usize>(veil: &Veil<'_, S, C>, rect: Rect) -> Result<Vec<f32>, Interrupted> {
    let Veil { pictures, labels, optics } = veil;
    let (width, height) = pictures.size();
    let window = rect.grown(MIX, width, height);
    let mut present = vec![false; pictures.count()];
    for y in window.y..window.y + window.height {
        for &label in &labels.slice.row(y)[window.x..window.x + window.width] {
            if let Some(present) = present.get_mut(usize::from(label)) {
                *present = true;
            }
        }
    }
    let mut plain = vec![false; pictures.count()];
    for y in rect.y..rect.y + rect.height {
        let columns = rect.x..rect.x + rect.width;
        for (&label, &sure) in labels.slice.row(y)[columns.clone()].iter().zip(&labels.sure.row(y)[columns]) {
            if let (false, Some(plain)) = (sure, plain.get_mut(usize::from(label))) {
                *plain = optics.is_known();
            }
        }
    }
    for label in (0..plain.len()).filter(|&label| plain[label]) {
        for (slice, present) in present.iter_mut().enumerate() {
            *present |= !optics.apart(slice, label);
        }
    }
    let pixels = rect.width * rect.height;
    let mut only = (0..present.len()).filter(|&slice| present[slice]);
    if let (Some(alone), None) = (only.next(), only.next())
        && pictures.covers(alone, rect)
    {
        return Ok(pictures.samples(alone, rect)?.iter().map(|sample| sample.value()).collect());
    }
    let (mut values, mut weights) = (vec![0.0f32; pixels * C], vec![0.0f32; pixels]);
    let (mut shares, simd) = (Vec::with_capacity(rect.width), Avx2::detect());
    for slice in (0..present.len()).filter(|&slice| present[slice]) {
        let counts = counts(veil, slice as u16, rect, window);
        let friends: Vec<bool> = (0..present.len()).map(|other| !optics.apart(slice, other)).collect();
        let samples = pictures.samples(slice, rect)?;
        for y in 0..rect.height {
            let covered = pictures.coverage(slice).span(rect.y + y);
            let columns = covered.start.max(rect.x)..covered.end.min(rect.x + rect.width);
            if columns.is_empty() {
                continue;
            }
            let line = y * rect.width + columns.start - rect.x..y * rect.width + columns.end - rect.x;
            let own = &labels.slice.row(rect.y + y)[columns.clone()];
            let sure = &labels.sure.row(rect.y + y)[columns];
            let counts = &counts[line.clone()];
            shares.clear();
            shares.extend(own.iter().zip(sure).zip(counts).map(|((&own, &sure), &count)| {
                // what no slice covers has no friends
                let friend = friends.get(usize::from(own)).is_some_and(|&friend| friend);
                let steady = if sure | !optics.is_known() { 0 } else { WITHOUT_DETAIL };
                if friend { f32::from(count + steady) } else { 0.0 }
            }));
            let samples = &samples[line.start * C..line.end * C];
            let (values, weights) = (&mut values[line.start * C..line.end * C], &mut weights[line]);
            simd::run(
                simd,
                #[inline(always)]
                || add::<S, C>(&shares, samples, values, weights),
            );
        }
    }
    for (pixel, &weight) in values.chunks_exact_mut(C).zip(&weights) {
        let share = if weight > 0.0 { 1.0 / weight } else { 0.0 };
        pixel.iter_mut().for_each(|value| *value *= share);
    }
    Ok(values)
}

/// Adds samples, weighted, to the sums. Parts without any weight are left out.
#[inline(always)]
fn add<S: Sample, const C: usize>(shares: &[f32], samples: &[S], values: &mut [f32], weights: &mut [f32]) {
    const PART: usize = 32;
    let parts = shares.chunks(PART).zip(weights.chunks_mut(PART));
    let pixels = samples.chunks(PART * C).zip(values.chunks_mut(PART * C));
    for ((shares, weights), (samples, values)) in parts.zip(pixels) {
        if shares.iter().fold(0, |bits, share| bits | share.to_bits()) == 0 {
            continue;
        }
        weights.iter_mut().zip(shares).for_each(|(weight, share)| *weight += share);
        let pixels = values.chunks_exact_mut(C).zip(samples.chunks_exact(C));
        for (&share, (value, sample)) in shares.iter().zip(pixels) {
            for c in 0..C {
                value[c] += share * sample[c].value();
            }
        }
    }
}

/// How many labels of the square around each pixel of `rect` are `slice`.
fn counts<S: Sample, const C: usize>(veil: &Veil<'_, S, C>, slice: u16, rect: Rect, window: Rect) -> Vec<u8> {
    let simd = Avx2::detect();
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let mut across = vec![0u8; rect.width * window.height];
    // `MIX` before the first pixel of the rectangle, and as many after the last: none beyond the canvas
    let mut line = vec![0u8; rect.width + 2 * MIX];
    for (y, out) in across.chunks_exact_mut(rect.width).enumerate() {
        let labels = &veil.labels.slice.row(window.y + y)[window.x..window.x + window.width];
        let line = &mut line[..];
        simd::run(
            simd,
            #[inline(always)]
            || {
                let there = &mut line[MIX - left..];
                there.iter_mut().zip(labels).for_each(|(is, &label)| *is = u8::from(label == slice));
                for by in 0..2 * MIX + 1 {
                    out.iter_mut().zip(&line[by..]).for_each(|(sum, is)| *sum += is);
                }
            },
        );
    }
    let mut counts = vec![0u8; rect.width * rect.height];
    for (y, out) in counts.chunks_exact_mut(rect.width).enumerate() {
        let middle = y + top;
        for row in middle.saturating_sub(MIX)..(middle + MIX + 1).min(window.height) {
            let row = &across[row * rect.width..(row + 1) * rect.width];
            out.iter_mut().zip(row).for_each(|(count, more)| *count += more);
        }
    }
    counts
}
