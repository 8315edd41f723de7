//! AVX2 form of [`super::fixed`] for grey: two pixels per vector.

use std::{arch::x86_64::*, ops::Range};

use super::{
    fixed_avx2::both,
    fixed_weights::Fixed,
    inside::Inside,
    parts::{PHASE_BITS, Source},
};
use crate::imaging::simd::{self, Avx2};

/// Pixels that are computed at a time.
const PIXELS: usize = 8;

/// Computes the pixels of `out` whose neighbourhood is inside the slice. Returns their range; the caller computes the
/// others.
pub(super) fn weigh<const C: usize>(
    simd: Avx2,
    fixed: &Fixed,
    source: &Source<'_, u8, C>,
    (us, vs): (&[i32], &[i32]),
    out: &mut [u8],
) -> Range<usize> {
    let pixels = us.len().min(vs.len()).min(out.len());
    if C != 1 || source.samples.len() != source.width * source.height {
        return 0..0;
    }
    let inside = Inside::of(source.width, source.height, 4);
    let run = simd::run(
        Some(simd),
        #[inline(always)]
        || inside.run(&us[..pixels], &vs[..pixels]),
    );
    let done = run.start..run.start + run.len() / PIXELS * PIXELS;
    let out = &mut out[done.clone()];
    // SAFETY: the CPU has AVX2, of which there is proof. All positions are inside: the 4 x 4 samples from (x, y) - 1 on
    // are in the slice.
    unsafe { row(fixed, source.samples, source.width, (&us[done.clone()], &vs[done.clone()]), out) };
    done
}

/// Computes a row of pixels.
///
/// # Safety
/// For each position the 4 x 4 samples around it must lie in `samples`, whose rows have `stride` samples.
#[target_feature(enable = "avx2")]
unsafe fn row(fixed: &Fixed, samples: &[u8], stride: usize, (us, vs): (&[i32], &[i32]), out: &mut [u8]) {
    let (half, shift) = (_mm256_set1_epi32(fixed.half), _mm_cvtsi32_si128(fixed.shift as i32));
    let places = us.as_chunks::<PIXELS>().0.iter().zip(vs.as_chunks::<PIXELS>().0);
    for ((us, vs), out) in places.zip(out.as_chunks_mut::<PIXELS>().0) {
        // pixels 0 to 3 end up in the lower half of the vectors, 4 to 7 in the upper one
        let mut sums = [_mm256_setzero_si256(); 4];
        for (i, sum) in sums.iter_mut().enumerate() {
            // SAFETY: as this function demands.
            *sum = unsafe { two(fixed, samples, stride, [us[i], us[i + 4]], [vs[i], vs[i + 4]]) };
        }
        let [a, b, c, d] = sums;
        let sums = _mm256_hadd_epi32(_mm256_hadd_epi32(a, b), _mm256_hadd_epi32(c, d));
        let words = _mm256_sra_epi32(_mm256_add_epi32(sums, half), shift);
        let words = _mm256_packs_epi32(words, words);
        let bytes = _mm256_packus_epi16(words, words);
        out[..4].copy_from_slice(&_mm256_extract_epi32::<0>(bytes).to_ne_bytes());
        out[4..].copy_from_slice(&_mm256_extract_epi32::<4>(bytes).to_ne_bytes());
    }
}

/// The weighted sums of the four rows of two pixels, one in each half.
///
/// # Safety
/// As [`row`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn two(fixed: &Fixed, samples: &[u8], stride: usize, us: [i32; 2], vs: [i32; 2]) -> __m256i {
    let ((x0, y0), (x1, y1)) = (fixed.grey_weights(us[0], vs[0]), fixed.grey_weights(us[1], vs[1]));
    // SAFETY: this function demands that the samples are there; weights are 16 bytes each.
    unsafe {
        let taps = _mm256_set_m128i(taps(samples, stride, us[1], vs[1]), taps(samples, stride, us[0], vs[0]));
        let upper = _mm256_maddubs_epi16(taps, both(x0.upper.as_ptr().cast(), x1.upper.as_ptr().cast()));
        let lower = _mm256_maddubs_epi16(taps, both(x0.lower.as_ptr().cast(), x1.lower.as_ptr().cast()));
        // neighbours along x, two by two, in 16 bits: none of these sums is larger
        let along = _mm256_add_epi16(upper, _mm256_srai_epi16::<7>(lower));
        _mm256_madd_epi16(along, both(y0.as_ptr().cast(), y1.as_ptr().cast()))
    }
}

/// The 4 x 4 samples around a position, row by row.
///
/// # Safety
/// As [`row`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn taps(samples: &[u8], stride: usize, u: i32, v: i32) -> __m128i {
    let start = ((v >> PHASE_BITS) as usize - 1) * stride + (u >> PHASE_BITS) as usize - 1;
    // SAFETY: as this function demands; the reads claim no alignment.
    let at = |row: usize| unsafe { samples.as_ptr().add(start + row * stride).cast::<i32>().read_unaligned() };
    _mm_setr_epi32(at(0), at(1), at(2), at(3))
}
