//! Grey values of interleaved pixels, Rec. 601, row by row: as floats for focus measures, as integers where
//! sums must be exact.

use super::sample::Sample;

/// Luma 0..255 of a row of `channels` = 1 or 3 interleaved samples; the same numbers as
/// [`Raster::luma`](super::Raster::luma).
pub fn luma_row<S: Sample>(pixels: &[S], channels: usize, out: &mut [f32]) {
    let scale = 255.0 / S::DEPTH.max();
    if channels == 1 {
        for (out, sample) in out.iter_mut().zip(pixels) {
            *out = sample.value() * scale;
        }
        return;
    }
    for (out, pixel) in out.iter_mut().zip(pixels.chunks_exact(channels)) {
        *out = (0.299 * pixel[0].value() + 0.587 * pixel[1].value() + 0.114 * pixel[2].value()) * scale;
    }
}

/// The same luma as an integer, 0..65535 for either depth: the guide of the guided filter, whose window
/// sums must be exact. Its rounding (variance 2e-11 of full scale squared) is far below the smallest `eps`.
pub fn guide_row<S: Sample>(pixels: &[S], channels: usize, out: &mut [u16]) {
    if channels == 1 {
        for (out, sample) in out.iter_mut().zip(pixels) {
            *out = (sample.integer() * S::TO_SIXTEEN) as u16;
        }
        return;
    }
    for (out, pixel) in out.iter_mut().zip(pixels.chunks_exact(channels)) {
        let thousands = 299 * pixel[0].integer() + 587 * pixel[1].integer() + 114 * pixel[2].integer();
        *out = ((thousands * S::TO_SIXTEEN + 500) / 1000) as u16;
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
