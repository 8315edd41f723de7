//! Resampling of a slice to the canvas of the reference slice.
//!
//! In: the samples of a slice, its homography to the canvas, its gain. Out: the warped samples, and their [`Coverage`].
//!
//! The kernel is cubic convolution with a = -1/2 (Keys 1981, also called Catmull-Rom). It is exact for quadratics and
//! third-order accurate. Bilinear interpolation blurs much more: every warped slice would look less sharp than the
//! reference slice, which biases the choice of the sharpest slice. The source position is projected exactly per pixel
//! and rounded to 1/1024 px (error at most 0.0005 px). The gain is applied in the same pass, so each sample is rounded
//! once.
//!
//! 8-bit samples are weighted in fixed point ([`fixed`]), 16-bit samples in floating point ([`float`]).

mod colours;
mod distorted;
mod fixed;
#[cfg(target_arch = "x86_64")]
mod fixed_avx2;
#[cfg(target_arch = "x86_64")]
mod fixed_avx2_grey;
mod fixed_weights;
mod float;
#[cfg(target_arch = "x86_64")]
mod float_avx2;
#[cfg(target_arch = "x86_64")]
mod inside;
mod parts;

use std::ops::Range;

use rayon::prelude::*;

use super::{
    coverage::Coverage,
    mapping::SliceMapping,
    sample::Sample,
    simd::{self, Avx2},
};
use crate::types::{Homography, distortion::Distortion, lateral_colour::LateralColour};
use colours::ColourPosition;
use fixed_weights::Fixed;
use float::Float;
use parts::{BLOCK, PHASES, Source};

/// Least number of rows per task of a thread.
const BAND: usize = 16;

/// The mapping of one slice to the canvas.
#[derive(Debug, Clone)]
pub struct Warp {
    to_slice: [f64; 9],
    gain: f32,
    identity: bool,
    slice: (usize, usize),
    coverage: Coverage,
    simd: Option<Avx2>,
    /// Replaces `to_slice` where there is lens distortion.
    distorted: Option<SliceMapping>,
    /// Red and blue of slices with three channels, where the lens has lateral colour.
    colours: Option<[ColourPosition; 2]>,
}

impl Warp {
    /// The warp of a slice of `slice` = (width, height) px to a `width` x `height` canvas by `to_canvas` (slice pixels
    /// to canvas pixels), with its samples multiplied by `gain`. `None` when the homography is singular, or the gain is
    /// not positive and finite.
    pub fn new(
        to_canvas: &Homography,
        gain: f64,
        slice: (usize, usize),
        (width, height): (usize, usize),
    ) -> Option<Self> {
        let gain = gain as f32;
        if !(gain.is_finite() && gain > 0.0) {
            return None;
        }
        let stays = to_canvas.is_identity() && slice == (width, height);
        let to_slice = if stays { Homography::IDENTITY } else { to_canvas.inverse()? };
        let coverage =
            if stays { Coverage::full(width, height) } else { Coverage::of(&to_slice, slice, width, height) };
        Some(Self {
            to_slice: to_slice.0,
            gain,
            identity: stays && gain == 1.0,
            slice,
            coverage,
            simd: Avx2::detect(),
            distorted: None,
            colours: None,
        })
    }

    /// Like [`Warp::new`], for slices with lens distortion: `to_canvas` maps ideal pixels of the slice to ideal pixels
    /// of the canvas, which has the size of the slice and keeps the distortion. `None` also when the distortion is not
    /// valid for the slice ([`Distortion::violation`]).
    pub fn with_distortion(
        to_canvas: &Homography,
        gain: f64,
        slice: (usize, usize),
        distortion: Option<&Distortion>,
    ) -> Option<Self> {
        let plain = Self::new(to_canvas, gain, slice, slice)?;
        let Some(distortion) = distortion else { return Some(plain) };
        if distortion.violation(slice.0 as u32, slice.1 as u32).is_some() {
            return None;
        }
        // without a homography the two distortions cancel
        if to_canvas.is_identity() {
            return Some(plain);
        }
        let mapping = SliceMapping::new(to_canvas.inverse()?, *distortion, slice);
        let coverage = Coverage::of_mapping(&mapping, slice);
        Some(Self { coverage, distorted: Some(mapping), ..plain })
    }

    /// The same warp for a lens with lateral colour: red and blue of a pixel are taken from where the lens images them.
    /// The coverage stays that of green: where red or blue of a pixel is outside the slice, they are those of the
    /// nearest pixel of its border. `None` when the lateral colour is not valid ([`LateralColour::violation`]).
    pub fn with_lateral_colour(self, colours: Option<&LateralColour>) -> Option<Self> {
        let Some(colours) = colours else { return Some(self) };
        if colours.violation().is_some() {
            return None;
        }
        Some(Self { colours: Some(ColourPosition::of(colours, self.slice)), ..self })
    }

    /// The same warp without vector instructions. It gives the same bits; tests compare the two.
    #[must_use]
    pub fn portable(self) -> Self {
        Self { simd: None, ..self }
    }

    /// Which pixels of the canvas the slice covers.
    pub fn coverage(&self) -> &Coverage {
        &self.coverage
    }

