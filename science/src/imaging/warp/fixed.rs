//! Fixed-point weighted sums, for 8-bit samples.
//!
//! Along x the weights are in units of 2^-13, and the sums are truncated to units of 2^-6. Along y the weights include
//! the gain and are as fine as 16 bits allow. Before rounding, the result differs by at most 0.04 levels from floating
//! point. Integer positions and constant images are exact.

use super::{
    fixed_weights::{Fixed, LEFT_BITS, X_BITS},
    parts::{PHASES, Source},
};

impl Fixed {
    /// Computes the pixels of `out` from the source positions `us`, `vs`.
    pub(super) fn weigh<const C: usize>(&self, source: &Source<'_, u8, C>, (us, vs): (&[i32], &[i32]), out: &mut [u8]) {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "there are kernels for x86 alone"))]
        let mut done = 0..0;
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.simd {
            done = match C {
                1 => super::fixed_avx2_grey::weigh(simd, self, source, (us, vs), out),
                _ => super::fixed_avx2::weigh(simd, self, source, (us, vs), out),
            };
        }
        let _ = self.simd;
        let end = us.len().min(vs.len());
        for i in (0..done.start).chain(done.end..end) {
            self.pixel(source, us[i], vs[i], &mut out[i * C..(i + 1) * C]);
        }
    }

    #[inline]
    fn pixel<const C: usize>(&self, source: &Source<'_, u8, C>, u: i32, v: i32, out: &mut [u8]) {
        let wx = &self.x[u as usize & (PHASES - 1)];
        let wy = &self.y[v as usize & (PHASES - 1)];
        let ([x, y], inside) = source.corner(u, v);
        // four rows of up to four pixels of three samples
        let mut taps = [[0u8; 12]; 4];
        for (j, taps) in taps.iter_mut().enumerate() {
            if inside {
                let start = ((y as usize + j) * source.width + x as usize) * C;
                taps[..4 * C].copy_from_slice(&source.samples[start..start + 4 * C]);
            } else {
                for (i, tap) in taps[..4 * C].chunks_exact_mut(C).enumerate() {
                    tap.copy_from_slice(source.pixel(x + i as isize, y + j as isize));
                }
            }
        }
        let mut sums = [self.half; C];
        for (j, taps) in taps.iter().enumerate() {
            for (c, sum) in sums.iter_mut().enumerate() {
                let at = |i: usize| wx.weight(i) * i32::from(taps[i * C + c]);
                let (left, right) = ((at(0) + at(1)) >> (X_BITS - LEFT_BITS), (at(2) + at(3)) >> (X_BITS - LEFT_BITS));
                *sum += i32::from(wy[j][0]) * (left + right);
            }
        }
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = (sum >> self.shift).clamp(0, 255) as u8;
        }
    }
}
