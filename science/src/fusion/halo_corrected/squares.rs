//! Sums over squares, in whole numbers: they do not depend on where they begin.

use std::ops::{AddAssign, SubAssign};

use crate::imaging::simd::{self, Avx2};

/// Whole numbers that are added up.
pub(super) trait Whole: Copy + Default + Ord + From<i32> + AddAssign + SubAssign {
    fn value(self) -> f32;
    fn size(self) -> Self;
}

impl Whole for i32 {
    fn value(self) -> f32 {
        self as f32
    }

    fn size(self) -> Self {
        self.abs()
    }
}

impl Whole for i64 {
    fn value(self) -> f32 {
        self as f32
    }

    fn size(self) -> Self {
        self.abs()
    }
}

/// Sums over squares.
pub(super) struct Squares<N> {
    width: usize,
    height: usize,
    simd: Option<Avx2>,
    line: Vec<N>,
    sums: Vec<N>,
}

impl<N: Whole> Squares<N> {
    /// Of planes of that size.
    pub(super) fn of(width: usize, height: usize) -> Self {
        Self { width, height, simd: Avx2::detect(), line: Vec::new(), sums: Vec::new() }
    }

    /// Sums over squares of `side` px, so many times over: `side^(2 times)` times the mean. The border is repeated.
    pub(super) fn smooth(&mut self, values: &mut Vec<N>, across: &mut Vec<N>, side: usize, times: usize) {
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
            std::mem::swap(values, across);
            values.resize(width * height, N::default());
            let row = |y: usize, steps: isize| {
                let y = y.saturating_add_signed(steps).min(height - 1);
                &across[y * width..(y + 1) * width]
            };
            self.sums.clear();
            self.sums.resize(width, N::default());
            for steps in -(half as isize)..half as isize {
                self.sums.iter_mut().zip(row(0, steps)).for_each(|(sum, &value)| *sum += value);
            }
            for (y, out) in values.chunks_exact_mut(width).enumerate() {
                let (entering, leaving, sums) = (row(y, half as isize), row(y, -(half as isize)), &mut self.sums[..]);
                simd::run(
                    self.simd,
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

/// Sums of `side` neighbours, the first of them at the place of the sum. By doubling: sums of 2, of 4, of 8 and so on are
/// each two of those before, and of these the sum of `side` is put together.
#[inline(always)]
fn sums_along<N: Whole>(line: &mut [N], side: usize, spare: &mut Vec<N>, out: &mut [N]) {
    out.fill(N::default());
    let (mut of, mut at) = (1, 0);
    loop {
        if side & of != 0 {
            out.iter_mut().zip(&line[at..]).for_each(|(sum, &part)| *sum += part);
            at += of;
        }
        if 2 * of > side {
            return;
        }
        spare.clear();
        spare.extend_from_slice(&line[of..]);
        line.iter_mut().zip(&*spare).for_each(|(sum, &next)| *sum += next);
        of *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_is_that_of_the_square_with_the_border_repeated() {
        let (width, height, side) = (13usize, 9usize, 5usize);
        let of = |x: usize, y: usize| ((x * 31 + y * 17) % 23) as i32 - 11;
        let mut values: Vec<i32> = (0..width * height).map(|at| of(at % width, at / width)).collect();
        Squares::of(width, height).smooth(&mut values, &mut Vec::new(), side, 1);
        for y in 0..height {
            for x in 0..width {
                let near = |at: usize, by: usize, length: usize| (at + by).saturating_sub(side / 2).min(length - 1);
                let row = |v: usize| -> i32 { (0..side).map(|u| of(near(x, u, width), near(y, v, height))).sum() };
                assert_eq!(values[y * width + x], (0..side).map(row).sum::<i32>(), "({x}, {y})");
            }
        }
    }
}
