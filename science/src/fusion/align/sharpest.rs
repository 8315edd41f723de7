//! The sharpest slice per pixel: a running argmax of the focus measure over slices that arrive in any order.

use std::sync::Mutex;

use crate::{
    fusion::{
        plan::UNCOVERED,
        run::{locked, unlocked},
    },
    imaging::{
        Coverage, Plane,
        simd::{self, Avx2},
    },
};

/// Rows under one lock.
pub(super) const BAND: usize = 128;

/// Pixels that are checked for ties at a time.
const PART: usize = 256;

/// Value of a slice where it covers the pixel but not the whole window of the focus measure: below every measured
/// value.
const UNSUPPORTED: f32 = -1.0;

/// Running argmax of the focus measure. The result does not depend on the order of the updates:
///
/// 1. The larger value wins.
/// 2. Of equal values above 0, the slice with the lower index wins.
/// 3. Of equal values that are not above 0, the reference slice wins, then the lower index.
pub(super) struct Sharpest {
    width: usize,
    height: usize,
    reference: usize,
    simd: Option<Avx2>,
    bands: Vec<Mutex<Band>>,
}

struct Band {
    best: Vec<f32>,
    slice: Vec<u16>,
}

impl Sharpest {
    pub(super) fn new(width: usize, height: usize, reference: usize) -> Self {
        let band = |start: usize| {
            let pixels = BAND.min(height - start) * width;
            Mutex::new(Band { best: vec![f32::NEG_INFINITY; pixels], slice: vec![UNCOVERED; pixels] })
        };
        let simd = Avx2::detect();
        Self { width, height, reference, simd, bands: (0..height).step_by(BAND).map(band).collect() }
    }

    /// Number of bands of [`BAND`] rows.
    pub(super) fn bands(&self) -> usize {
        self.bands.len()
    }

    /// The rows of band `band`.
    pub(super) fn rows(&self, band: usize) -> std::ops::Range<usize> {
        band * BAND..((band + 1) * BAND).min(self.height)
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
        for outer in [whole.start..inner.start, inner.end..whole.end] {
            for (best, sharpest) in best[outer.clone()].iter_mut().zip(&mut sharpest[outer]) {
                self.enter(slice, UNSUPPORTED, best, sharpest);
            }
        }
        let values = &values[inner.clone()];
        let (best, sharpest) = (&mut best[inner.clone()], &mut sharpest[inner]);
        let parts = best.chunks_mut(PART).zip(sharpest.chunks_mut(PART)).zip(values.chunks(PART));
        for ((best, sharpest), values) in parts {
            let ties = simd::run(
                self.simd,
                #[inline(always)]
                || enter_larger(slice as u16, values, best, sharpest),
            );
            if ties {
                for ((best, sharpest), &value) in best.iter_mut().zip(sharpest).zip(values) {
                    self.enter(slice, value, best, sharpest);
                }
            }
        }
    }

    #[inline]
    fn enter(&self, slice: usize, value: f32, best: &mut f32, sharpest: &mut u16) {
        if value > *best || (value == *best && self.comes_first(value, slice, *sharpest)) {
            *best = value;
            *sharpest = slice as u16;
        }
    }

    /// Whether `slice` is chosen rather than `other`, when both have the value `value`.
    fn comes_first(&self, value: f32, slice: usize, other: u16) -> bool {
        let other = usize::from(other);
        let nothing_is_sharp = value <= 0.0;
        match nothing_is_sharp {
            true if slice == self.reference => true,
            true if other == self.reference => false,
            _ => slice < other,
        }
    }

    /// The sharpest slice per pixel; [`UNCOVERED`] where no slice covers it.
    pub(super) fn finish(self) -> Plane<u16> {
        let mut data = Vec::with_capacity(self.width * self.height);
        for band in self.bands {
            data.extend(unlocked(band).slice);
        }
        Plane { width: self.width, height: self.height, data }
    }

    /// The sharpest slice per pixel, and its value.
    pub(super) fn finish_with_values(self) -> (Plane<u16>, Plane<f32>) {
        let (width, height) = (self.width, self.height);
        let (mut slices, mut values) = (Vec::with_capacity(width * height), Vec::with_capacity(width * height));
        for band in self.bands {
            let Band { best, slice } = unlocked(band);
            slices.extend(slice);
            values.extend(best);
        }
        (Plane { width, height, data: slices }, Plane { width, height, data: values })
    }
}

/// Enters all values that are larger than the best so far. Returns whether any value is equal to the best: the caller
/// then resolves the ties of this part, which leaves the pixels entered here as they are.
#[inline(always)]
fn enter_larger(slice: u16, values: &[f32], best: &mut [f32], sharpest: &mut [u16]) -> bool {
    let mut ties = 0u32;
    for ((sharpest, best), &value) in sharpest.iter_mut().zip(best).zip(values) {
        ties |= u32::from(value == *best);
        let larger = value > *best;
        *sharpest = if larger { slice } else { *sharpest };
        *best = if larger { value } else { *best };
    }
    ties != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn argmax(order: &[usize], values: &[[f32; 4]], reference: usize) -> Vec<u16> {
        let sharpest = Sharpest::new(4, 1, reference);
        let full = Coverage::full(4, 1);
        for &slice in order {
            sharpest.update(0, slice, &values[slice], &full, &full);
        }
        sharpest.finish().data
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
        let sharpest = Sharpest::new(4, 1, 0);
        sharpest.update(0, 1, &[9.0; 4], &half, &none);
        sharpest.update(0, 2, &[0.0; 4], &half, &half);
        assert_eq!(sharpest.finish().data, [UNCOVERED, UNCOVERED, 2, 2]);
        let sharpest = Sharpest::new(4, 1, 0);
        sharpest.update(0, 1, &[9.0; 4], &full, &none);
        assert_eq!(sharpest.finish().data, [1; 4]);
    }
}
