//! A small picture for a page.

use pinstack_science::imaging::{Raster, Samples};

/// Longest side of a preview, px.
pub const MAX_SIDE: usize = 800;

/// What is seen through transparent pixels: a light grey, on which dark parts and white ones can be told from the ground.
const GROUND: u64 = 235;

/// An 8-bit RGB picture of at most [`MAX_SIDE`] columns and rows, laid over a light grey: each of its pixels is the mean of a
/// block, colours weighted by their alpha, so that what is transparent does not darken the rim of the object. `image` is RGBA.
pub fn preview(image: &Raster) -> Raster {
    match &image.samples {
        Samples::Eight(samples) => shrink(image, samples, |v| u32::from(v) * 257),
        Samples::Sixteen(samples) => shrink(image, samples, u32::from),
    }
}

/// `wide` brings a sample to 0..65535.
fn shrink<S: Copy>(image: &Raster, samples: &[S], wide: impl Fn(S) -> u32) -> Raster {
    let longest = image.width.max(image.height);
    let side = |length: usize| match longest {
        ..=MAX_SIDE => length,
        _ => ((length * MAX_SIDE + longest / 2) / longest).max(1),
    };
    let (width, height) = (side(image.width), side(image.height));
    let step = image.channels;
    let mut out = Vec::with_capacity(width * height * 3);
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
            // sums of alpha times colour, both 0..65535, over the most that they can be, and the rest is ground
            let most = count * 65_535 * 65_535;
            let ground = (count * 65_535 - alpha) * (GROUND * 257);
            out.extend([r, g, b].map(|sum| (((sum + ground) * 255 + most / 2) / most) as u8));
        }
    }
    Raster::eight(width, height, 3, out)
}

/// The source rows (columns) of row (column) `at` of `of`: never empty, and together all of `all`.
fn block(at: usize, of: usize, all: usize) -> std::ops::Range<usize> {
    let start = at * all / of;
    start..((at + 1) * all / of).max(start + 1)
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
        assert_eq!(eight(&preview(&image)), [1, 2, 3, 9, 8, 7]);
    }

    #[test]
    fn a_large_picture_keeps_its_shape_and_its_mean() {
        let image = Raster::sixteen(3000, 1500, 4, [20_000, 40_000, 60_000, 65_535].repeat(3000 * 1500));
        let small = preview(&image);
        assert_eq!((small.width, small.height, small.channels), (800, 400, 3));
        assert!(eight(&small).chunks_exact(3).all(|pixel| pixel == [78, 156, 233]));
    }

    #[test]
    fn no_side_is_longer_than_the_limit() {
        for (width, height, expected) in [(16, 65_535, (1, 800)), (65_535, 16, (800, 1)), (1600, 1600, (800, 800))] {
            let small = preview(&Raster::eight(width, height, 4, vec![7; width * height * 4]));
            assert_eq!((small.width, small.height), expected);
        }
    }

    #[test]
    fn transparent_pixels_show_the_ground_and_lend_no_colour() {
        // columns of opaque white and of transparent black in turn, halved: half white, half ground
        let pair = [255, 255, 255, 255, 0, 0, 0, 0];
        let image = Raster::eight(1600, 1, 4, pair.repeat(800));
        assert!(eight(&preview(&image)).iter().all(|&value| value == 245));
        let clear = Raster::eight(2, 2, 4, vec![0; 16]);
        assert!(eight(&preview(&clear)).iter().all(|&value| value == 235));
    }
}
