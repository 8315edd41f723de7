//! The samples of a slice around a tile, channel by channel: its first halving, and the least and largest of all slices.
//!
//! Sums are whole numbers, so that no pixel knows what it was computed together with.

use std::ops::Range;

use super::filter::{Level, Patch, WEIGHT, split};
use crate::{
    fusion::align::ScratchFile,
    imaging::{
        Coverage, Rect, Sample,
        simd::{self, Avx2},
    },
    types::Error,
};

/// The kernel that levels are reduced with, in sixteenths.
const KERNEL: [i32; 5] = [1, 4, 6, 4, 1];

/// Pixels of nothing before and after a row.
const PAD: usize = 2;

/// Pixels whose channels are taken apart at a time.
const PART: usize = 64;

/// Samples of a slice, a plane per channel; 0 where it covers nothing.
#[derive(Default)]
pub(super) struct Finest<S> {
    pub planes: [Patch<S>; 3],
    interleaved: Vec<S>,
    bytes: Vec<u8>,
    line: Vec<i32>,
    halves: [Vec<i32>; 2],
}

impl<S: Sample> Finest<S> {
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
            || take_apart(pixels, [&mut first.data, &mut second.data, &mut third.data]),
        );
        Ok(())
    }

    /// The pixels `rect` of the next level, in grey levels of 255, and how much of what they are computed from is covered.
    pub(super) fn halve<const C: usize>(
        &mut self,
        simd: Option<Avx2>,
        coverage: &Coverage,
        rect: Rect,
        out: &mut Level,
    ) {
        let source = self.planes[0].rect;
        // where the first pixel's five begin, in the padded line
        let first = 2 * rect.x - source.x;
        let scale = 255.0 / S::DEPTH.max() / 256.0;
        let Self { planes, line, halves, .. } = self;
        line.clear();
        line.resize((source.width + 2 * PAD).max(first + 2 * rect.width + 4), 0);
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
                        halve_row(&line[first..], halves, scale, out);
                    },
                );
            }
        }
        self.halve_coverage(simd, coverage, rect, &mut out[WEIGHT]);
    }

    /// How much of what each pixel of `rect` is computed from is covered.
    fn halve_coverage(&mut self, simd: Option<Avx2>, coverage: &Coverage, rect: Rect, out: &mut Patch<f32>) {
        let source = self.planes[0].rect;
        let first = 2 * rect.x - source.x;
        let Self { line, halves, .. } = self;
        line.fill(0);
        let mut last = None;
        for y in rect.y..rect.y + rect.height {
            let spans = rows_around(y, source).map(|y| {
                let span = y.map_or(0..0, |y| coverage.span(y));
                let (start, end) = (span.start.max(source.x), span.end.min(source.x + source.width));
                if start < end { start - source.x..end - source.x } else { 0..0 }
            });
            if last.as_ref() == Some(&spans) {
                let above = (y - 1 - rect.y) * rect.width;
                out.data.copy_within(above..above + rect.width, above + rect.width);
                continue;
            }
            line[PAD..PAD + source.width].fill(0);
            for (span, weight) in spans.iter().zip(KERNEL) {
                line[PAD + span.start..PAD + span.end].iter_mut().for_each(|covered| *covered += weight);
            }
            last = Some(spans);
            let row = out.row_mut(y);
            simd::run(
                simd,
                #[inline(always)]
                || halve_row(&line[first..], halves, 1.0 / 256.0, row),
            );
        }
    }
}

/// The five rows that row `y` of the next level is computed from, as far as they are there.
fn rows_around(y: usize, source: Rect) -> [Option<usize>; 5] {
    let there = source.y..source.y + source.height;
    std::array::from_fn(|tap| (2 * y + tap).checked_sub(2).filter(|y| there.contains(y)))
}

