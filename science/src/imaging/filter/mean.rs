//! The mean filter of the base layer: square windows, only valid pixels, border repeated.
//!
//! Box sums by sliding column sums. The filter has its own kernel: it counts valid pixels per window and adds samples
//! of either depth directly, which a box sum over a plane of integers would have to copy first.

use std::ops::Range;

use crate::imaging::{
    Rect, Sample,
    simd::{self, Avx2},
};

/// A mean filter with its buffers.
#[derive(Debug)]
pub struct MeanFilter {
    simd: Option<Avx2>,
    radius: usize,
    /// Column sums, for the columns of `inner` and `radius` more on both sides.
    columns: Vec<u32>,
    running: Vec<u32>,
    counts: Vec<u32>,
    running_counts: Vec<u32>,
    /// 1 / number of valid pixels, per sample.
    shares: Vec<f32>,
}

/// The columns that the sums cover.
#[derive(Debug, Clone, Copy)]
struct Columns {
    /// First column inside the image.
    first: usize,
    /// Number of columns inside the image.
    count: usize,
    /// Number of repeated border columns to the left.
    left: usize,
    /// Number of columns including the repeated ones.
    length: usize,
}

impl MeanFilter {
    /// Windows of `side` x `side` px; `side` is odd, at most 255.
    pub fn new(side: usize) -> Self {
        Self::with(Avx2::detect(), side)
    }

    fn with(simd: Option<Avx2>, side: usize) -> Self {
        let (columns, running, counts, running_counts) = Default::default();
        Self { simd, radius: side / 2, columns, running, counts, running_counts, shares: Vec::new() }
    }

    /// Radius of the window, px.
    pub fn reach(&self) -> usize {
        self.radius
    }

    /// The means at the pixels of `inner`, interleaved, row-major.
    ///
    /// `pixels` holds `valid.len()` rows of `width` pixels of `C` interleaved samples; `valid` are the valid columns of
    /// each row. Beyond the edges of `pixels` the border pixel is repeated, with its validity: where the image
    /// continues, pass [`MeanFilter::reach`] px more around `inner`. Sums are exact. A window without valid pixels
    /// gives 0.
    pub fn apply<S: Sample, const C: usize>(
        &mut self,
        pixels: &[S],
        width: usize,
        valid: &[Range<usize>],
        inner: Rect,
        out: &mut [f32],
    ) {
        let mut rows = self.rows::<S, C>(pixels, width, valid, inner);
        for out in out.chunks_exact_mut((inner.width * C).max(1)) {
            rows.next(out);
        }
    }

