//! The sharpest slice per pixel: a running argmax of the focus measure over slices that arrive in any order.

use std::sync::Mutex;

use rayon::prelude::*;

use super::focus_code::FocusCode;
use crate::{
    fusion::{lock::locked, plan::UNCOVERED},
    imaging::{
        Coverage, Plane,
        simd::{self, Avx2},
    },
};

/// Rows under one lock.
const BAND: usize = 128;

/// Running argmax of the focus measure. The result does not depend on the order of the updates:
///
/// 1. The larger value wins. Values are compared as [`FocusCode`]s, to a thousandth.
/// 2. Of equal values above 0, the slice with the lower index wins.
/// 3. Of equal values that are not above 0, the reference slice wins, then the lower index.
pub(super) struct Sharpest<'a> {
    width: usize,
    reference: u16,
    simd: Option<Avx2>,
    bands: Vec<Mutex<Band<'a>>>,
}

struct Band<'a> {
    best: &'a mut [FocusCode],
    slice: &'a mut [u16],
}

impl<'a> Sharpest<'a> {
    /// The argmax is kept in two planes of the size of the canvas, whose values are overwritten. `slices` is the
    /// sharpest slice per pixel, [`UNCOVERED`] where no slice covers it, and `values` is its focus measure there.
    pub(super) fn new(slices: &'a mut Plane<u16>, values: &'a mut Plane<FocusCode>, reference: usize) -> Self {
        let (width, band) = (slices.width, (slices.width * BAND).max(1));
        let bands = slices.data.par_chunks_mut(band).zip(values.data.par_chunks_mut(band));
        let blank = |(slice, best): (&'a mut [u16], &'a mut [FocusCode])| {
            slice.fill(UNCOVERED);
            best.fill(FocusCode::NONE);
            Mutex::new(Band { best, slice })
        };
        Self { width, reference: reference as u16, simd: Avx2::detect(), bands: bands.map(blank).collect() }
    }

    /// Enters row `y` of the focus measure of `slice`. `covered` is the area that the slice covers, `supported` the
    /// area where it covers the whole window of the measure.
    pub(super) fn update(&self, y: usize, slice: usize, values: &[f32], covered: &Coverage, supported: &Coverage) {
        let mut band = locked(&self.bands[y / BAND]);
        let start = y % BAND * self.width;
        let Band { best, slice: sharpest } = &mut *band;
        let (best, sharpest) = (&mut best[start..start + self.width], &mut sharpest[start..start + self.width]);
        let (whole, inner) = (covered.span(y), supported.span(y));
        let inner = if inner.is_empty() { whole.end..whole.end } else { inner };
        let slice = slice as u16;
        for outer in [whole.start..inner.start, inner.end..whole.end] {
            for (best, sharpest) in best[outer.clone()].iter_mut().zip(&mut sharpest[outer]) {
                self.enter(slice, FocusCode::UNSUPPORTED, best, sharpest);
            }
        }
        let (best, sharpest, values) = (&mut best[inner.clone()], &mut sharpest[inner.clone()], &values[inner]);
        simd::run(
            self.simd,
            #[inline(always)]
            || {
                for ((best, sharpest), &value) in best.iter_mut().zip(sharpest).zip(values) {
                    self.enter(slice, FocusCode::of(value), best, sharpest);
                }
            },
        );
    }

    /// Without a branch, so that many pixels are entered at a time.
    #[inline(always)]
    fn enter(&self, slice: u16, code: FocusCode, best: &mut FocusCode, sharpest: &mut u16) {
        let is_lower = slice < *sharpest;
        let is_first_of_zeros = (slice == self.reference) | (is_lower & (*sharpest != self.reference));
        let is_sharp = code > FocusCode::ZERO;
        let comes_first = (is_sharp & is_lower) | (!is_sharp & is_first_of_zeros);
        let wins = (code > *best) | ((code == *best) & comes_first);
        *best = if wins { code } else { *best };
        *sharpest = if wins { slice } else { *sharpest };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The argmax in a canvas of 4 x 1 px after `enter`.
    fn after(reference: usize, enter: impl FnOnce(&Sharpest<'_>)) -> Vec<u16> {
        let (mut slices, mut values) = (Plane::filled(4, 1, 7), Plane::filled(4, 1, FocusCode::of(7.0)));
        enter(&Sharpest::new(&mut slices, &mut values, reference));
        slices.data
    }

    fn argmax(order: &[usize], values: &[[f32; 4]], reference: usize) -> Vec<u16> {
        let full = Coverage::full(4, 1);
        after(reference, |sharpest| {
            for &slice in order {
                sharpest.update(0, slice, &values[slice], &full, &full);
            }
        })
    }

    #[test]
    fn the_order_of_the_slices_does_not_matter() {
        let values = [[1.0, 5.0, 0.0, 2.0], [3.0, 5.0, 0.0, 2.0], [2.0, 1.0, 0.0, 2.0]];
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            // sharpest; first of equals; reference where nothing is sharp; first of equals
            assert_eq!(argmax(&order, &values, 1), [1, 0, 1, 0]);
        }
    }

    #[test]
    fn a_slice_whose_window_is_not_covered_loses_to_any_other_and_wins_alone() {
        let full = Coverage::full(4, 1);
        let shifted = crate::types::Homography::similarity(1.0, [-2.0, 0.0]);
        let half = Coverage::of(&shifted, (4, 1), 4, 1);
        let none = half.eroded(4);
        let beside = after(0, |sharpest| {
            sharpest.update(0, 1, &[9.0; 4], &half, &none);
            sharpest.update(0, 2, &[0.0; 4], &half, &half);
        });
        assert_eq!(beside, [UNCOVERED, UNCOVERED, 2, 2]);
        assert_eq!(after(0, |sharpest| sharpest.update(0, 1, &[9.0; 4], &full, &none)), [1; 4]);
    }
}
