//! AVX2 form of [`super::float`] for 16-bit RGB: the twelve samples of a row in one and a half vectors.

use std::{arch::x86_64::*, ops::Range};

use super::{
    inside::Inside,
    parts::{PHASE_BITS, PHASES, Source},
};
use crate::imaging::{
    Sample,
    simd::{self, Avx2},
};

/// Computes the pixels of `out` whose neighbourhood is inside the slice. Returns their range; the caller computes the
/// others. `weights` has four weights for each phase; the gain is applied last.
pub(super) fn weigh<S: Sample, const C: usize>(
    simd: Avx2,
    (weights, gain): (&[[f32; 4]; PHASES], f32),
    source: &Source<'_, S, C>,
    (us, vs): (&[i32], &[i32]),
    out: &mut [S],
) -> Range<usize> {
    if C != 3 || S::BYTES != 2 || source.samples.len() != source.width * source.height * 3 {
        return 0..0;
    }
    let inside = Inside::of(source.width, source.height, 4);
    let count = us.len().min(vs.len()).min(out.len() / 3);
    let done = simd::run(
        Some(simd),
        #[inline(always)]
        || inside.run(&us[..count], &vs[..count]),
    );
    let out = &mut simd::bytes_of_mut(out)[done.start * 6..done.end * 6];
    let first = source.samples.as_ptr().cast();
    // SAFETY: the CPU has AVX2, of which there is proof. Samples are of two bytes, `u16`. All positions are inside, so
    // that four rows of four pixels from the one to the upper left on lie in the slice.
    unsafe { row(weights, gain, (first, source.width), (&us[done.clone()], &vs[done.clone()]), out) };
    done
}

/// Computes a row of pixels of three 16-bit samples.
///
/// # Safety
/// `samples` begin a slice `width` px wide, in which the four rows of four pixels around each position lie.
#[target_feature(enable = "avx2")]
unsafe fn row(
    weights: &[[f32; 4]; PHASES],
    gain: f32,
    (samples, width): (*const u16, usize),
    (us, vs): (&[i32], &[i32]),
    out: &mut [u8],
) {
    for ((&u, &v), out) in us.iter().zip(vs).zip(out.as_chunks_mut::<6>().0) {
        let (x, y) = ((u >> PHASE_BITS) as usize - 1, (v >> PHASE_BITS) as usize - 1);
        let weights = [&weights[u as usize & (PHASES - 1)], &weights[v as usize & (PHASES - 1)]];
        // SAFETY: as this function demands.
        let pixel = unsafe { pixel(samples.add((y * width + x) * 3), width * 3, weights, gain) };
        out.copy_from_slice(&pixel.to_ne_bytes()[..6]);
    }
}

/// Computes a pixel; its samples are in the lower 48 bits.
///
/// # Safety
/// From `first` on, and from there on after each `stride` samples, three times, twelve samples must be readable.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn pixel(first: *const u16, stride: usize, [along_x, along_y]: [&[f32; 4]; 2], gain: f32) -> u64 {
    let (mut sums, mut last) = (_mm256_setzero_ps(), _mm_setzero_ps());
    for (j, &weight) in along_y.iter().enumerate() {
        // SAFETY: as this function demands: eight samples, and the four after them; no alignment is claimed.
        let (row, end) = unsafe {
            let row = first.add(j * stride);
            (_mm_loadu_si128(row.cast()), _mm_loadl_epi64(row.add(8).cast()))
        };
        let (row, end) = (_mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(row)), _mm_cvtepi32_ps(_mm_cvtepu16_epi32(end)));
        sums = _mm256_add_ps(sums, _mm256_mul_ps(_mm256_set1_ps(weight), row));
        last = _mm_add_ps(last, _mm_mul_ps(_mm_set1_ps(weight), end));
    }
    // the columns of the four pixels, the first three of each vector
    let (low, high) =
        (_mm_castps_si128(_mm256_castps256_ps128(sums)), _mm_castps_si128(_mm256_extractf128_ps::<1>(sums)));
    let last = _mm_castps_si128(last);
    let columns = [low, _mm_alignr_epi8::<12>(high, low), _mm_alignr_epi8::<8>(last, high), _mm_srli_si128::<4>(last)];
    let mut value = _mm_setzero_ps();
    for (&weight, column) in along_x.iter().zip(columns) {
        value = _mm_add_ps(value, _mm_mul_ps(_mm_set1_ps(weight), _mm_castsi128_ps(column)));
    }
    let rounded = _mm_add_ps(_mm_mul_ps(value, _mm_set1_ps(gain)), _mm_set1_ps(0.5));
    // packing turns negative values into 0; large ones are limited first, because their conversion is not defined
    let whole = _mm_cvttps_epi32(_mm_min_ps(rounded, _mm_set1_ps(65_535.0)));
    _mm_cvtsi128_si64(_mm_packus_epi32(whole, whole)) as u64
}
