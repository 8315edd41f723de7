//! The last step of a tile: the fused levels become samples.

use std::{mem, ops::Range};

use super::{Canvas, Pyramid, filter::Level, normalised};
use crate::{
    fusion::plan::UNCOVERED,
    imaging::{
        Plane, Rect, Sample,
        simd::{self, Avx2},
    },
};

impl<S: Sample> Pyramid<S> {
    /// Expands and adds the fused levels, clamps and rounds them. Returns the number of pixels with a sample that was
    /// outside the range of its depth by more than one grey level of 255.
    pub(super) fn finish<const C: usize>(
        &mut self,
        canvas: &Canvas,
        rect: Rect,
        index: &Plane<u16>,
        out: &mut Vec<S>,
    ) -> usize {
        let mut fused = self.collapsed::<C>(canvas);
        out.clear();
        out.resize(rect.width * rect.height * C, S::default());
        let (columns, mut clamped) = (rect.x..rect.x + rect.width, 0);
        let mut outside = vec![false; rect.width];
        let mut rounded: [Vec<S>; C] = std::array::from_fn(|_| vec![S::default(); rect.width]);
        for (y, out) in (rect.y..).zip(out.chunks_exact_mut((rect.width * C).max(1))) {
            let slices = &index.row(y)[columns.clone()];
            outside.fill(false);
            for (c, (plane, rounded)) in fused.iter_mut().zip(&mut rounded).enumerate() {
                self.round_row((c, y, &columns), slices, plane.row_mut(y), &mut outside, rounded);
            }
            for (x, pixel) in out.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                *pixel = std::array::from_fn(|c| rounded[c][x]);
            }
            let covered = outside.iter().zip(slices).filter(|&(_, &slice)| slice != UNCOVERED);
            clamped += covered.filter(|(outside, _)| **outside).count();
        }
        self.values = fused;
        clamped
    }

    /// The fused levels, expanded and added: values of level 0 in grey levels of 255. Takes the memory of
    /// `self.values`.
    fn collapsed<const C: usize>(&mut self, canvas: &Canvas) -> Level {
        let (levels, simd) = (self.sums.len(), Avx2::detect());
        let (mut result, mut expanded) = (mem::take(&mut self.values), Vec::new());
        normalised::<C>(simd, &self.sums[levels - 1], &mut result);
        for level in (0..levels - 1).rev() {
            let [first, second, third, weights] = &mut self.sums[level];
            let (rect, size) = (weights.rect, canvas.sizes.0[level + 1]);
            let columns = rect.x..rect.x + rect.width;
            for (sums, coarse) in [first, second, third].into_iter().zip(&result).take(C) {
                for y in rect.y..rect.y + rect.height {
                    let coarse = self.filters.expand(simd, coarse, size, (y, &columns), &mut expanded);
                    let (sums, weights) = (sums.row_mut(y), weights.row(y));
                    simd::run(
                        simd,
                        #[inline(always)]
                        || {
                            for ((sum, &weight), coarse) in sums.iter_mut().zip(weights).zip(coarse) {
                                let there = *sum / weight + *coarse;
                                *sum = if weight > 0.0 { there } else { *sum };
                            }
                        },
                    );
                }
            }
            mem::swap(&mut result, &mut self.sums[level]);
        }
        result
    }

    /// Clamps and rounds the `values` of row `y` of a channel; 0 where no slice covers the canvas. Sets `outside` where
    /// a value is outside the range by more than one grey level.
    fn round_row(
        &mut self,
        (channel, y, columns): (usize, usize, &Range<usize>),
        slices: &[u16],
        values: &mut [f32],
        outside: &mut [bool],
        rounded: &mut [S],
    ) {
        let (simd, scale) = (Avx2::detect(), S::DEPTH.max() / 255.0);
        simd::run(
            simd,
            #[inline(always)]
            || {
                for (value, outside) in values.iter_mut().zip(outside) {
                    *outside |= (*value < -1.0) | (*value > 256.0);
                    *value *= scale;
                }
            },
        );
        self.range.clamp(channel, y, columns, values);
        simd::run(
            simd,
            #[inline(always)]
            || {
                for ((rounded, &value), &slice) in rounded.iter_mut().zip(&*values).zip(slices) {
                    *rounded = S::rounded(if slice == UNCOVERED { 0.0 } else { value });
                }
            },
        );
    }
}