    /// The same row by row, for callers that process each row while it is in the cache.
    pub fn rows<'a, S: Sample, const C: usize>(
        &'a mut self,
        pixels: &'a [S],
        width: usize,
        valid: &'a [Range<usize>],
        inner: Rect,
    ) -> MeanRows<'a, S, C> {
        let (radius, side, height) = (self.radius, 2 * self.radius + 1, valid.len());
        let taps = inner.grown(radius, width, height);
        let length = inner.width + 2 * radius;
        let columns = Columns { first: taps.x, count: taps.width, left: radius - (inner.x - taps.x), length };
        let covers = |span: &Range<usize>| span.start <= taps.x && span.end >= taps.x + taps.width;
        let whole = valid[taps.y..taps.y + taps.height].iter().all(covers);
        for (sums, length) in [(&mut self.columns, length * C), (&mut self.counts, length)] {
            sums.clear();
            sums.resize(length, 0);
        }
        self.running.resize(length * C + C, 0);
        self.running_counts.resize(length + 1, 0);
        self.shares.clear();
        self.shares.resize(inner.width * C, 1.0 / (side * side) as f32);
        let picture = Picture { pixels, width, valid };
        MeanRows { filter: self, picture, columns, whole, next: inner.y, held: false, end: inner.y + inner.height }
    }

    /// Adds a row to the column sums and removes another.
    fn exchange<S: Sample, const C: usize>(
        &mut self,
        picture: &Picture<'_, S>,
        columns: Columns,
        enters: Option<usize>,
        leaves: Option<usize>,
    ) {
        if enters == leaves {
            return;
        }
        let simd = self.simd;
        let end = columns.first + columns.count;
        let mut row = |y: usize| {
            let span = &picture.valid[y];
            let span = span.start.clamp(columns.first, end)..span.end.clamp(columns.first, end);
            let samples = &picture.pixels[(y * picture.width + span.start) * C..(y * picture.width + span.end) * C];
            let to = span.start - columns.first + columns.left..span.end - columns.first + columns.left;
            (to, samples)
        };
        match (enters.map(&mut row), leaves.map(&mut row)) {
            // the counts do not change
            (Some((to, enters)), Some((from, leaves))) if to == from => {
                let sums = &mut self.columns[to.start * C..to.end * C];
                simd::run(
                    simd,
                    #[inline(always)]
                    || exchanged(sums, enters, leaves),
                );
            }
            (enters, leaves) => {
                if let Some((to, samples)) = enters {
                    self.counts[to.clone()].iter_mut().for_each(|count| *count += 1);
                    let sums = self.columns[to.start * C..to.end * C].iter_mut();
                    sums.zip(samples).for_each(|(sum, sample)| *sum += sample.integer());
                }
                if let Some((from, samples)) = leaves {
                    self.counts[from.clone()].iter_mut().for_each(|count| *count -= 1);
                    let sums = self.columns[from.start * C..from.end * C].iter_mut();
                    sums.zip(samples).for_each(|(sum, sample)| *sum -= sample.integer());
                }
            }
        }
    }

    /// Copies the outermost columns of the image to the columns beyond it.
    fn repeat_border<const C: usize>(&mut self, Columns { count, left, length, .. }: Columns) {
        for x in (0..left).chain(left + count..length) {
            let of = x.clamp(left, left + count - 1);
            self.columns.copy_within(of * C..(of + 1) * C, x * C);
            self.counts[x] = self.counts[of];
        }
    }
}

/// Iterator-like source of the rows of means, from the top down.
#[derive(Debug)]
pub struct MeanRows<'a, S, const C: usize> {
    filter: &'a mut MeanFilter,
    picture: Picture<'a, S>,
    columns: Columns,
    whole: bool,
    next: usize,
    /// True when the column sums are those of the previous row.
    held: bool,
    end: usize,
}

impl<S: Sample, const C: usize> MeanRows<'_, S, C> {
    /// Writes the next row to `out`. After the last row `out` is unchanged.
    ///
    /// # Panics
    /// When the length of `out` is not that of a row of `inner`.
    pub fn next(&mut self, out: &mut [f32]) {
        if self.next == self.end || out.is_empty() {
            return;
        }
        let Self { filter, picture, columns, .. } = self;
        let (y, radius, last) = (self.next as isize, filter.radius as isize, picture.valid.len() as isize - 1);
        let row = |y: isize| Some(y.clamp(0, last) as usize);
        match self.held {
            false => (y - radius..=y + radius).for_each(|y| filter.exchange::<S, C>(picture, *columns, row(y), None)),
            true => filter.exchange::<S, C>(picture, *columns, row(y + radius), row(y - radius - 1)),
        }
        filter.repeat_border::<C>(*columns);
        simd::prefix::<C>(filter.simd, &filter.columns, &mut filter.running);
        let side = 2 * filter.radius + 1;
        if !self.whole {
            simd::prefix::<1>(filter.simd, &filter.counts, &mut filter.running_counts);
            let (starts, ends) = (&filter.running_counts, &filter.running_counts[side..]);
            for (shares, (start, end)) in filter.shares.chunks_exact_mut(C).zip(starts.iter().zip(ends)) {
                shares.fill(1.0 / end.wrapping_sub(*start).max(1) as f32);
            }
        }
        let (running, shares) = (&filter.running, &filter.shares);
        simd::run(
            filter.simd,
            #[inline(always)]
            || means(running, &running[side * C..], shares, out),
        );
        (self.held, self.next) = (true, self.next + 1);
    }
}

#[derive(Debug, Clone, Copy)]
struct Picture<'a, S> {
    pixels: &'a [S],
    width: usize,
    valid: &'a [Range<usize>],
}

