//! The mean filter that makes the base layer: square windows, valid pixels alone, border repeated.

use std::ops::Range;

use crate::imaging::{Rect, Sample};

/// A mean filter and its buffers.
#[derive(Debug)]
pub struct MeanFilter {
    radius: usize,
    columns: Vec<u32>,
    counts: Vec<u32>,
}

impl MeanFilter {
    /// Windows of `side` x `side` px; `side` is odd, at most 255.
    pub fn new(side: usize) -> Self {
        Self { radius: side / 2, columns: Vec::new(), counts: Vec::new() }
    }

    /// How far from a pixel its mean looks.
    pub fn reach(&self) -> usize {
        self.radius
    }

    /// Means of `pixels` (rows of `width` pixels of `C` interleaved samples, as many as `valid` has spans) at
    /// the pixels of `inner`, interleaved, row-major. Beyond the edges of `pixels` the border pixel is
    /// repeated (and is as valid as that pixel): give [`MeanFilter::reach`] px around `inner` wherever the
    /// picture goes on. Sums are exact; a window without any valid pixel gives 0.
    pub fn apply<S: Sample, const C: usize>(
        &mut self,
        pixels: &[S],
        width: usize,
        valid: &[Range<usize>],
        inner: Rect,
        out: &mut [f32],
    ) {
        if inner.width == 0 || inner.height == 0 {
            return;
        }
        self.columns.clear();
        self.columns.resize(width * C, 0);
        self.counts.clear();
        self.counts.resize(width, 0);
        let (radius, last) = (self.radius as isize, valid.len() as isize - 1);
        let clamp = |y: isize| y.clamp(0, last) as usize;
        let top = inner.y as isize;
        for y in top - radius..top + radius {
            self.add_row::<S, C, true>(pixels, width, valid, clamp(y));
        }
        for (y, out) in (top..).zip(out.chunks_exact_mut(inner.width * C)) {
            self.add_row::<S, C, true>(pixels, width, valid, clamp(y + radius));
            self.means::<C>(width, inner, out);
            self.add_row::<S, C, false>(pixels, width, valid, clamp(y - radius));
        }
    }

    fn add_row<S: Sample, const C: usize, const ENTERS: bool>(
        &mut self,
        pixels: &[S],
        width: usize,
        valid: &[Range<usize>],
        y: usize,
    ) {
        let span = valid[y].clone();
        let row = &pixels[y * width * C..(y + 1) * width * C];
        let samples = &row[span.start * C..span.end * C];
        for (sum, sample) in self.columns[span.start * C..span.end * C].iter_mut().zip(samples) {
            *sum = if ENTERS { *sum + sample.integer() } else { *sum - sample.integer() };
        }
        for count in &mut self.counts[span] {
            *count = if ENTERS { *count + 1 } else { *count - 1 };
        }
    }

    fn means<const C: usize>(&self, width: usize, inner: Rect, out: &mut [f32]) {
        let (radius, last) = (self.radius as isize, width as isize - 1);
        let column = |x: isize| {
            let x = x.clamp(0, last) as usize;
            let mut sums = [0u32; C];
            sums.copy_from_slice(&self.columns[x * C..(x + 1) * C]);
            (sums, self.counts[x])
        };
        let left = inner.x as isize;
        let (mut sums, mut count) = ([0u32; C], 0u32);
        for x in left - radius..left + radius {
            let entering = column(x);
            for (sum, value) in sums.iter_mut().zip(entering.0) {
                *sum += value;
            }
            count += entering.1;
        }
        for (x, out) in (left..).zip(out.chunks_exact_mut(C)) {
            let (entering, leaving) = (column(x + radius), column(x - radius));
            for (sum, value) in sums.iter_mut().zip(entering.0) {
                *sum += value;
            }
            count += entering.1;
            let share = 1.0 / f64::from(count.max(1));
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = (f64::from(sum) * share) as f32;
            }
            for (sum, value) in sums.iter_mut().zip(leaving.0) {
                *sum -= value;
            }
            count -= leaving.1;
        }
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
    fn a_part_gets_the_same_bits_as_the_whole() {
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
