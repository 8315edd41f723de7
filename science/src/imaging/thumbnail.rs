//! Small copies of pictures. Three kernels, because they differ in cost and in what they keep:
//!
//! | function | output | each output pixel |
//! |---|---|---|
//! | [`luma`] | grey, 8 bits | mean luma of a square of pixels |
//! | [`sampled`] | as many channels as the input without alpha, 8 bits | mean of four pixels of a square: fast, for viewing |
//! | [`flattened`] | RGB, 8 bits | exact mean of a block, laid over grey where it is transparent |

use super::{Raster, Sample, Samples, grey};

/// The side of the squares that give a longer side of at most `max_side` px, or that of the largest square that fits
/// into the picture, px.
fn square_side(raster: &Raster, max_side: usize) -> usize {
    let (longer, shorter) = (raster.width.max(raster.height), raster.width.min(raster.height));
    longer.div_ceil(max_side.max(1)).min(shorter).max(1)
}

/// The luma of `raster` averaged over squares, so that the longer side has at most `max_side` px, unless the shorter
/// side has too few px for that: one channel of 8 bits. Pixels at the right and bottom that do not fill a square are
/// ignored.
///
/// # Example
/// ```
/// use pinstack_science::imaging::{Raster, thumbnail};
///
/// let picture = Raster::eight(4, 2, 1, vec![10, 30, 100, 100, 20, 40, 100, 100]);
/// assert_eq!(thumbnail::luma(&picture, 2), Raster::eight(2, 1, 1, vec![25, 100]));
/// ```
pub fn luma(raster: &Raster, max_side: usize) -> Raster {
    let step = square_side(raster, max_side);
    match &raster.samples {
        Samples::Eight(samples) => mean_luma(samples, raster, step),
        Samples::Sixteen(samples) => mean_luma(samples, raster, step),
    }
}

fn mean_luma<S: Sample>(samples: &[S], raster: &Raster, step: usize) -> Raster {
    let (width, height) = (raster.width / step, raster.height / step);
    let stride = raster.width * raster.channels;
    let mut luma = vec![0.0f32; raster.width];
    let mut out = Vec::with_capacity(width * height);
    for y in 0..height {
        let mut sums = vec![0.0f32; width];
        for row in y * step..(y + 1) * step {
            grey::luma_row(&samples[row * stride..(row + 1) * stride], raster.channels, &mut luma);
            for (sum, cell) in sums.iter_mut().zip(luma.chunks_exact(step)) {
                *sum += cell.iter().sum::<f32>();
            }
        }
        out.extend(sums.iter().map(|sum| u8::rounded(sum / (step * step) as f32)));
    }
    Raster::eight(width, height, 1, out)
}

/// `raster` at 8 bits, without alpha, with a longer side of at most `max_side` px, unless the shorter side has too few
/// px for that. Each pixel is the mean of four samples of its square, a quarter of the side away from the corners. That
/// is fast, and sufficient for viewing.
pub fn sampled(raster: &Raster, max_side: usize) -> Raster {
    let step = square_side(raster, max_side);
    let (width, height, channels) = (raster.width / step, raster.height / step, raster.channels.min(3));
    let (low, high) = (step / 4, step - 1 - step / 4);
    let value = |x: usize, y: usize, c: usize| -> u32 {
        let at = (y * raster.width + x) * raster.channels + c;
        match &raster.samples {
            Samples::Eight(s) => u32::from(s[at]),
            Samples::Sixteen(s) => u32::from(s[at] >> 8),
        }
    };
    let mut samples = Vec::with_capacity(width * height * channels);
    for y in 0..height {
        for x in 0..width {
            let corner = [x * step, y * step];
            for c in 0..channels {
                let sum: u32 = [(low, low), (high, low), (low, high), (high, high)]
                    .iter()
                    .map(|(dx, dy)| value(corner[0] + dx, corner[1] + dy, c))
                    .sum();
                samples.push(((sum + 2) / 4) as u8);
            }
        }
    }
    Raster::eight(width, height, channels, samples)
}

/// What shows through transparent pixels: a light grey that differs from both dark and white parts of an object.
const BACKGROUND: u64 = 235;

/// An RGB picture of 8 bits with sides of at most `max_side` px, laid over a light grey. Each pixel is the mean of a
/// block of `rgba`, with colours weighted by alpha, so that transparent pixels do not darken the rim of the object. The
/// blocks partition the picture; sums are exact integers.
///
/// # Panics
/// When `rgba` has fewer than four channels.
pub fn flattened(rgba: &Raster, max_side: usize) -> Raster {
    match &rgba.samples {
        Samples::Eight(samples) => block_means(rgba, samples, max_side),
        Samples::Sixteen(samples) => block_means(rgba, samples, max_side),
    }
}

