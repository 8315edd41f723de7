//! AVX2 form of [`super::fixed`] for RGB: two pixels per vector.

use std::{arch::x86_64::*, ops::Range};

use super::{
    fixed_weights::Fixed,
    inside::Inside,
    parts::{PHASE_BITS, Source},
};
use crate::imaging::simd::{self, Avx2};

/// Bytes read of each of the four rows around a position; 12 of them are used.
const READ: usize = 16;

/// Computes the pixels of `out` whose neighbourhood is inside the slice with a few bytes to spare. Returns their range;
/// the caller computes the others.
pub(super) fn weigh<const C: usize>(
    simd: Avx2,
    fixed: &Fixed,
    source: &Source<'_, u8, C>,
    (us, vs): (&[i32], &[i32]),
    out: &mut [u8],
) -> Range<usize> {
    let pixels = us.len().min(vs.len()).min(out.len() / 3);
    if C != 3 || source.samples.len() != source.width * source.height * 3 {
        return 0..0;
    }
    let inside = Inside::of(source.width, source.height, READ.div_ceil(3));
    let run = simd::run(
        Some(simd),
        #[inline(always)]
        || inside.run(&us[..pixels], &vs[..pixels]),
    );
    let done = run.start..run.start + run.len() / 4 * 4;
    let out = &mut out[done.start * 3..done.end * 3];
    // SAFETY: the CPU has AVX2, of which there is proof. All positions are inside: (x, y) - 1 is the top left of four
    // rows of the slice with `READ` bytes from it to the end of its row.
    unsafe { row(fixed, source.samples, source.width * 3, (&us[done.clone()], &vs[done.clone()]), out) };
    done
}

/// Computes a row of pixels.
///
/// # Safety
/// For each position four rows of `stride` bytes, from the one above it on, must lie in `samples`, and [`READ`] bytes
/// of each from the pixel to its left on.
#[target_feature(enable = "avx2")]
unsafe fn row(fixed: &Fixed, samples: &[u8], stride: usize, (us, vs): (&[i32], &[i32]), out: &mut [u8]) {
    for ((us, vs), out) in us.as_chunks::<4>().0.iter().zip(vs.as_chunks::<4>().0).zip(out.as_chunks_mut::<12>().0) {
        // SAFETY: as this function demands.
        unsafe { four(fixed, samples, stride, us, vs, out) };
    }
}

/// Computes four pixels.
///
/// # Safety
/// For each pixel of `us`, `vs` four rows of `stride` bytes, from the one above it on, must lie in `samples`, and
/// [`READ`] bytes of each from the pixel to its left on.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn four(fixed: &Fixed, samples: &[u8], stride: usize, us: &[i32; 4], vs: &[i32; 4], out: &mut [u8; 12]) {
    // pixels 0 and 1 end up in the lower half of a vector, 2 and 3 in the upper one; a loop, so that there is one call,
    // which is then inlined
    let mut sums = [_mm256_setzero_si256(); 2];
    for (i, sum) in sums.iter_mut().enumerate() {
        // SAFETY: as this function demands.
        *sum = unsafe { two(fixed, samples, stride, [us[i], us[i + 2]], [vs[i], vs[i + 2]]) };
    }
    let (half, shift) = (_mm256_set1_epi32(fixed.half), _mm_cvtsi32_si128(fixed.shift as i32));
    let rounded = |sum: __m256i| _mm256_sra_epi32(_mm256_add_epi32(sum, half), shift);
    // R G B 0 R G B 0 in each half
    let words = _mm256_packs_epi32(rounded(sums[0]), rounded(sums[1]));
    let bytes = _mm256_packus_epi16(words, words);
    let order = _mm256_setr_epi8(
        0, 1, 2, 4, 5, 6, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, //
        -1, -1, -1, -1, -1, -1, 0, 1, 2, 4, 5, 6, -1, -1, -1, -1,
    );
    let bytes = _mm256_shuffle_epi8(bytes, order);
    let bytes = _mm_or_si128(_mm256_castsi256_si128(bytes), _mm256_extracti128_si256::<1>(bytes));
    let (first, last) = (_mm_cvtsi128_si64(bytes), _mm_extract_epi32::<2>(bytes));
    out[..8].copy_from_slice(&first.to_ne_bytes());
    out[8..].copy_from_slice(&last.to_ne_bytes());
}

/// Weighted sums of two pixels, one in each half: `[R G B 0]`.
///
/// # Safety
/// As [`four`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn two(fixed: &Fixed, samples: &[u8], stride: usize, us: [i32; 2], vs: [i32; 2]) -> __m256i {
    let (low, high) = (corner(stride, us[0], vs[0]), corner(stride, us[1], vs[1]));
    let ((x0, y0), (x1, y1)) = (fixed.weights(us[0], vs[0]), fixed.weights(us[1], vs[1]));
    // SAFETY: 16 bytes each.
    let (upper, lower) = unsafe {
        (
            both(x0.upper.as_ptr().cast(), x1.upper.as_ptr().cast()),
            both(x0.lower.as_ptr().cast(), x1.lower.as_ptr().cast()),
        )
    };
    // R R R R G G G G B B B B 0 0 0 0
    let order = _mm256_broadcastsi128_si256(_mm_setr_epi8(0, 3, 6, 9, 1, 4, 7, 10, 2, 5, 8, 11, -1, -1, -1, -1));
    let mut sum = _mm256_setzero_si256();
    for j in 0..4 {
        // SAFETY: this function demands that both rows are inside `samples`; weights are 16 bytes.
        let (row, weights) = unsafe {
            (
                both(samples.as_ptr().add(low + j * stride).cast(), samples.as_ptr().add(high + j * stride).cast()),
                both(y0[j].as_ptr().cast(), y1[j].as_ptr().cast()),
            )
        };
        let taps = _mm256_shuffle_epi8(row, order);
        // neighbours along x, two by two, in 16 bits: none of these sums is larger
        let lower = _mm256_srai_epi16::<7>(_mm256_maddubs_epi16(taps, lower));
        let along = _mm256_add_epi16(_mm256_maddubs_epi16(taps, upper), lower);
        sum = _mm256_add_epi32(sum, _mm256_madd_epi16(along, weights));
    }
    sum
}

/// Offset of the top left pixel of the 4 x 4 neighbourhood of a position, bytes.
#[inline(always)]
fn corner(stride: usize, u: i32, v: i32) -> usize {
    ((v >> PHASE_BITS) as usize - 1) * stride + ((u >> PHASE_BITS) as usize - 1) * 3
}

/// 16 bytes in each half.
///
/// # Safety
/// 16 bytes from `low` and from `high` on must be readable.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) unsafe fn both(low: *const __m128i, high: *const __m128i) -> __m256i {
    // SAFETY: as this function demands; neither read claims any alignment.
    unsafe { _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(_mm_loadu_si128(low)), _mm_loadu_si128(high)) }
}
