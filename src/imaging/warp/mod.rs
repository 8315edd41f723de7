//! Resampling a slice onto the canvas of the reference slice.
//!
//! Cubic convolution with a = -1/2 (Keys 1981, also called Catmull-Rom): exact for quadratics, third-order
//! accurate, and much less blur than bilinear, which would make every warped slice look less sharp than the
//! reference slice and so bias the choice of the sharpest one. The position is projected exactly per pixel
//! and rounded to 1/1024 px (at most 0.0005 px wrong). Brightness is corrected in the same pass, so that a
//! sample is rounded once.
//!
//! Samples of 8 bits are weighted in whole numbers ([`fixed`]), those of 16 bits in floats ([`float`]).

mod fixed;
#[cfg(target_arch = "x86_64")]
mod fixed_avx2;
mod float;
#[cfg(target_arch = "x86_64")]
mod float_avx2;
#[cfg(target_arch = "x86_64")]
mod inside;

use std::ops::Range;

use rayon::prelude::*;

use super::{
    coverage::Coverage,
    sample::Sample,
    simd::{self, Avx2},
};
use crate::model::Homography;
use fixed::Fixed;
use float::Float;

const PHASE_BITS: u32 = 10;
const PHASES: usize = 1 << PHASE_BITS;
/// Pixels whose positions are projected in one go.
const BLOCK: usize = 64;
/// Rows that one thread takes at a time.
const BAND: usize = 16;

/// How one slice comes onto the canvas.
#[derive(Debug, Clone)]
pub struct Warp {
    to_slice: [f64; 9],
    gain: f32,
    identity: bool,
    slice: (usize, usize),
    coverage: Coverage,
    simd: Option<Avx2>,
}

impl Warp {
    /// A slice of `slice` (width, height) px, sent by `to_canvas` onto a `width` x `height` canvas, its
    /// samples multiplied by `gain`. `None` when the homography is singular.
    pub fn new(
        to_canvas: &Homography,
        gain: f64,
        slice: (usize, usize),
        (width, height): (usize, usize),
    ) -> Option<Self> {
        let stays = to_canvas.is_identity() && slice == (width, height);
        let to_slice = if stays { Homography::IDENTITY } else { to_canvas.inverse()? };
        let coverage =
            if stays { Coverage::full(width, height) } else { Coverage::of(&to_slice, slice, width, height) };
        let gain = gain as f32;
        Some(Self { to_slice: to_slice.0, gain, identity: stays && gain == 1.0, slice, coverage, simd: Avx2::detect() })
    }

    /// Which pixels of the canvas the slice covers.
    pub fn coverage(&self) -> &Coverage {
        &self.coverage
    }

    /// The warped samples, `channels` (1 or 3) interleaved; 0 where the slice does not cover the canvas.
    /// The identity with gain 1 gives the samples back untouched.
    ///
    /// # Panics
    /// When `samples` is not a slice of the size given to [`Warp::new`].
    pub fn apply<S: Sample>(&self, samples: Vec<S>, channels: usize) -> Vec<S> {
        match self.apply_unless(samples, channels, Vec::new(), || Ok::<(), std::convert::Infallible>(())) {
            Ok(warped) => warped,
            Err(never) => match never {},
        }
    }