#[inline(always)]
fn take_apart<S: Sample>(pixels: &[S], [r, g, b]: [&mut [S]; 3]) {
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

/// Five rows, weighted.
#[inline(always)]
fn add_rows<S: Sample>(out: &mut [i32], rows: [&[S]; 5]) {
    let count = out.len();
    let [a, b, c, d, e] = rows.map(|row| &row[..count]);
    for x in 0..count {
        let [a, b, c, d, e] = [a[x], b[x], c[x], d[x], e[x]].map(|sample| sample.integer() as i32);
        out[x] = (a + e) + 4 * (b + d) + 6 * c;
    }
}

/// Every other pixel of a line with its neighbours; the line begins two pixels before the first.
#[inline(always)]
fn halve_row(line: &[i32], halves: &mut [Vec<i32>; 2], scale: f32, out: &mut [f32]) {
    let count = out.len();
    split(&line[..2 * count + 4], halves);
    let [even, odd] = halves;
    let [a, c, e] = [0, 1, 2].map(|by| &even[by..by + count]);
    let [b, d] = [0, 1].map(|by| &odd[by..by + count]);
    for x in 0..count {
        out[x] = ((a[x] + e[x]) + 4 * (b[x] + d[x]) + 6 * c[x]) as f32 * scale;
    }
}

/// Least and largest samples of all slices in a rectangle, a plane per channel.
#[derive(Default)]
pub(super) struct Extremes<S> {
    least: [Patch<S>; 3],
    largest: [Patch<S>; 3],
    line: Vec<S>,
}

impl<S: Sample> Extremes<S> {
    /// Begins a tile: nothing is known of `rect`.
    pub(super) fn reset<const C: usize>(&mut self, rect: Rect) {
        self.least[..C].iter_mut().for_each(|plane| plane.reset(rect, S::rounded(S::DEPTH.max())));
        self.largest[..C].iter_mut().for_each(|plane| plane.reset(rect, S::default()));
    }

    /// Enters what a slice covers.
    pub(super) fn enter<const C: usize>(&mut self, slice: &Finest<S>, coverage: &Coverage) {
        for ((samples, least), largest) in
            slice.planes[..C].iter().zip(&mut self.least[..C]).zip(&mut self.largest[..C])
        {
            let rect = least.rect;
            for y in rect.y..rect.y + rect.height {
                let span = coverage.span(y);
                let (start, end) = (span.start.max(rect.x), span.end.min(rect.x + rect.width));
                if start >= end {
                    continue;
                }
                let from = samples.part(start, y, end - start);
                let part = start - rect.x..end - rect.x;
                let (least, largest) = (&mut least.row_mut(y)[part.clone()], &mut largest.row_mut(y)[part]);
                simd::run(
                    Avx2::detect(),
                    #[inline(always)]
                    || {
                        for ((least, largest), &sample) in least.iter_mut().zip(largest).zip(from) {
                            *least = sample.min(*least);
                            *largest = sample.max(*largest);
                        }
                    },
                );
            }
        }
    }

    /// Brings `values`, the columns `columns` of row `y` of a channel in the scale of the samples, between the least and the
    /// largest sample of each pixel and those that touch it.
    pub(super) fn clamp(&mut self, channel: usize, y: usize, columns: &Range<usize>, values: &mut [f32]) {
        let Self { least, largest, line } = self;
        simd::run(
            Avx2::detect(),
            #[inline(always)]
            || {
                outermost(&least[channel], y, columns, line, |a, b| a.min(b));
                values.iter_mut().zip(&*line).for_each(|(value, least)| *value = value.max(least.value()));
                outermost(&largest[channel], y, columns, line, |a, b| a.max(b));
                values.iter_mut().zip(&*line).for_each(|(value, largest)| *value = value.min(largest.value()));
            },
        );
    }
}

/// The outermost of three rows and three neighbours, for each of `columns`, into `line`.
#[inline(always)]
fn outermost<S: Sample>(
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
    // the outer pixels are repeated
    (line[0], line[width + 1]) = (line[1], line[width]);
    for x in 0..width {
        line[x] = pick(pick(line[x], line[x + 1]), line[x + 2]);
    }
    line.copy_within(columns.start - rect.x..columns.end - rect.x, 0);
    line.truncate(columns.len());
}
