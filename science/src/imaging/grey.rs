//! Grey values of interleaved pixels, Rec. 601, row by row: as floats for focus measures, as integers where
//! sums must be exact.

use super::{
    sample::Sample,
    simd::{self, Avx2},
};

/// Pixels whose channels are taken apart at a time.
const BLOCK: usize = 64;

/// Luma 0..255 of a row of `channels` = 1 or 3 interleaved samples; the same numbers as
/// [`Raster::luma`](super::Raster::luma).
pub fn luma_row<S: Sample>(pixels: &[S], channels: usize, out: &mut [f32]) {
    let scale = 255.0 / S::DEPTH.max();
    simd::run(
        Avx2::detect(),
        #[inline(always)]
        || match channels {
            1 => out.iter_mut().zip(pixels).for_each(|(out, sample)| *out = sample.value() * scale),
            _ => in_blocks(
                pixels,
                channels,
                out,
                #[inline(always)]
                |r, g, b| (0.299 * r.value() + 0.587 * g.value() + 0.114 * b.value()) * scale,
            ),
        },
    );
}

/// The same luma as an integer, 0..65535 for either depth: the guide of the guided filter, whose window
/// sums must be exact. Its rounding (variance 2e-11 of full scale squared) is far below the smallest `eps`.
pub fn guide_row<S: Sample>(pixels: &[S], channels: usize, out: &mut [u16]) {
    simd::run(
        Avx2::detect(),
        #[inline(always)]
        || match channels {
            1 => out.iter_mut().zip(pixels).for_each(|(out, v)| *out = (v.integer() * S::TO_SIXTEEN) as u16),
            _ => in_blocks(
                pixels,
                channels,
                out,
                #[inline(always)]
                |r: S, g: S, b: S| {
                    let thousands = 299 * r.integer() + 587 * g.integer() + 114 * b.integer();
                    ((thousands * S::TO_SIXTEEN + 500) / 1000) as u16
                },
            ),
        },
    );
}

/// `grey` of each pixel. Channels are taken apart first, a block at a time: the compiler finds vector instructions for
/// that and for the rest, and not for both at once.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "several slices side by side")]
fn in_blocks<S: Sample, T>(pixels: &[S], channels: usize, out: &mut [T], grey: impl Fn(S, S, S) -> T) {
    let mut done = 0;
    if channels == 3 {
        let (mut r, mut g, mut b) = ([S::default(); BLOCK], [S::default(); BLOCK], [S::default(); BLOCK]);
        for (out, pixels) in out.chunks_exact_mut(BLOCK).zip(pixels.chunks_exact(BLOCK * 3)) {
            for i in 0..BLOCK {
                (r[i], g[i], b[i]) = (pixels[3 * i], pixels[3 * i + 1], pixels[3 * i + 2]);
            }
            for i in 0..BLOCK {
                out[i] = grey(r[i], g[i], b[i]);
            }
            done += BLOCK;
        }
    }
    for (out, pixel) in out.iter_mut().zip(pixels.chunks_exact(channels)).skip(done) {
        *out = grey(pixel[0], pixel[1], pixel[2]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Raster;

    #[test]
    fn rows_agree_with_the_luma_of_the_whole_raster() {
        let samples: Vec<u8> = (0..60u32).map(|i| (i * 97 % 256) as u8).collect();
        let raster = Raster::eight(10, 2, 3, samples.clone());
        let mut row = [0.0; 10];
        luma_row(&samples[30..], 3, &mut row);
        assert_eq!(row, raster.luma().row(1));
    }

    #[test]
    fn vector_instructions_give_the_same_bits() {
        let samples: Vec<u16> = (0..3 * 200u32).map(|i| (i * 40_503 % 65_536) as u16).collect();
        let (mut row, mut pixel) = ([0.0; 200], [0.0; 1]);
        let (mut guides, mut guide) = ([0; 200], [0; 1]);
        luma_row(&samples, 3, &mut row);
        guide_row(&samples, 3, &mut guides);
        // one pixel alone is no block
        for ((samples, row), guides) in samples.chunks(3).zip(row).zip(guides) {
            luma_row(samples, 3, &mut pixel);
            guide_row(samples, 3, &mut guide);
            assert_eq!((pixel[0], guide[0]), (row, guides));
        }
    }

    #[test]
    fn white_is_full_scale_in_every_form() {
        let mut guide = [0u16; 1];
        guide_row(&[255u8; 3], 3, &mut guide);
        assert_eq!(guide, [65_535]);
        guide_row(&[255u8], 1, &mut guide);
        assert_eq!(guide, [65_535]);
        guide_row(&[65_535u16; 3], 3, &mut guide);
        assert_eq!(guide, [65_535]);
        let mut luma = [0.0f32; 1];
        luma_row(&[65_535u16; 3], 3, &mut luma);
        assert!((luma[0] - 255.0).abs() < 1e-3);
    }
}
