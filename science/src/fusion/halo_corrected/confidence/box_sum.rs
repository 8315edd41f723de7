//! Sums over square windows, in integers: unlike sums of floats they do not depend on where the running sum begins, so
//! a tile gives the same result as the whole canvas.

use std::ops::{AddAssign, SubAssign};

use crate::imaging::simd::{self, Avx2};

/// Integers that are summed.
pub(super) trait Int: Copy + Default + Ord + From<i32> + AddAssign + SubAssign {
    fn value(self) -> f32;
    fn abs(self) -> Self;
}

impl Int for i32 {
    fn value(self) -> f32 {
        self as f32
    }

    fn abs(self) -> Self {
        self.abs()
    }
}

impl Int for i64 {
    fn value(self) -> f32 {
        self as f32
    }

    fn abs(self) -> Self {
        self.abs()
    }
}

/// Box sums of planes of one size.
pub(super) struct BoxSum<N> {
    width: usize,
    height: usize,
    simd: Option<Avx2>,
    line: Vec<N>,
    sums: Vec<N>,
    across: Vec<N>,
}

impl<N: Int> BoxSum<N> {
    pub(super) fn new(width: usize, height: usize) -> Self {
        Self { width, height, simd: Avx2::detect(), line: Vec::new(), sums: Vec::new(), across: Vec::new() }
    }

    /// Replaces each value by the sum over the `side` x `side` px around it, `times` times in a row: the result is
    /// `side^(2 times)` times a mean. `side` is odd. Beyond the plane its border is repeated.
    pub(super) fn apply(&mut self, values: &mut Vec<N>, side: usize, times: usize) {
        let (width, height, half) = (self.width, self.height, side / 2);
        for _ in 0..times {
            for row in values.chunks_exact_mut(width) {
                self.line.clear();
                self.line.resize(half, row[0]);
                self.line.extend_from_slice(row);
                self.line.resize(width + 2 * half, row[width - 1]);
                let Self { line, sums, simd, .. } = self;
                simd::run(
                    *simd,
                    #[inline(always)]
                    || sums_along(line, side, sums, row),
                );
            }
            std::mem::swap(values, &mut self.across);
            values.resize(width * height, N::default());
            let Self { simd, sums, across, .. } = self;
            let row = |y: usize, steps: isize| {
                let y = y.saturating_add_signed(steps).min(height - 1);
                &across[y * width..(y + 1) * width]
            };
            sums.clear();
            sums.resize(width, N::default());
            for steps in -(half as isize)..half as isize {
                sums.iter_mut().zip(row(0, steps)).for_each(|(sum, &value)| *sum += value);
            }
            for (y, out) in values.chunks_exact_mut(width).enumerate() {
                let (entering, leaving, sums) = (row(y, half as isize), row(y, -(half as isize)), &mut sums[..]);
                simd::run(
                    *simd,
                    #[inline(always)]
                    || {
                        for (((out, sum), &entering), &leaving) in out.iter_mut().zip(sums).zip(entering).zip(leaving) {
                            *sum += entering;
                            *out = *sum;
                            *sum -= leaving;
                        }
                    },
                );
            }
        }
    }
}

/// `out[i]` becomes the sum of the `side` values of `line` from `i` on. Works by doubling: sums of 2, 4, 8 and so on
/// are each two of the sums before, and the sum of `side` is put together from them. Overwrites `line`.
#[inline(always)]
fn sums_along<N: Int>(line: &mut [N], side: usize, spare: &mut Vec<N>, out: &mut [N]) {
    out.fill(N::default());
    let (mut length, mut at) = (1, 0);
    loop {
        if side & length != 0 {
            out.iter_mut().zip(&line[at..]).for_each(|(sum, &part)| *sum += part);
            at += length;
        }
        if 2 * length > side {
            return;
        }
        spare.clear();
        spare.extend_from_slice(&line[length..]);
        line.iter_mut().zip(&*spare).for_each(|(sum, &next)| *sum += next);
        length *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_sum_is_that_of_the_window_with_the_border_repeated() {
        let (width, height, side) = (13usize, 9usize, 5usize);
        let of = |x: usize, y: usize| ((x * 31 + y * 17) % 23) as i32 - 11;
        let mut values: Vec<i32> = (0..width * height).map(|at| of(at % width, at / width)).collect();
        BoxSum::new(width, height).apply(&mut values, side, 1);
        for y in 0..height {
            for x in 0..width {
                let near = |at: usize, by: usize, length: usize| (at + by).saturating_sub(side / 2).min(length - 1);
                let row = |v: usize| -> i32 { (0..side).map(|u| of(near(x, u, width), near(y, v, height))).sum() };
                assert_eq!(values[y * width + x], (0..side).map(row).sum::<i32>(), "({x}, {y})");
            }
        }
    }
}
