//! The focus measure of guided filtering fusion (Li, Kang & Hu 2013): `|Laplacian|`, smoothed by a Gaussian.

use super::laplacian::{laplacian, repeat_border};
use crate::imaging::simd::{self, Avx2};

/// The saliency with a given Gaussian.
#[derive(Debug, Clone)]
pub struct Saliency {
    /// Half of the symmetric kernel: `weights[d]` is the weight at distance `d` px.
    weights: Vec<f32>,
    simd: Option<Avx2>,
}

/// Buffers of [`Saliency::rows`]: rows that several output rows need.
#[derive(Debug, Default)]
pub struct Rows {
    /// Luma: the rows that the Laplacian needs, and those whose saliency is pending.
    grey: Vec<f32>,
    /// One row of the Laplacian, with its border repeated.
    padded: Vec<f32>,
    /// Laplacian smoothed along x: the rows that the Gaussian needs.
    blurred: Vec<f32>,
    out: Vec<f32>,
}

impl Saliency {
    /// A Gaussian of `2 * radius + 1` taps and standard deviation `sigma` px, normalised to a sum of 1.
    pub fn new(radius: usize, sigma: f64) -> Self {
        let half: Vec<f64> = (0..=radius).map(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp()).collect();
        let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
        Self { weights: half.iter().map(|w| (w / sum) as f32).collect(), simd: Avx2::detect() }
    }

    /// Radius of the support: that of the Gaussian and one pixel for the Laplacian.
    pub fn reach(&self) -> usize {
        self.weights.len()
    }

    /// The saliency of the rows `rows` of a `width` x `height` image. `luma(y, out)` fills `out` with row `y` of the
    /// luma; `emit(y, luma, saliency)` receives the rows in ascending order. Beyond the image its border is repeated,
    /// for the Laplacian (kernel `[0 1 0; 1 -4 1; 0 1 0]`) and for the Gaussian.
    ///
    /// The result of a row does not depend on `rows`.
    pub fn rows(
        &self,
        (width, height): (usize, usize),
        rows: std::ops::Range<usize>,
        buffers: &mut Rows,
        mut luma: impl FnMut(usize, &mut [f32]),
        mut emit: impl FnMut(usize, &[f32], &[f32]),
    ) {
        if width == 0 || rows.is_empty() {
            return;
        }
        let (radius, last) = (self.weights.len() - 1, height - 1);
        let Rows { grey, padded, blurred, out } = buffers;
        // ring buffers: row y is at index y modulo their length
        let (greys, blurs) = (radius + 3, 2 * radius + 1);
        grey.resize(greys * width, 0.0);
        blurred.resize(blurs * width, 0.0);
        padded.resize(width + 2 * radius, 0.0);
        out.resize(width, 0.0);
        let grey_at = |y: usize| y % greys * width..y % greys * width + width;
        let blur_at = |y: usize| y % blurs * width..y % blurs * width + width;

        let mut next_blur = rows.start.saturating_sub(radius);
        let mut next_grey = next_blur.saturating_sub(1);
        for y in rows {
            while next_blur <= (y + radius).min(last) {
                while next_grey <= (next_blur + 1).min(last) {
                    luma(next_grey, &mut grey[grey_at(next_grey)]);
                    next_grey += 1;
                }
                let around = [next_blur.saturating_sub(1), next_blur, (next_blur + 1).min(last)];
                let around = around.map(|y| &grey[grey_at(y)]);
                simd::run(
                    self.simd,
                    #[inline(always)]
                    || laplacian(around, &mut padded[radius..radius + width], f32::abs),
                );
                repeat_border(padded, radius..radius + width);
                let taps = |d: isize| &padded[radius.wrapping_add_signed(d)..][..width];
                self.smooth(taps, &mut blurred[blur_at(next_blur)]);
                next_blur += 1;
            }
            let taps = |d: isize| &blurred[blur_at(y.saturating_add_signed(d).min(last))];
            self.smooth(taps, out);
            emit(y, &grey[grey_at(y)], out);
        }
    }

    /// The weighted sum of the rows `taps(-radius)..=taps(radius)`, neighbours added in pairs.
    fn smooth<'a>(&self, taps: impl Fn(isize) -> &'a [f32], out: &mut [f32]) {
        match <&[f32; 6]>::try_from(self.weights.as_slice()) {
            Ok(weights) => {
                let pairs = std::array::from_fn(|d| [taps(-(d as isize)), taps(d as isize)]);
                simd::run(
                    self.simd,
                    #[inline(always)]
                    || smooth_by_six(weights, pairs, out),
                );
            }
            Err(_) => {
                weighted(out, taps(0), self.weights[0]);
                for (d, &weight) in self.weights.iter().enumerate().skip(1) {
                    add_pair(out, taps(-(d as isize)), taps(d as isize), weight);
                }
            }
        }
    }
}