fn block_means<S: Sample>(image: &Raster, samples: &[S], max_side: usize) -> Raster {
    let wide = |sample: S| u64::from(sample.integer() * S::TO_SIXTEEN);
    let longest = image.width.max(image.height);
    let side = |length: usize| match longest <= max_side {
        true => length,
        false => ((length * max_side + longest / 2) / longest).max(1),
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
                    let alpha = wide(pixel[3]);
                    for (sum, &sample) in sums.iter_mut().zip(&pixel[..3]) {
                        *sum += alpha * wide(sample);
                    }
                    sums[3] += alpha;
                }
            }
            let [r, g, b, alpha] = sums;
            let count = (rows.len() * columns.len()) as u64;
            // alpha times colour, each 0..=65535, summed; divided by its maximum, the rest is background
            let maximum = count * 65_535 * 65_535;
            let background = (count * 65_535 - alpha) * (BACKGROUND * 257);
            out.extend([r, g, b].map(|sum| (((sum + background) * 255 + maximum / 2) / maximum) as u8));
        }
    }
    Raster::eight(width, height, 3, out)
}

/// The source rows (columns) of row (column) `at` of `of`. Never empty; together they are all of `all`.
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
            Samples::Sixteen(_) => panic!("a thumbnail has 8 bits"),
        }
    }

    #[test]
    fn luma_is_averaged_over_squares_at_either_depth() {
        let eight: Vec<u8> = (0..7 * 5).map(|i| if i % 7 < 2 { 200 } else { 100 }).collect();
        let sixteen = eight.iter().map(|&v| u16::from(v) * 257).collect();
        for raster in [Raster::eight(7, 5, 1, eight.clone()), Raster::sixteen(7, 5, 1, sixteen)] {
            assert_eq!(luma(&raster, 4), Raster::eight(3, 2, 1, vec![200, 100, 100, 200, 100, 100]));
            assert_eq!(luma(&raster, 7), Raster::eight(7, 5, 1, eight.clone()));
        }
        assert_eq!(luma(&Raster::eight(9, 1, 1, vec![8; 9]), 2).height, 1);
    }

    #[test]
    fn a_sampled_thumbnail_follows_the_picture() {
        let raster = Raster::sixteen(3300, 20, 1, (0..66_000_u32).map(|k| ((k % 3300) * 16) as u16).collect());
        let small = sampled(&raster, 1600);
        assert_eq!((small.width, small.height, small.channels), (1100, 6, 1));
        for x in [10, 500, 1090] {
            let middle = ((3 * x + 1) * 16) >> 8;
            assert!((i64::from(eight(&small)[x]) - middle as i64).abs() <= 1, "{} for {middle}", eight(&small)[x]);
        }
    }

    #[test]
    fn a_long_narrow_picture_keeps_at_least_one_row_and_one_column() {
        for (width, height, max_side, expected) in
            [(800, 2, 200, (400, 1)), (2, 800, 200, (1, 400)), (9, 1, 2, (9, 1)), (4, 4, 0, (1, 1)), (6, 3, 0, (2, 1))]
        {
            let raster = Raster::eight(width, height, 3, vec![90; width * height * 3]);
            for small in [sampled(&raster, max_side), luma(&raster, max_side)] {
                assert_eq!((small.width, small.height), expected, "{width} x {height}, {max_side}");
                assert!(eight(&small).iter().all(|&value| value == 90), "{width} x {height}, {max_side}");
            }
        }
    }

    #[test]
    fn a_small_picture_is_flattened_at_its_own_size() {
        let image = Raster::eight(2, 1, 4, vec![1, 2, 3, 255, 9, 8, 7, 255]);
        assert_eq!(eight(&flattened(&image, 800)), [1, 2, 3, 9, 8, 7]);
    }

    #[test]
    fn a_large_picture_keeps_its_shape_and_its_mean() {
        let image = Raster::sixteen(3000, 1500, 4, [20_000, 40_000, 60_000, 65_535].repeat(3000 * 1500));
        let small = flattened(&image, 800);
        assert_eq!((small.width, small.height, small.channels), (800, 400, 3));
        assert!(eight(&small).chunks_exact(3).all(|pixel| pixel == [78, 156, 233]));
    }

    #[test]
    fn no_side_is_longer_than_the_limit() {
        for (width, height, expected) in [(16, 65_535, (1, 800)), (65_535, 16, (800, 1)), (1600, 1600, (800, 800))] {
            let small = flattened(&Raster::eight(width, height, 4, vec![7; width * height * 4]), 800);
            assert_eq!((small.width, small.height), expected);
        }
    }

    #[test]
    fn transparent_pixels_show_the_background_and_lend_no_colour() {
        // columns of opaque white and of transparent black in turn, halved: half white, half background
        let pair = [255, 255, 255, 255, 0, 0, 0, 0];
        let image = Raster::eight(1600, 1, 4, pair.repeat(800));
        assert!(eight(&flattened(&image, 800)).iter().all(|&value| value == 245));
        let clear = Raster::eight(2, 2, 4, vec![0; 16]);
        assert!(eight(&flattened(&clear, 800)).iter().all(|&value| value == 235));
    }
}
