//! From values to samples: rounded, and counted where they are outside the range of the samples.

use crate::imaging::{
    Rect, Sample,
    simd::{self, Avx2},
};

/// The number of pixels of `rect` with a value more than one grey level of 255 outside the range of the samples;
/// `values` are those of `window`.
pub(super) fn out_of_range<S: Sample, const C: usize>(values: &[f32], window: Rect, rect: Rect) -> usize {
    let level = S::DEPTH.max() / 255.0;
    let (low, high) = (-level, S::DEPTH.max() + level);
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let outside = (top..top + rect.height).map(|y| {
        let row = values[(y * window.width + left) * C..][..rect.width * C].as_chunks::<C>().0;
        let outside = |pixel: &[f32; C]| pixel.iter().fold(false, |is, &value| is | (value < low) | (value > high));
        row.iter().map(|pixel| usize::from(outside(pixel))).sum::<usize>()
    });
    outside.sum()
}

/// Values rounded to samples.
pub(super) fn rounded<S: Sample>(values: &[f32]) -> Vec<S> {
    let mut samples = vec![S::default(); values.len()];
    simd::run(
        Avx2::detect(),
        #[inline(always)]
        || samples.iter_mut().zip(values).for_each(|(sample, &value)| *sample = S::rounded(value.max(0.0))),
    );
    samples
}
