//! Prefix sums of a row. The sum over a window is the difference of two of them. All sums wrap: if the window sum fits,
//! the difference of two wrapped prefix sums is exact.

use super::Avx2;

/// Prefix sums of each of `C` interleaved channels: `out[i]` is the sum of `values[i % C]`, `values[i % C + C]`, ...
/// before `values[i]`, for `i` up to `values.len() + C`.
///
/// # Panics
/// When `out` is not `C` longer than `values`, or `C` does not divide their length.
#[inline]
pub fn prefix<const C: usize>(simd: Option<Avx2>, values: &[u32], out: &mut [u32]) {
    assert!(out.len() == values.len() + C && values.len().is_multiple_of(C), "running sums of another length");
    #[cfg(target_arch = "x86_64")]
    if C == 1 && simd.is_some() {
        // SAFETY: a value of `Avx2` exists only where the CPU has AVX2.
        return unsafe { avx2::prefix_u32(values, out) };
    }
    #[cfg(target_arch = "x86_64")]
    if C == 3 && simd.is_some() {
        return avx2::prefix_rgb(values, out);
    }
    let _ = simd;
    portable_by::<C>([0; C], values, out);
}

/// The same for one channel.
///
/// # Panics
/// When `out` is not one longer than `values`.
#[inline]
pub fn prefix_u32(simd: Option<Avx2>, values: &[u32], out: &mut [u32]) {
    prefix::<1>(simd, values, out);
}

/// The same with 64 bits.
///
/// # Panics
/// When `out` is not one longer than `values`.
#[inline]
pub fn prefix_u64(simd: Option<Avx2>, values: &[u64], out: &mut [u64]) {
    assert_eq!(out.len(), values.len() + 1, "a running sum has one more element");
    #[cfg(target_arch = "x86_64")]
    if simd.is_some() {
        // SAFETY: a value of `Avx2` exists only where the CPU has AVX2.
        return unsafe { avx2::prefix_u64(values, out) };
    }
    let _ = simd;
    portable_u64(0, values, out);
}

fn portable_by<const C: usize>(mut sums: [u32; C], values: &[u32], out: &mut [u32]) {
    for (out, values) in out.chunks_exact_mut(C).zip(values.chunks_exact(C)) {
        out.copy_from_slice(&sums);
        for (sum, &value) in sums.iter_mut().zip(values) {
            *sum = sum.wrapping_add(value);
        }
    }
    if let Some(last) = out.last_chunk_mut::<C>() {
        *last = sums;
    }
}

