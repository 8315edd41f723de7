//! The slices of a stack in one channel.

use super::{Raster, Sample, Samples, Slices, grey};
use crate::types::Error;

/// What the grey value of a pixel in colour is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GreyValue {
    /// Luma (Rec. 601): the least noise.
    Luma,
    /// The green sample: not displaced by lateral colour.
    Green,
}

/// Slices that are converted to grey while they are loaded, in their bit depth. Grey slices stay as they are.
pub struct GreySlices<'a> {
    slices: &'a dyn Slices,
    value: GreyValue,
}

impl<'a> GreySlices<'a> {
    /// The grey version of `slices`.
    pub fn of(slices: &'a dyn Slices, value: GreyValue) -> Self {
        Self { slices, value }
    }
}

impl Slices for GreySlices<'_> {
    fn count(&self) -> usize {
        self.slices.count()
    }

    fn name(&self, index: usize) -> &str {
        self.slices.name(index)
    }

    fn load(&self, index: usize) -> Result<Raster, Error> {
        self.load_into(index, Vec::new())
    }

    fn load_into(&self, index: usize, buffer: Vec<u8>) -> Result<Raster, Error> {
        let Raster { width, height, channels, samples } = self.slices.load_into(index, buffer)?;
        if channels != 3 {
            return Ok(Raster { width, height, channels, samples });
        }
        let samples = match samples {
            Samples::Eight(samples) => Samples::Eight(in_place(samples, width, self.value)),
            Samples::Sixteen(samples) => Samples::Sixteen(in_place(samples, width, self.value)),
        };
        Ok(Raster { width, height, channels: 1, samples })
    }
}

/// The grey values of interleaved RGB samples, in their memory.
fn in_place<S: Sample>(mut samples: Vec<S>, width: usize, value: GreyValue) -> Vec<S> {
    let mut row = vec![S::default(); width];
    let mut luma = vec![0.0; width];
    let scale = S::DEPTH.max() / 255.0;
    for y in 0..samples.len() / (3 * width).max(1) {
        let pixels = &samples[3 * y * width..3 * (y + 1) * width];
        match value {
            GreyValue::Green => row.iter_mut().zip(pixels.as_chunks::<3>().0).for_each(|(out, pixel)| *out = pixel[1]),
            GreyValue::Luma => {
                grey::luma_row(pixels, 3, &mut luma);
                row.iter_mut().zip(&luma).for_each(|(out, luma)| *out = S::rounded(luma * scale));
            }
        }
        // row y of the result lies in or before row y of the pixels, which has been read
        samples[y * width..(y + 1) * width].copy_from_slice(&row);
    }
    samples.truncate(samples.len() / 3);
    samples
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(raster: Raster, value: GreyValue) -> Raster {
        let slices = [raster];
        GreySlices::of(&&slices[..], value).load(0).expect("a slice")
    }

    #[test]
    fn each_pixel_has_its_luma_or_its_green() {
        let eight: Vec<u8> = (0..7 * 5 * 3).map(|i| (i * 31 % 256) as u8).collect();
        let luma: Vec<u8> = eight
            .chunks_exact(3)
            .map(|p| (0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2])).round() as u8)
            .collect();
        let picture = Raster::eight(7, 5, 3, eight.clone());
        assert_eq!(grey(picture.clone(), GreyValue::Luma), Raster::eight(7, 5, 1, luma));
        let green = eight.iter().skip(1).step_by(3).copied().collect();
        assert_eq!(grey(picture, GreyValue::Green), Raster::eight(7, 5, 1, green));
    }

    #[test]
    fn sixteen_bits_keep_their_depth_and_white_stays_white() {
        let white = Raster::sixteen(9, 4, 3, vec![65_535; 9 * 4 * 3]);
        for value in [GreyValue::Luma, GreyValue::Green] {
            assert_eq!(grey(white.clone(), value), Raster::sixteen(9, 4, 1, vec![65_535; 9 * 4]));
        }
        let one_channel = Raster::eight(3, 2, 1, vec![1, 2, 3, 4, 5, 6]);
        assert_eq!(grey(one_channel.clone(), GreyValue::Luma), one_channel);
    }
}
