//! Edge padding: colours of the object continued beyond its outline, under alpha 0.
//!
//! Feature detectors and the interpolation of textures look at pixels beside the outline. Where these are black, the
//! outline is a step of brightness that no object has. Programs for texture maps call the remedy *edge padding* or
//! *dilation*.

use super::{Raster, Sample, Samples};

/// Width of the padding, px: the reach of bicubic interpolation, and of the smallest blur of feature detectors.
pub const PADDING_PX: usize = 4;

/// Continues the colours of `image` (RGBA) into pixels with alpha 0, up to [`PADDING_PX`] px (8-neighbourhood) from a
/// pixel with alpha above 0. Alpha stays 0. Each new colour is the mean of the neighbours that are one px nearer to the
/// object.
///
/// # Panics
/// When `image` does not have four channels.
pub fn pad(image: &mut Raster) {
    assert_eq!(image.channels, 4, "edge padding needs alpha");
    let (width, height) = (image.width, image.height);
    match &mut image.samples {
        Samples::Eight(samples) => pad_samples(samples, width, height),
        Samples::Sixteen(samples) => pad_samples(samples, width, height),
    }
}

fn pad_samples<S: Sample>(samples: &mut [S], width: usize, height: usize) {
    // distance from the object in px; pixels beyond the padding have none
    const BEYOND: u8 = u8::MAX;
    let is_object = |samples: &[S], pixel: usize| samples[4 * pixel + 3] != S::default();
    let mut ring: Vec<usize> = (0..width * height)
        .filter(|&pixel| {
            !is_object(samples, pixel) && neighbours(pixel, width, height).any(|near| is_object(samples, near))
        })
        .collect();
    if ring.is_empty() {
        return;
    }
    let mut distance: Vec<u8> =
        (0..width * height).map(|pixel| if is_object(samples, pixel) { 0 } else { BEYOND }).collect();
    for step in 1..=PADDING_PX as u8 {
        for &pixel in &ring {
            let nearer = neighbours(pixel, width, height).filter(|&near| distance[near] < step);
            let (sum, count) = nearer.fold(([0_u32; 3], 0_u32), |(sum, count), near| {
                (std::array::from_fn(|c| sum[c] + samples[4 * near + c].integer()), count + 1)
            });
            for (c, sum) in sum.into_iter().enumerate() {
                let mean = (sum + count / 2) / count.max(1);
                samples[4 * pixel + c] = S::rounded(mean as f32);
            }
        }
        ring.iter().for_each(|&pixel| distance[pixel] = step);
        let mut next: Vec<usize> = ring
            .iter()
            .flat_map(|&pixel| neighbours(pixel, width, height))
            .filter(|&pixel| distance[pixel] == BEYOND)
            .collect();
        next.sort_unstable();
        next.dedup();
        ring = next;
    }
}

/// The up to eight neighbours of a pixel.
fn neighbours(pixel: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (pixel % width, pixel / width);
    let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
    rows.flat_map(move |row| (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |column| row * width + column))
        .filter(move |&near| near != pixel)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grey pixels with alpha, as RGBA.
    fn row(pixels: &[(u8, u8)]) -> Raster {
        Raster::eight(pixels.len(), 1, 4, pixels.iter().flat_map(|&(v, alpha)| [v, v, v, alpha]).collect())
    }

    fn eight(raster: &Raster) -> &[u8] {
        let Samples::Eight(samples) = &raster.samples else { panic!("not 8 bits") };
        samples
    }

    #[test]
    fn colours_continue_beside_the_outline_and_end_beyond_the_padding() {
        let mut image = row(&[(90, 255), (0, 0), (0, 0), (0, 0), (0, 0), (0, 0), (0, 0)]);
        pad(&mut image);
        let padded = row(&[(90, 255), (90, 0), (90, 0), (90, 0), (90, 0), (0, 0), (0, 0)]);
        assert_eq!(eight(&image), eight(&padded));
    }

    #[test]
    fn a_gap_between_two_colours_gets_their_mean() {
        let mut image = row(&[(100, 255), (0, 0), (51, 10)]);
        pad(&mut image);
        assert_eq!(eight(&image), eight(&row(&[(100, 255), (76, 0), (51, 10)])));
    }

    #[test]
    fn an_image_of_one_kind_of_pixels_stays_as_it_is() {
        for alpha in [0, 255] {
            let mut image = Raster::eight(5, 4, 4, [7, 8, 9, alpha].repeat(20));
            let before = image.clone();
            pad(&mut image);
            assert_eq!(image, before);
        }
    }

    #[test]
    fn sixteen_bits_are_padded_around_a_single_pixel() {
        let mut samples = vec![0_u16; 4 * 11 * 11];
        samples[4 * (5 * 11 + 5)..][..4].copy_from_slice(&[60_000, 30_000, 1, 65_535]);
        let mut image = Raster::sixteen(11, 11, 4, samples);
        pad(&mut image);
        let Samples::Sixteen(samples) = &image.samples else { panic!("16 bits") };
        let coloured = samples.chunks_exact(4).filter(|pixel| pixel[..3] == [60_000, 30_000, 1]).count();
        assert_eq!(coloured, 9 * 9);
        assert_eq!(samples.chunks_exact(4).filter(|pixel| pixel[3] > 0).count(), 1, "alpha stays");
    }
}