fn portable_u64(mut sum: u64, values: &[u64], out: &mut [u64]) {
    for (out, &value) in out.iter_mut().zip(values) {
        *out = sum;
        sum = sum.wrapping_add(value);
    }
    if let Some(last) = out.get_mut(values.len()) {
        *last = sum;
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::*;

    #[target_feature(enable = "avx2")]
    pub(super) fn prefix_u32(values: &[u32], out: &mut [u32]) {
        let (blocks, rest) = values.as_chunks::<8>();
        let (out_blocks, _) = out.as_chunks_mut::<8>();
        let mut before = _mm256_setzero_si256();
        for (block, out) in blocks.iter().zip(out_blocks) {
            // SAFETY: a block is 32 bytes, read without any claim to alignment.
            let v = unsafe { _mm256_loadu_si256(block.as_ptr().cast()) };
            // within each half: x1, x1+x2, x1+x2+x3, ...
            let v1 = _mm256_add_epi32(v, _mm256_slli_si256::<4>(v));
            let v2 = _mm256_add_epi32(v1, _mm256_slli_si256::<8>(v1));
            // the sum of the lower half, in all of the upper one
            let low = _mm256_shuffle_epi32::<0xFF>(_mm256_permute2x128_si256::<0x08>(v2, v2));
            let sums = _mm256_add_epi32(_mm256_add_epi32(v2, low), before);
            // without the element itself
            let without = _mm256_sub_epi32(sums, v);
            // SAFETY: a block is 32 bytes, written without any claim to alignment.
            unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), without) };
            before = _mm256_permutevar8x32_epi32(sums, _mm256_set1_epi32(7));
        }
        let total = _mm256_extract_epi32::<0>(before) as u32;
        let done = blocks.len() * 8;
        super::portable_by([total], rest, &mut out[done..]);
    }

    /// Four sums at a time. The fourth is meaningless, and overwritten by the next three.
    ///
    /// # Panics
    /// When `out` is not three longer than `values`.
    pub(super) fn prefix_rgb(values: &[u32], out: &mut [u32]) {
        // what the reads and writes below rely on
        assert_eq!(out.len(), values.len() + 3, "running sums of another length");
        // the last pixels are left out: reads and writes of four reach beyond them
        let most = (values.len() / 3).saturating_sub(1);
        // SAFETY: SSE2 is part of x86-64.
        let mut sums = unsafe { _mm_setzero_si128() };
        for pixel in 0..most {
            // SAFETY: `pixel * 3 + 4 <= values.len()`, because one more pixel follows, and `out` is three longer, as
            // asserted. Neither the read nor the write claims any alignment.
            unsafe {
                _mm_storeu_si128(out.as_mut_ptr().add(pixel * 3).cast(), sums);
                sums = _mm_add_epi32(sums, _mm_loadu_si128(values.as_ptr().add(pixel * 3).cast()));
            }
        }
        let mut last = [0u32; 4];
        // SAFETY: four numbers of 32 bits.
        unsafe { _mm_storeu_si128(last.as_mut_ptr().cast(), sums) };
        let done = most * 3;
        super::portable_by([last[0], last[1], last[2]], &values[done..], &mut out[done..]);
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn prefix_u64(values: &[u64], out: &mut [u64]) {
        let (blocks, rest) = values.as_chunks::<4>();
        let (out_blocks, _) = out.as_chunks_mut::<4>();
        let mut before = _mm256_setzero_si256();
        for (block, out) in blocks.iter().zip(out_blocks) {
            // SAFETY: a block is 32 bytes, read without any claim to alignment.
            let v = unsafe { _mm256_loadu_si256(block.as_ptr().cast()) };
            let v1 = _mm256_add_epi64(v, _mm256_slli_si256::<8>(v));
            let low = _mm256_permute2x128_si256::<0x08>(v1, v1);
            let low = _mm256_unpackhi_epi64(low, low);
            let sums = _mm256_add_epi64(_mm256_add_epi64(v1, low), before);
            let without = _mm256_sub_epi64(sums, v);
            // SAFETY: a block is 32 bytes, written without any claim to alignment.
            unsafe { _mm256_storeu_si256(out.as_mut_ptr().cast(), without) };
            before = _mm256_permute4x64_epi64::<0xFF>(sums);
        }
        let total = _mm256_extract_epi64::<0>(before) as u64;
        let done = blocks.len() * 4;
        super::portable_u64(total, rest, &mut out[done..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn running_sums_are_the_same_with_and_without_vector_instructions() {
        for length in (0..70).chain([511, 512, 700]) {
            // large enough to wrap
            let values: Vec<u32> = (0..length as u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
            let wide: Vec<u64> = values.iter().map(|&v| u64::from(v).wrapping_mul(0x9E37_79B9_7F4A_7C15)).collect();
            let (mut sums, mut plain) = (vec![7; length + 1], vec![9; length + 1]);
            prefix_u32(Avx2::detect(), &values, &mut sums);
            prefix_u32(None, &values, &mut plain);
            assert_eq!(sums, plain);
            assert_eq!(plain[length], values.iter().fold(0, |sum: u32, &v| sum.wrapping_add(v)));
            let (mut sums, mut plain) = (vec![7; length * 3 + 3], vec![9; length * 3 + 3]);
            let pixels: Vec<u32> = (0..length as u32 * 3).map(|i| i.wrapping_mul(2_246_822_519)).collect();
            prefix::<3>(Avx2::detect(), &pixels, &mut sums);
            prefix::<3>(None, &pixels, &mut plain);
            assert_eq!(sums, plain);
            let blue = pixels.chunks(3).fold(0, |sum: u32, v| sum.wrapping_add(v[2]));
            assert_eq!(plain.last(), Some(&blue));
            let (mut sums, mut plain) = (vec![7; length + 1], vec![9; length + 1]);
            prefix_u64(Avx2::detect(), &wide, &mut sums);
            prefix_u64(None, &wide, &mut plain);
            assert_eq!(sums, plain);
            assert_eq!(plain[length], wide.iter().fold(0, |sum: u64, &v| sum.wrapping_add(v)));
        }
    }
}
