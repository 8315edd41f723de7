//! Level 0 of a slice around a tile, channel by channel; its reduction to level 1; and the range of the samples of all
//! slices.
//!
//! Sums are integers, so the result of a pixel does not depend on the rectangle that it is computed in.

use std::ops::Range;

use super::filter::{Level, Patch, WEIGHT, split};
use crate::{
    fusion::align::ScratchFile,
    imaging::{
        Coverage, Rect, Sample, Sum,
        simd::{self, Avx2},
    },
    types::Error,
};

/// The binomial kernel of 5 taps, in sixteenths.
const KERNEL: [u8; 5] = [1, 4, 6, 4, 1];

/// Zeros before and after a row.
const PAD: usize = 2;

/// Pixels that are de-interleaved at a time.
const PART: usize = 64;

/// The samples of a slice, one plane per channel; 0 where the slice covers nothing.
#[derive(Default)]
pub(super) struct FinestLevel<S: Sample> {
    pub planes: [Patch<S>; 3],
    interleaved: Vec<S>,
    bytes: Vec<u8>,
    line: Vec<S::Sum>,
    halves: [Vec<S::Sum>; 2],
}

impl<S: Sample> FinestLevel<S> {
    /// Reads `rect` of slice `slice`.
    pub(super) fn read<const C: usize>(
        &mut self,
        scratch: &ScratchFile,
        slice: usize,
        rect: Rect,
    ) -> Result<(), Error> {
        scratch.read(slice, rect, &mut self.interleaved, &mut self.bytes)?;
        for plane in &mut self.planes[..C] {
            plane.shape(rect, S::default());
        }
        let [first, second, third] = &mut self.planes;
        if C == 1 {
            first.data.copy_from_slice(&self.interleaved);
            return Ok(());
        }
        let pixels = &self.interleaved[..];
        simd::run(
            Avx2::detect(),
            #[inline(always)]
            || deinterleave(pixels, [&mut first.data, &mut second.data, &mut third.data]),
        );
        Ok(())
    }

    /// Reduces the slice to the pixels `rect` of level 1: values in grey levels of 255 times covered fraction, and
    /// covered fraction.
    pub(super) fn reduce<const C: usize>(
        &mut self,
        simd: Option<Avx2>,
        coverage: &Coverage,
        rect: Rect,
        out: &mut Level,
    ) {
        let source = self.planes[0].rect;
        // start of the five pixels of the first pixel, in the padded line
        let first = 2 * rect.x - source.x;
        let scale = 255.0 / S::DEPTH.max() / 256.0;
        let Self { planes, line, halves, .. } = self;
        line.clear();
        line.resize((source.width + 2 * PAD).max(first + 2 * rect.width + 4), S::Sum::default());
        let nothing = vec![S::default(); source.width];
        out.iter_mut().for_each(|plane| plane.shape(rect, 0.0));
        for y in rect.y..rect.y + rect.height {
            let rows = rows_around(y, source);
            for (plane, out) in planes[..C].iter().zip(&mut *out) {
                let taps = rows.map(|y| y.map_or(&nothing[..], |y| plane.row(y)));
                let out = out.row_mut(y);
                simd::run(
                    simd,
                    #[inline(always)]
                    || {
                        add_rows(&mut line[PAD..PAD + source.width], taps);
                        reduce_row(&line[first..], halves, scale, out);
                    },
                );
            }
        }
        self.reduce_coverage(simd, coverage, rect, &mut out[WEIGHT]);
    }

    /// The covered fraction of the kernel of each pixel of `rect`.
    fn reduce_coverage(&mut self, simd: Option<Avx2>, coverage: &Coverage, rect: Rect, out: &mut Patch<f32>) {
        let source = self.planes[0].rect;
        let first = 2 * rect.x - source.x;
        let Self { line, halves, .. } = self;
        line.fill(S::Sum::default());
        let mut last = None;
        for y in rect.y..rect.y + rect.height {
            let spans = rows_around(y, source).map(|y| y.map_or(0..0, |y| coverage.span_in(y, source)));
            if last.as_ref() == Some(&spans) {
                let above = (y - 1 - rect.y) * rect.width;
                out.data.copy_within(above..above + rect.width, above + rect.width);
                continue;
            }
            line[PAD..PAD + source.width].fill(S::Sum::default());
            for (span, weight) in spans.iter().zip(KERNEL) {
                let weight = S::Sum::from(weight);
                line[PAD + span.start..PAD + span.end].iter_mut().for_each(|covered| *covered += weight);
            }
            last = Some(spans);
            let row = out.row_mut(y);
            simd::run(
                simd,
                #[inline(always)]
                || reduce_row(&line[first..], halves, 1.0 / 256.0, row),
            );
        }
    }
}

/// The five rows that row `y` of level 1 is computed from; `None` for rows outside `source`.
fn rows_around(y: usize, source: Rect) -> [Option<usize>; 5] {
    let rows = source.y..source.y + source.height;
    std::array::from_fn(|tap| (2 * y + tap).checked_sub(2).filter(|y| rows.contains(y)))
}