    /// The same, into `buffer` if anything has to be computed, asking `check` every few rows whether the work is still
    /// wanted.
    ///
    /// # Errors
    /// What `check` says.
    ///
    /// # Panics
    /// As [`Warp::apply`].
    pub fn apply_unless<S: Sample, E: Send>(
        &self,
        samples: Vec<S>,
        channels: usize,
        buffer: Vec<S>,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Vec<S>, E> {
        assert_eq!(samples.len(), self.slice.0 * self.slice.1 * channels, "samples do not fit the slice");
        if self.identity {
            return Ok(samples);
        }
        match channels {
            1 => self.resample::<S, 1, E>(&samples, buffer, check),
            _ => self.resample::<S, 3, E>(&samples, buffer, check),
        }
    }

    fn resample<S: Sample, const C: usize, E: Send>(
        &self,
        samples: &[S],
        mut out: Vec<S>,
        check: impl Fn() -> Result<(), E> + Sync,
    ) -> Result<Vec<S>, E> {
        let (width, height) = (self.coverage.width(), self.coverage.height());
        out.resize(width * height * C, S::default());
        let source = Source::<S, C> { samples, width: self.slice.0, height: self.slice.1 };
        let weights = Weights::new::<S>(f64::from(self.gain), self.simd);
        out.par_chunks_mut((width * C * BAND).max(1)).enumerate().try_for_each(|(band, rows)| {
            check()?;
            for (row, out) in rows.chunks_mut(width * C).enumerate() {
                let y = band * BAND + row;
                let span = self.coverage.span(y);
                out[..span.start * C].fill(S::default());
                out[span.end * C..].fill(S::default());
                self.row(&source, &weights, y, span, out);
            }
            Ok(())
        })?;
        Ok(out)
    }

    fn row<S: Sample, const C: usize>(
        &self,
        source: &Source<'_, S, C>,
        weights: &Weights,
        y: usize,
        span: Range<usize>,
        out: &mut [S],
    ) {
        let (mut us, mut vs) = ([0i32; BLOCK], [0i32; BLOCK]);
        let mut start = span.start;
        while start < span.end {
            let count = BLOCK.min(span.end - start);
            simd::run(
                self.simd,
                #[inline(always)]
                || positions(&self.to_slice, start, y, &mut us, &mut vs),
            );
            weights.weigh(source, (&us[..count], &vs[..count]), &mut out[start * C..(start + count) * C]);
            start += count;
        }
    }
}

/// Where the pixels from (`x`, `y`) on come from, in 1/1024 px.
#[inline(always)]
fn positions(h: &[f64; 9], x: usize, y: usize, us: &mut [i32; BLOCK], vs: &mut [i32; BLOCK]) {
    /// 2^52: a number below 2^31 added to it is rounded to a whole number, which its low bits hold.
    const ROUNDER: f64 = 4_503_599_627_370_496.0;
    /// Far beyond any slice; beyond the span there may be anything.
    const FAR: f64 = 2_147_483_000.0;
    /// How much the scale may change within a block for the faster way: it errs by 2^-36 of the position.
    const NEARLY_EVEN: f64 = 1.0 / 256.0;
    let (x, y) = (x as f64, y as f64);
    let (row_u, row_v, row_w) = (h[1] * y + h[2], h[4] * y + h[5], h[7] * y + h[8]);
    // Within the span positions are not below -1e-6 px.
    let limited = |v: f64| {
        let v = if v > 0.0 { v } else { 0.0 };
        if v < FAR { v } else { FAR }
    };
    let middle = 1.0 / (h[6] * (x + 0.5 * BLOCK as f64) + row_w);
    if (h[6] * BLOCK as f64 * middle).abs() < NEARLY_EVEN {
        // Newton's method for the reciprocals: each of the two steps squares an error that is below 2^-9
        for (i, (u, v)) in us.iter_mut().zip(vs.iter_mut()).enumerate() {
            let x = x + f64::from(i as u32);
            let w = h[6] * x + row_w;
            let near = middle * (2.0 - w * middle);
            let scale = near * (2.0 - w * near) * PHASES as f64;
            *u = (limited((h[0] * x + row_u) * scale) + ROUNDER).to_bits() as i32;
            *v = (limited((h[3] * x + row_v) * scale) + ROUNDER).to_bits() as i32;
        }
    } else {
        for (i, (u, v)) in us.iter_mut().zip(vs.iter_mut()).enumerate() {
            let x = x + f64::from(i as u32);
            let scale = PHASES as f64 / (h[6] * x + row_w);
            *u = (limited((h[0] * x + row_u) * scale) + ROUNDER).to_bits() as i32;
            *v = (limited((h[3] * x + row_v) * scale) + ROUNDER).to_bits() as i32;
        }
    }
}

/// A slice to be sampled.
struct Source<'a, S, const C: usize> {
    samples: &'a [S],
    width: usize,
    height: usize,
}

/// How samples are weighted, for each phase between two pixels.
enum Weights {
    /// In whole numbers.
    Fixed(Fixed),
    /// In floats.
    Float(Float),
}

impl Weights {
    fn new<S: Sample>(gain: f64, simd: Option<Avx2>) -> Self {
        let fixed = if S::BYTES == 1 { Fixed::new(gain, simd) } else { None };
        fixed.map_or_else(|| Self::Float(Float::new(gain, simd)), Self::Fixed)
    }

    fn weigh<S: Sample, const C: usize>(&self, source: &Source<'_, S, C>, places: (&[i32], &[i32]), out: &mut [S]) {
        match self {
            Self::Float(float) => float.weigh(source, places, out),
            // made for samples of one byte alone
            Self::Fixed(fixed) => {
                let Source { samples, width, height } = *source;
                let bytes = Source::<u8, C> { samples: simd::bytes_of(samples), width, height };
                fixed.weigh(&bytes, places, simd::bytes_of_mut(out));
            }
        }
    }
}