/// The default kernel of 11 taps, unrolled. The order of the additions is the same as for other kernels.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn smooth_by_six(weights: &[f32; 6], taps: [[&[f32]; 2]; 6], out: &mut [f32]) {
    let count = out.len();
    let taps = taps.map(|pair| pair.map(|row| &row[..count]));
    for x in 0..count {
        let mut sum = weights[0] * taps[0][0][x];
        for d in 1..6 {
            sum += weights[d] * (taps[d][0][x] + taps[d][1][x]);
        }
        out[x] = sum;
    }
}

fn weighted(out: &mut [f32], values: &[f32], weight: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out = weight * value;
    }
}

fn add_pair(out: &mut [f32], one: &[f32], other: &[f32], weight: f32) {
    for ((out, one), other) in out.iter_mut().zip(one).zip(other) {
        *out += weight * (one + other);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Plane;

    fn speckle(x: usize, y: usize) -> f32 {
        ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32
    }

    fn all_rows(picture: &Plane<f32>, saliency: &Saliency, band: usize) -> Plane<f32> {
        let mut out = Plane::filled(picture.width, picture.height, 0.0);
        let mut buffers = Rows::default();
        let size = (picture.width, picture.height);
        for start in (0..picture.height).step_by(band) {
            let rows = start..(start + band).min(picture.height);
            let luma = |y: usize, row: &mut [f32]| row.copy_from_slice(picture.row(y));
            saliency.rows(size, rows, &mut buffers, luma, |y, _, values| out.row_mut(y).copy_from_slice(values));
        }
        out
    }

    #[test]
    fn it_is_the_smoothed_absolute_laplacian_with_repeated_borders() {
        let picture = Plane::from_fn(23, 17, speckle);
        let clamp = |v: i64, n: usize| v.clamp(0, n as i64 - 1) as usize;
        let at = |x: i64, y: i64| f64::from(picture.at(clamp(x, 23), clamp(y, 17)));
        let lap = |x: i64, y: i64| {
            let (x, y) = (clamp(x, 23) as i64, clamp(y, 17) as i64);
            (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1) - 4.0 * at(x, y)).abs()
        };
        let weight = |d: i64| (-(d * d) as f64 / 50.0).exp();
        let norm: f64 = (-5..=5).map(weight).sum();
        let result = all_rows(&picture, &Saliency::new(5, 5.0), 17);
        for y in 0..17i64 {
            for x in 0..23i64 {
                let mut expected = 0.0;
                for dy in -5..=5 {
                    for dx in -5..=5 {
                        expected += weight(dx) * weight(dy) / (norm * norm) * lap(x + dx, y + dy);
                    }
                }
                let got = f64::from(result.at(x as usize, y as usize));
                assert!((got - expected).abs() < 1e-3, "at {x}, {y}: {got} instead of {expected}");
            }
        }
    }

    #[test]
    fn rows_do_not_depend_on_the_band_they_are_computed_in() {
        let picture = Plane::from_fn(40, 50, speckle);
        let saliency = Saliency::new(5, 5.0);
        let whole = all_rows(&picture, &saliency, 50);
        assert_eq!(all_rows(&picture, &saliency, 7), whole);
        assert_eq!(all_rows(&picture, &saliency, 1), whole);
    }

    #[test]
    fn vector_instructions_give_the_same_bits() {
        for (width, height) in [(1, 1), (3, 40), (37, 21), (64, 9)] {
            let picture = Plane::from_fn(width, height, speckle);
            for radius in [5, 2] {
                let best = Saliency::new(radius, 5.0);
                let portable = Saliency { simd: None, ..best.clone() };
                assert_eq!(all_rows(&picture, &best, 8), all_rows(&picture, &portable, 8));
            }
        }
    }

    #[test]
    fn a_flat_picture_has_none_at_all() {
        let flat = all_rows(&Plane::filled(20, 20, 77.77), &Saliency::new(5, 5.0), 20);
        assert!(flat.data.iter().all(|&v| v == 0.0));
    }

    #[test]
    fn pictures_smaller_than_the_kernel_are_fine() {
        for (width, height) in [(1, 1), (1, 7), (2, 2), (5, 1)] {
            let picture = Plane::from_fn(width, height, speckle);
            assert!(all_rows(&picture, &Saliency::new(5, 5.0), 3).data.iter().all(|v| v.is_finite()));
        }
    }
}