/// Separates the channels of interleaved pixels.
#[inline(always)]
fn deinterleave<S: Sample>(pixels: &[S], [r, g, b]: [&mut [S]; 3]) {
    let parts =
        r.as_chunks_mut::<PART>().0.iter_mut().zip(g.as_chunks_mut::<PART>().0).zip(b.as_chunks_mut::<PART>().0);
    let mut done = 0;
    for (((r, g), b), pixels) in parts.zip(pixels.as_chunks::<{ 3 * PART }>().0) {
        for i in 0..PART {
            (r[i], g[i], b[i]) = (pixels[3 * i], pixels[3 * i + 1], pixels[3 * i + 2]);
        }
        done += PART;
    }
    for (((r, g), b), pixel) in r.iter_mut().zip(g).zip(b).zip(pixels.as_chunks::<3>().0).skip(done) {
        (*r, *g, *b) = (pixel[0], pixel[1], pixel[2]);
    }
}

/// The sum of five rows, weighted by [`KERNEL`].
#[inline(always)]
fn add_rows<S: Sample>(out: &mut [S::Sum], rows: [&[S]; 5]) {
    let count = out.len();
    let [a, b, c, d, e] = rows.map(|row| &row[..count]);
    let [four, six] = [4, 6].map(S::Sum::from);
    for x in 0..count {
        let [a, b, c, d, e] = [a[x], b[x], c[x], d[x], e[x]].map(S::Sum::from);
        out[x] = (a + e) + four * (b + d) + six * c;
    }
}

/// The weighted sum around every second pixel of a line, which begins two pixels before the first of them.
#[inline(always)]
fn reduce_row<N: Sum>(line: &[N], halves: &mut [Vec<N>; 2], scale: f32, out: &mut [f32]) {
    let count = out.len();
    split(&line[..2 * count + 4], halves);
    let [even, odd] = halves;
    let [a, c, e] = [0, 1, 2].map(|by| &even[by..by + count]);
    let [b, d] = [0, 1].map(|by| &odd[by..by + count]);
    let [four, six] = [4, 6].map(N::from);
    for x in 0..count {
        out[x] = ((a[x] + e[x]) + four * (b[x] + d[x]) + six * c[x]).value() * scale;
    }
}

/// The smallest and the largest sample of all slices per pixel of a rectangle, one plane per channel.
#[derive(Default)]
pub(super) struct SampleRange<S> {
    smallest: [Patch<S>; 3],
    largest: [Patch<S>; 3],
    line: Vec<S>,
}

impl<S: Sample> SampleRange<S> {
    /// Begins a tile: an empty range for each pixel of `rect`.
    pub(super) fn reset<const C: usize>(&mut self, rect: Rect) {
        self.smallest[..C].iter_mut().for_each(|plane| plane.reset(rect, S::rounded(S::DEPTH.max())));
        self.largest[..C].iter_mut().for_each(|plane| plane.reset(rect, S::default()));
    }

    /// Adds the samples of a slice where it covers the canvas.
    pub(super) fn add<const C: usize>(&mut self, slice: &FinestLevel<S>, coverage: &Coverage) {
        for ((samples, smallest), largest) in
            slice.planes[..C].iter().zip(&mut self.smallest[..C]).zip(&mut self.largest[..C])
        {
            let rect = smallest.rect;
            for y in rect.y..rect.y + rect.height {
                let part = coverage.span_in(y, rect);
                let from = samples.part(rect.x + part.start, y, part.len());
                let (smallest, largest) = (&mut smallest.row_mut(y)[part.clone()], &mut largest.row_mut(y)[part]);
                simd::run(
                    Avx2::detect(),
                    #[inline(always)]
                    || {
                        for ((smallest, largest), &sample) in smallest.iter_mut().zip(largest).zip(from) {
                            *smallest = sample.min(*smallest);
                            *largest = sample.max(*largest);
                        }
                    },
                );
            }
        }
    }

    /// Clamps `values`, the columns `columns` of row `y` of a channel in the scale of the samples, to the smallest and
    /// the largest sample in the 3 x 3 px around each pixel.
    pub(super) fn clamp(&mut self, channel: usize, y: usize, columns: &Range<usize>, values: &mut [f32]) {
        let Self { smallest, largest, line } = self;
        simd::run(
            Avx2::detect(),
            #[inline(always)]
            || {
                extreme_around(&smallest[channel], y, columns, line, |a, b| a.min(b));
                values.iter_mut().zip(&*line).for_each(|(value, smallest)| *value = value.max(smallest.value()));
                extreme_around(&largest[channel], y, columns, line, |a, b| a.max(b));
                values.iter_mut().zip(&*line).for_each(|(value, largest)| *value = value.min(largest.value()));
            },
        );
    }
}

/// Writes to `line`, for each of `columns`, the extreme (by `pick`) of the 3 x 3 px around it.
#[inline(always)]
fn extreme_around<S: Sample>(
    plane: &Patch<S>,
    y: usize,
    columns: &Range<usize>,
    line: &mut Vec<S>,
    pick: impl Fn(S, S) -> S,
) {
    let (rect, width) = (plane.rect, plane.rect.width);
    let rows = [y.saturating_sub(1).max(rect.y), y, (y + 1).min(rect.y + rect.height - 1)].map(|y| plane.row(y));
    line.clear();
    line.resize(width + 2, S::default());
    for (((out, &a), &b), &c) in line[1..].iter_mut().zip(rows[0]).zip(rows[1]).zip(rows[2]) {
        *out = pick(pick(a, b), c);
    }
    // border pixels are repeated
    (line[0], line[width + 1]) = (line[1], line[width]);
    for x in 0..width {
        line[x] = pick(pick(line[x], line[x + 1]), line[x + 2]);
    }
    line.copy_within(columns.start - rect.x..columns.end - rect.x, 0);
    line.truncate(columns.len());
}