#[inline(always)]
fn exchanged<S: Sample>(sums: &mut [u32], enters: &[S], leaves: &[S]) {
    for ((sum, enters), leaves) in sums.iter_mut().zip(enters).zip(leaves) {
        *sum = sum.wrapping_add(enters.integer()).wrapping_sub(leaves.integer());
    }
}

#[inline(always)]
fn means(starts: &[u32], ends: &[u32], shares: &[f32], out: &mut [f32]) {
    for ((out, share), (start, end)) in out.iter_mut().zip(shares).zip(starts.iter().zip(ends)) {
        *out = end.wrapping_sub(*start) as f32 * share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case() -> (Vec<u16>, Vec<Range<usize>>) {
        let pixels = (0..24 * 18 * 3u32).map(|i| (i * 40_503 % 65_536) as u16).collect();
        (pixels, (0..18).map(|y| if y < 2 { 0..0 } else { y / 3..24 - y / 6 }).collect())
    }

    #[test]
    fn it_is_the_mean_of_the_valid_pixels_with_repeated_borders() {
        let (pixels, valid) = case();
        let mut out = vec![0.0; 24 * 18 * 3];
        MeanFilter::new(7).apply::<u16, 3>(&pixels, 24, &valid, Rect::whole(24, 18), &mut out);
        for y in 0..18i32 {
            for x in 0..24i32 {
                let (mut sum, mut count) = ([0.0f64; 3], 0.0);
                for dy in -3..=3 {
                    for dx in -3..=3 {
                        let (u, v) = ((x + dx).clamp(0, 23) as usize, (y + dy).clamp(0, 17) as usize);
                        if valid[v].contains(&u) {
                            (0..3).for_each(|c| sum[c] += f64::from(pixels[(v * 24 + u) * 3 + c]));
                            count += 1.0;
                        }
                    }
                }
                for c in 0..3 {
                    let expected = if count == 0.0 { 0.0 } else { sum[c] / count };
                    let got = f64::from(out[(y as usize * 24 + x as usize) * 3 + c]);
                    assert!((got - expected).abs() < 0.01, "at {x}, {y}: {got} instead of {expected}");
                }
            }
        }
    }

    #[test]
    fn vector_instructions_give_the_same_bits() {
        let (pixels, valid) = case();
        let eight: Vec<u8> = pixels.iter().map(|&v| v as u8).collect();
        let spans = [valid, vec![0..24; 18], vec![3..20; 18]];
        for (valid, inner) in spans.iter().flat_map(|valid| {
            [Rect::whole(24, 18), Rect { x: 3, y: 2, width: 13, height: 9 }].map(|inner| (valid, inner))
        }) {
            let both = |simd: Option<Avx2>| {
                let mut out = [(); 3].map(|()| vec![0.0; inner.width * inner.height * 3]);
                MeanFilter::with(simd, 7).apply::<u16, 3>(&pixels, 24, valid, inner, &mut out[0]);
                MeanFilter::with(simd, 7).apply::<u8, 3>(&eight, 24, valid, inner, &mut out[1]);
                out[2].truncate(inner.width * inner.height);
                MeanFilter::with(simd, 9).apply::<u8, 1>(&eight[..24 * 18], 24, valid, inner, &mut out[2]);
                out
            };
            assert_eq!(both(None), both(Avx2::detect()));
        }
    }

    #[test]
    fn a_rectangle_gets_the_same_bits_as_the_whole_image() {
        let (pixels, valid) = case();
        let mut whole = vec![0.0; 24 * 18 * 3];
        MeanFilter::new(5).apply::<u16, 3>(&pixels, 24, &valid, Rect::whole(24, 18), &mut whole);
        let inner = Rect { x: 9, y: 6, width: 8, height: 5 };
        let mut part = vec![0.0; 8 * 5 * 3];
        MeanFilter::new(5).apply::<u16, 3>(&pixels, 24, &valid, inner, &mut part);
        for y in 0..5 {
            let start = ((6 + y) * 24 + 9) * 3;
            assert_eq!(part[y * 24..(y + 1) * 24], whole[start..start + 24]);
        }
    }
}
