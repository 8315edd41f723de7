//! Luma (Rec. 601) of interleaved pixels, row by row: as floats for focus measures, as integers where sums must be
//! exact.

use super::{
    sample::Sample,
    simd::{self, Avx2},
};

/// Rec. 601 weights of red, green and blue in the luma.
pub const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// Pixels that are split into channels at a time.
const BLOCK: usize = 64;

/// Luma 0..255 of a row of pixels of `channels` interleaved samples: 1 grey, 3 RGB, 4 RGBA (alpha is ignored).
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
                |r, g, b| (LUMA[0] * r.value() + LUMA[1] * g.value() + LUMA[2] * b.value()) * scale,
            ),
        },
    );
}

/// The same luma as an integer, 0..=65535 at either depth. This is the guide of the guided filter, whose window sums
/// must be exact. The rounding (variance 2e-11 of full scale squared) is far below the smallest `eps`.
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

/// Applies `grey` to each pixel. Channels are split first, a block at a time: the compiler vectorises the splitting and
/// the arithmetic separately, but not together.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
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
    fn the_luma_of_a_row_is_the_weighted_sum_of_its_channels() {
        let samples: Vec<u8> = (0..300u32).map(|i| (i * 97 % 256) as u8).collect();
        let mut row = [0.0; 100];
        luma_row(&samples, 3, &mut row);
        for (pixel, luma) in samples.chunks(3).zip(row) {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(f32::from);
            assert_eq!(luma, 0.299 * r + 0.587 * g + 0.114 * b);
        }
        let raster = Raster::eight(10, 10, 3, samples);
        assert_eq!(raster.luma().data, row);
        let [mut with_alpha, mut without] = [[0.0; 2]; 2];
        luma_row(&[10u16, 20, 30, 65_535, 40, 50, 60, 0], 4, &mut with_alpha);
        luma_row(&[10u16, 20, 30, 40, 50, 60], 3, &mut without);
        assert_eq!(with_alpha, without);
    }

    #[test]
    fn vector_instructions_give_the_same_bits() {
        let samples: Vec<u16> = (0..3 * 200u32).map(|i| (i * 40_503 % 65_536) as u16).collect();
        let (mut row, mut pixel) = ([0.0; 200], [0.0; 1]);
        let (mut guides, mut guide) = ([0; 200], [0; 1]);
        luma_row(&samples, 3, &mut row);
        guide_row(&samples, 3, &mut guides);
        // a single pixel is shorter than a block
        for ((samples, row), guides) in samples.chunks(3).zip(row).zip(guides) {
            luma_row(samples, 3, &mut pixel);
            guide_row(samples, 3, &mut guide);
            assert_eq!((pixel[0], guide[0]), (row, guides));
        }
    }

    #[test]
    fn white_is_full_scale_in_every_format() {
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