impl<S: Sample, const C: usize> Source<'_, S, C> {
    /// The top left of the 4 x 4 pixels around (u, v), and whether all of them are in the slice.
    #[inline(always)]
    fn corner(&self, u: i32, v: i32) -> ([isize; 2], bool) {
        let (x, y) = ((u >> PHASE_BITS) as isize - 1, (v >> PHASE_BITS) as isize - 1);
        let inside = x >= 0 && y >= 0 && x as usize + 4 <= self.width && y as usize + 4 <= self.height;
        ([x, y], inside)
    }

    /// The pixel at (x, y), or the border's next to it.
    #[inline(always)]
    fn pixel(&self, x: isize, y: isize) -> &[S] {
        let row = y.clamp(0, self.height as isize - 1) as usize * self.width;
        let start = (row + x.clamp(0, self.width as isize - 1) as usize) * C;
        &self.samples[start..start + C]
    }
}

/// Keys' four weights for each phase between two pixels.
fn kernel() -> impl Iterator<Item = [f64; 4]> {
    (0..PHASES).map(|phase| {
        let t = phase as f64 / PHASES as f64;
        let near = |d: f64| (1.5 * d - 2.5) * d * d + 1.0;
        let far = |d: f64| ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0;
        [far(1.0 + t), near(t), near(1.0 - t), far(2.0 - t)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth picture given by a formula, so that the truth between pixels is known.
    fn picture(x: f64, y: f64) -> f64 {
        128.0 + 50.0 * (0.31 * x + 0.17 * y).sin() + 45.0 * (0.11 * x - 0.27 * y + 1.0).cos()
    }

    fn sampled(width: usize, height: usize) -> Vec<u16> {
        (0..width * height).map(|i| (picture((i % width) as f64, (i / width) as f64) * 257.0).round() as u16).collect()
    }

    fn keystone() -> Homography {
        Homography([1.03, 0.012, -2.3, -0.009, 1.021, 1.7, 6e-5, -4e-5, 1.0])
    }

    /// Root mean square error against the formula, in grey levels of 255, a margin from the border.
    fn error_of(value: impl Fn(f64, f64) -> f64, to_slice: &Homography, size: usize) -> (f64, f64) {
        let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
        for y in 12..size - 12 {
            for x in 12..size - 12 {
                let [u, v] = to_slice.apply([x as f64, y as f64]);
                if u < 4.0 || v < 4.0 || u > size as f64 - 5.0 || v > size as f64 - 5.0 {
                    continue;
                }
                let difference = value(x as f64, y as f64) - picture(u, v);
                squares += difference * difference;
                sum += difference;
                count += 1.0;
            }
        }
        (f64::sqrt(squares / count), sum / count)
    }

    #[test]
    fn a_warped_picture_is_close_to_its_formula_and_far_closer_than_bilinear() {
        let size = 160;
        let samples = sampled(size, size);
        let warp = Warp::new(&keystone(), 1.0, (size, size), (size, size)).unwrap();
        let to_slice = keystone().inverse().unwrap();
        let warped = warp.apply(samples.clone(), 1);
        let (cubic, bias) = error_of(|x, y| f64::from(warped[y as usize * size + x as usize]) / 257.0, &to_slice, size);
        let bilinear = |x: f64, y: f64| {
            let [u, v] = to_slice.apply([x, y]);
            let (i, j, s, t) = (u as usize, v as usize, u.fract(), v.fract());
            let at = |i: usize, j: usize| f64::from(samples[j * size + i]) / 257.0;
            (1.0 - t) * ((1.0 - s) * at(i, j) + s * at(i + 1, j))
                + t * ((1.0 - s) * at(i, j + 1) + s * at(i + 1, j + 1))
        };
        let (linear, _) = error_of(bilinear, &to_slice, size);
        assert!(cubic < 0.06, "rms {cubic}");
        assert!(bias.abs() < 0.01, "mean {bias}");
        assert!(cubic * 5.0 < linear, "cubic {cubic}, bilinear {linear}");
    }

    #[test]
    fn a_shift_by_part_of_a_pixel_moves_the_picture_by_just_that() {
        let size = 128;
        for shift in [0.25, 0.5, -0.37] {
            let to_canvas = Homography::similarity(1.0, [shift, -shift]);
            let warp = Warp::new(&to_canvas, 1.0, (size, size), (size, size)).unwrap();
            let warped = warp.apply(sampled(size, size), 1);
            // Least squares for the remaining shift: difference = -dx * gradient along x.
            let (mut top, mut bottom) = (0.0, 0.0);
            for y in 8..size - 8 {
                for x in 8..size - 8 {
                    let (u, v) = (x as f64 - shift, y as f64 + shift);
                    let slope = (picture(u + 0.01, v) - picture(u - 0.01, v)) / 0.02;
                    top += (f64::from(warped[y * size + x]) / 257.0 - picture(u, v)) * slope;
                    bottom += slope * slope;
                }
            }
            assert!((top / bottom).abs() < 0.002, "shift {shift} leaves {} px", top / bottom);
        }
    }

    #[test]
    fn the_identity_with_gain_one_copies_every_bit() {
        let samples: Vec<u8> = (0..30 * 20 * 3u32).map(|i| (i * 151 % 256) as u8).collect();
        let warp = Warp::new(&Homography::IDENTITY, 1.0, (30, 20), (30, 20)).unwrap();
        assert_eq!(warp.apply(samples.clone(), 3), samples);
        assert_eq!(*warp.coverage(), Coverage::full(30, 20));
    }

    #[test]
    fn whole_pixel_shifts_copy_samples_and_leave_zero_where_nothing_is_covered() {
        let samples: Vec<u8> = (0..30 * 20 * 3u32).map(|i| (1 + i * 151 % 255) as u8).collect();
        let to_canvas = Homography::similarity(1.0, [4.0, -3.0]);
        let warp = Warp::new(&to_canvas, 1.0, (30, 20), (30, 20)).unwrap();
        let warped = warp.apply(samples.clone(), 3);
        for y in 0..20 {
            for x in 0..30 {
                let pixel = &warped[(y * 30 + x) * 3..][..3];
                if x >= 4 && y + 3 < 20 {
                    assert_eq!(pixel, &samples[((y + 3) * 30 + x - 4) * 3..][..3]);
                } else {
                    assert_eq!(pixel, [0; 3]);
                }
            }
        }
    }

    #[test]
    fn the_gain_is_applied_once_rounded_once_and_clamped() {
        let warp = Warp::new(&Homography::IDENTITY, 1.3, (4, 1), (4, 1)).unwrap();
        assert_eq!(warp.apply(vec![0u8, 10, 101, 250], 1), [0, 13, 131, 255]);
    }

    #[test]
    fn a_constant_slice_stays_constant_under_any_homography() {
        let warp = Warp::new(&keystone(), 1.0, (64, 48), (64, 48)).unwrap();
        let warped = warp.apply(vec![255u8; 64 * 48 * 3], 3);
        for y in 0..48 {
            let span = warp.coverage().span(y);
            assert!(warped[(y * 64 + span.start) * 3..(y * 64 + span.end) * 3].iter().all(|&v| v == 255));
        }
    }

    #[test]
    fn vector_instructions_give_the_same_bits() {
        for ((width, height), gain) in [((5, 5), 1.0), ((37, 29), 0.7), ((130, 20), 1.9), ((131, 21), 4.0)] {
            let speckle: Vec<u16> = (0..width * height * 3).map(|i| (i * i * 97 + i * 40_503) as u16).collect();
            let eight: Vec<u8> = speckle.iter().map(|&v| v as u8).collect();
            let shrunk = Homography::similarity(0.6, [3.3, 1.1]);
            for to_canvas in [keystone(), shrunk, Homography::similarity(1.0, [0.5, -0.25])] {
                let best = Warp::new(&to_canvas, gain, (width, height), (width, height)).unwrap();
                let portable = Warp { simd: None, ..best.clone() };
                assert_eq!(best.apply(speckle.clone(), 3), portable.apply(speckle.clone(), 3));
                assert_eq!(best.apply(eight.clone(), 3), portable.apply(eight.clone(), 3));
                let grey = || eight[..width * height].to_vec();
                assert_eq!(best.apply(grey(), 1), portable.apply(grey(), 1));
            }
        }
    }

    #[test]
    fn eight_bits_are_weighted_as_well_as_floats_are() {
        let size = 160;
        let sixteen: Vec<u16> = sampled(size, size).iter().map(|&v| v / 257 * 257).collect();
        let eight: Vec<u8> = sixteen.iter().map(|&v| (v / 257) as u8).collect();
        for gain in [0.8, 1.0, 1.3] {
            let warp = Warp::new(&keystone(), gain, (size, size), (size, size)).unwrap();
            let (exact, fixed) = (warp.apply(sixteen.clone(), 1), warp.apply(eight.clone(), 1));
            for (exact, fixed) in exact.iter().zip(fixed) {
                let error = f64::from(fixed) - f64::from(*exact) / 257.0;
                assert!(error.abs() < 0.5 + 0.04, "{fixed} for {}", f64::from(*exact) / 257.0);
            }
        }
        // too large for 16 bits: floats
        let warp = Warp::new(&Homography::IDENTITY, 20.0, (4, 1), (4, 1)).unwrap();
        assert_eq!(warp.apply(vec![0u8, 1, 2, 200], 1), [0, 20, 40, 255]);
    }

    #[test]
    fn a_singular_homography_gives_no_warp() {
        let flat = Homography([1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        assert!(Warp::new(&flat, 1.0, (8, 8), (8, 8)).is_none());
    }
}