    /// The warped samples, with `channels` (1 or 3) interleaved, and 0 where the slice does not cover the canvas. The
    /// identity with gain 1 returns the samples unchanged.
    ///
    /// # Panics
    /// When the number of samples does not match the slice size of [`Warp::new`].
    ///
    /// # Example
    /// ```
    /// use pinstack_science::{imaging::warp::Warp, types::Homography};
    ///
    /// // a slice of 8 x 8 px that lies one pixel too far to the left
    /// let samples: Vec<u8> = (0..64).map(|i| 10 * (i % 8)).collect();
    /// let warp = Warp::new(&Homography::similarity(1.0, [1.0, 0.0]), 1.0, (8, 8), (8, 8)).expect("not singular");
    /// assert_eq!(warp.apply(samples, 1)[..8], [0, 0, 10, 20, 30, 40, 50, 60]);
    /// assert_eq!(warp.coverage().span(0), 1..8);
    /// ```
    pub fn apply<S: Sample>(&self, samples: Vec<S>, channels: usize) -> Vec<S> {
        match channels {
            1 => self.rows::<S, 1>(&samples).all(),
            _ => self.rows::<S, 3>(&samples).all(),
        }
    }

    /// The rows of the warped slice with `C` (1 or 3) channels; they are computed when they are asked for.
    ///
    /// # Panics
    /// As [`Warp::apply`].
    pub fn rows<'a, S: Sample, const C: usize>(&'a self, samples: &'a [S]) -> WarpedRows<'a, S, C> {
        let (width, height) = self.slice;
        assert_eq!(samples.len(), width * height * C, "the number of samples does not match the slice");
        WarpedRows {
            warp: self,
            copies: self.identity && (self.colours.is_none() || C == 1),
            source: Source { samples, width, height },
            weights: Weights::new::<S>(f64::from(self.gain), self.simd),
        }
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
            match &self.distorted {
                None => simd::run(
                    self.simd,
                    #[inline(always)]
                    || positions(&self.to_slice, start, y, &mut us, &mut vs),
                ),
                Some(mapping) => {
                    let curves = mapping.row(start, start + count - 1, y);
                    simd::run(
                        self.simd,
                        #[inline(always)]
                        || distorted::positions(&curves, count, &mut us, &mut vs),
                    );
                }
            }
            let out = &mut out[start * C..(start + count) * C];
            weights.weigh(source, (&us[..count], &vs[..count]), out);
            if let Some(colours) = self.colours.as_ref().filter(|_| C == 3) {
                for colour in colours {
                    let [us, vs] = colour.positions([&us, &vs]);
                    let mut displaced = [S::default(); 3 * BLOCK];
                    let displaced = &mut displaced[..out.len()];
                    weights.weigh(source, (&us[..count], &vs[..count]), displaced);
                    for (out, from) in out.chunks_exact_mut(C).zip(displaced.chunks_exact(C)) {
                        out[colour.channel] = from[colour.channel];
                    }
                }
            }
            start += count;
        }
    }
}

/// The rows of a warped slice: see [`Warp::rows`].
pub struct WarpedRows<'a, S, const C: usize> {
    warp: &'a Warp,
    /// Whether the slice is copied as it is.
    copies: bool,
    source: Source<'a, S, C>,
    weights: Weights,
}

impl<S: Sample, const C: usize> WarpedRows<'_, S, C> {
    /// Computes row `y` of the canvas: interleaved samples, 0 where the slice does not cover the canvas.
    ///
    /// # Panics
    /// When `y` is beyond the canvas, or the length of `out` is not that of a row.
    pub fn row(&self, y: usize, out: &mut [S]) {
        if self.copies {
            out.copy_from_slice(&self.source.samples[y * out.len()..(y + 1) * out.len()]);
            return;
        }
        let span = self.warp.coverage.span(y);
        out[..span.start * C].fill(S::default());
        out[span.end * C..].fill(S::default());
        self.warp.row(&self.source, &self.weights, y, span, out);
    }

    /// All rows, computed in parallel.
    fn all(&self) -> Vec<S> {
        let (width, height) = (self.warp.coverage.width(), self.warp.coverage.height());
        let mut out = vec![S::default(); width * height * C];
        out.par_chunks_mut((width * C).max(1)).with_min_len(BAND).enumerate().for_each(|(y, row)| self.row(y, row));
        out
    }
}

/// The source positions of the pixels starting at (`x`, `y`), in 1/1024 px.
#[inline(always)]
fn positions(h: &[f64; 9], x: usize, y: usize, us: &mut [i32; BLOCK], vs: &mut [i32; BLOCK]) {
    /// 2^52. Adding this to a number below 2^31 rounds it to an integer, which is in the low bits of the sum.
    const ROUNDER: f64 = 4_503_599_627_370_496.0;
    /// Limit far beyond any slice: positions outside the span may be arbitrary.
    const FAR: f64 = 2_147_483_000.0;
    /// Maximum change of the scale within a block for the fast path, whose error is 2^-36 of the position.
    const NEARLY_EVEN: f64 = 1.0 / 256.0;
    let (x, y) = (x as f64, y as f64);
    let (row_u, row_v, row_w) = (h[1] * y + h[2], h[4] * y + h[5], h[7] * y + h[8]);
    // within the span no position is below -1e-6 px
    let limited = |v: f64| {
        let v = if v > 0.0 { v } else { 0.0 };
        if v < FAR { v } else { FAR }
    };
    let middle = 1.0 / (h[6] * (x + 0.5 * BLOCK as f64) + row_w);
    if (h[6] * BLOCK as f64 * middle).abs() < NEARLY_EVEN {
        // two Newton steps for the reciprocal: each squares an error that is below 2^-9
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

/// Kernel weights for each phase between two pixels.
enum Weights {
    /// Fixed point.
    Fixed(Fixed),
    /// Floating point.
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
            // only constructed for samples of one byte
            Self::Fixed(fixed) => {
                let Source { samples, width, height } = *source;
                let bytes = Source::<u8, C> { samples: simd::bytes_of(samples), width, height };
                fixed.weigh(&bytes, places, simd::bytes_of_mut(out));
            }
        }
    }
}

#[cfg(test)]
mod tests;
