//! A small picture for a page.

use crate::imaging::{Raster, Samples};

/// Widest preview, px.
pub const MAX_WIDTH: usize = 1024;

/// An 8-bit RGBA picture of at most [`MAX_WIDTH`] columns: each of its pixels is the mean of a block, colours weighted
/// by their alpha, so that what is transparent does not darken the rim of the object. `image` is RGBA.
pub fn preview(image: &Raster) -> Raster {
    match &image.samples {
        Samples::Eight(samples) => shrink(image, samples, |v| u32::from(v) * 257),
        Samples::Sixteen(samples) => shrink(image, samples, u32::from),
    }
}

/// `wide` brings a sample to 0..65535.
fn shrink<S: Copy>(image: &Raster, samples: &[S], wide: impl Fn(S) -> u32) -> Raster {
    let width = image.width.min(MAX_WIDTH);
    let height = ((image.height * width + image.width / 2) / image.width.max(1)).max(1);
    let step = image.channels;
    let mut out = Vec::with_capacity(width * height * 4);
    for y in 0..height {
        let rows = block(y, height, image.height);
        for x in 0..width {
            let columns = block(x, width, image.width);
            let mut sums = [0u64; 4];
            for row in rows.clone() {
                let run =
                    &samples[(row * image.width + columns.start) * step..(row * image.width + columns.end) * step];
                for pixel in run.chunks_exact(step) {
                    let alpha = u64::from(wide(pixel[3]));
                    for (sum, &sample) in sums.iter_mut().zip(&pixel[..3]) {
                        *sum += alpha * u64::from(wide(sample));
                    }
                    sums[3] += alpha;
                }
            }
            let [r, g, b, alpha] = sums;
            let count = (rows.len() * columns.len()) as u64;
            let colour = |sum: u64| if alpha == 0 { 0 } else { rounded(sum, alpha) };
            out.extend([colour(r), colour(g), colour(b), rounded(alpha, count)]);
        }
    }
    Raster::eight(width, height, 4, out)
}

/// The source rows (columns) of row (column) `at` of `of`: never empty, and together all of `all`.
fn block(at: usize, of: usize, all: usize) -> std::ops::Range<usize> {
    let start = at * all / of;
    start..((at + 1) * all / of).max(start + 1)
}

/// `sum / count`, a mean of 0..65535, to the nearest of 0..255.
fn rounded(sum: u64, count: u64) -> u8 {
    ((sum + count * 257 / 2) / (count * 257)).min(255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eight(raster: &Raster) -> &[u8] {
        match &raster.samples {
            Samples::Eight(samples) => samples,
            Samples::Sixteen(_) => panic!("a preview has 8 bits"),
        }
    }

    #[test]
    fn a_small_picture_is_its_own_preview() {
        let image = Raster::eight(2, 1, 4, vec![1, 2, 3, 255, 9, 8, 7, 255]);
        assert_eq!(preview(&image), image);
    }

    #[test]
    fn a_wide_picture_keeps_its_shape_and_its_mean() {
        let image = Raster::sixteen(3000, 1500, 4, [20_000, 40_000, 60_000, 65_535].repeat(3000 * 1500));
        let small = preview(&image);
        assert_eq!((small.width, small.height), (1024, 512));
        assert!(eight(&small).chunks_exact(4).all(|pixel| pixel == [78, 156, 233, 255]));
    }

    #[test]
    fn transparent_pixels_lend_no_colour_to_the_rim() {
        // columns of opaque white and of transparent black in turn, halved: half transparent and still white
        let pair = [255, 255, 255, 255, 0, 0, 0, 0];
        let image = Raster::eight(2048, 1, 4, pair.repeat(1024));
        assert!(eight(&preview(&image)).chunks_exact(4).all(|pixel| pixel == [255, 255, 255, 128]));
    }
}
