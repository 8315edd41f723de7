//! The sharpest slice per pixel, found while slices come in any order.

use std::sync::Mutex;

use super::UNCOVERED;
use crate::imaging::{
    Coverage, Plane,
    simd::{self, Avx2},
};

/// Rows that are updated under one lock.
pub(super) const BAND: usize = 128;

/// Pixels that are looked through for ties at a time.
const PART: usize = 256;

/// Saliency of a slice where part of what the saliency looks at is not covered: below everything.
const UNSUPPORTED: f32 = -1.0;

/// Running argmax of the saliency. What it ends with does not depend on the order of the updates: the larger
/// saliency wins, of equal ones the slice with the lower number; where none is above 0, the reference slice
/// comes before the others.
pub(super) struct Winner {
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

impl Winner {
    pub(super) fn new(width: usize, height: usize, reference: usize) -> Self {
        let band = |start: usize| {
            let pixels = BAND.min(height - start) * width;
            Mutex::new(Band { best: vec![f32::NEG_INFINITY; pixels], slice: vec![UNCOVERED; pixels] })
        };
        let simd = Avx2::detect();
        Self { width, height, reference, simd, bands: (0..height).step_by(BAND).map(band).collect() }
    }

    pub(super) fn bands(&self) -> usize {
        self.bands.len()
    }

    /// The rows of band `band`.
    pub(super) fn rows(&self, band: usize) -> std::ops::Range<usize> {
        band * BAND..((band + 1) * BAND).min(self.height)
    }

    /// Enters the saliency of `slice` in row `y`. `covered` is what the slice covers, `supported` where its saliency saw
    /// covered pixels alone.
    pub(super) fn update(&self, y: usize, slice: usize, saliency: &[f32], covered: &Coverage, supported: &Coverage) {
        let mut held = super::locked(&self.bands[y / BAND]);
        let start = y % BAND * self.width;
        let Band { best, slice: winners } = &mut *held;
        let (best, winners) = (&mut best[start..start + self.width], &mut winners[start..start + self.width]);
        let (whole, sure) = (covered.span(y), supported.span(y));
        let sure = if sure.is_empty() { whole.end..whole.end } else { sure };
        for unsure in [whole.start..sure.start, sure.end..whole.end] {
            for (best, winner) in best[unsure.clone()].iter_mut().zip(&mut winners[unsure]) {
                self.enter(slice, UNSUPPORTED, best, winner);
            }
        }
        let saliency = &saliency[sure.clone()];
        let (best, winners) = (&mut best[sure.clone()], &mut winners[sure]);
        let parts = best.chunks_mut(PART).zip(winners.chunks_mut(PART)).zip(saliency.chunks(PART));
        for ((best, winners), saliency) in parts {
            let ties = simd::run(
                self.simd,
                #[inline(always)]
                || larger(slice as u16, saliency, best, winners),
            );
            if ties {
                for ((best, winner), &saliency) in best.iter_mut().zip(winners).zip(saliency) {
                    self.enter(slice, saliency, best, winner);
                }
            }
        }
    }

    #[inline]
    fn enter(&self, slice: usize, saliency: f32, best: &mut f32, winner: &mut u16) {
        if saliency > *best || (saliency == *best && self.comes_first(saliency, slice, *winner)) {
            *best = saliency;
            *winner = slice as u16;
        }
    }

    /// Of two slices of equal saliency, whether `slice` is chosen before `other`.
    fn comes_first(&self, saliency: f32, slice: usize, other: u16) -> bool {
        let other = usize::from(other);
        let nothing_is_sharp = saliency <= 0.0;
        match nothing_is_sharp {
            true if slice == self.reference => true,
            true if other == self.reference => false,
            _ => slice < other,
        }
    }

    /// The sharpest slice per pixel; [`UNCOVERED`] where no slice was.
    pub(super) fn finish(self) -> Plane<u16> {
        let mut data = Vec::with_capacity(self.width * self.height);
        for band in self.bands {
            data.extend(super::unlocked(band).slice);
        }
        Plane { width: self.width, height: self.height, data }
    }

    /// The same, and how sharp it is there.
    pub(super) fn finish_with_values(self) -> (Plane<u16>, Plane<f32>) {
        let (width, height) = (self.width, self.height);
        let (mut slices, mut values) = (Vec::with_capacity(width * height), Vec::with_capacity(width * height));
        for band in self.bands {
            let Band { best, slice } = super::unlocked(band);
            slices.extend(slice);
            values.extend(best);
        }
        (Plane { width, height, data: slices }, Plane { width, height, data: values })
    }
}

/// Enters saliencies, and says whether any of them equalled the best so far: then it is still to be decided which slice
/// comes first, which changes nothing where the slice was entered already.
#[inline(always)]
fn larger(slice: u16, saliency: &[f32], best: &mut [f32], winners: &mut [u16]) -> bool {
    let mut ties = 0u32;
    for ((winner, best), &saliency) in winners.iter_mut().zip(best).zip(saliency) {
        ties |= u32::from(saliency == *best);
        let wins = saliency > *best;
        *winner = if wins { slice } else { *winner };
        *best = if wins { saliency } else { *best };
    }
    ties != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn winners(order: &[usize], saliencies: &[[f32; 4]], reference: usize) -> Vec<u16> {
        let winner = Winner::new(4, 1, reference);
        let full = Coverage::full(4, 1);
        for &slice in order {
            winner.update(0, slice, &saliencies[slice], &full, &full);
        }
        winner.finish().data
    }

    #[test]
    fn the_order_in_which_slices_come_does_not_matter() {
        let saliencies = [[1.0, 5.0, 0.0, 2.0], [3.0, 5.0, 0.0, 2.0], [2.0, 1.0, 0.0, 2.0]];
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            // sharpest; first of equals; reference where nothing is sharp; first of equals
            assert_eq!(winners(&order, &saliencies, 1), [1, 0, 1, 0]);
        }
    }

    #[test]
    fn an_unsupported_slice_loses_to_any_other_and_wins_alone() {
        let full = Coverage::full(4, 1);
        let shifted = crate::types::Homography::similarity(1.0, [-2.0, 0.0]);
        let half = Coverage::of(&shifted, (4, 1), 4, 1);
        let none = half.eroded(4);
        let winner = Winner::new(4, 1, 0);
        winner.update(0, 1, &[9.0; 4], &half, &none);
        winner.update(0, 2, &[0.0; 4], &half, &half);
        assert_eq!(winner.finish().data, [UNCOVERED, UNCOVERED, 2, 2]);
        let winner = Winner::new(4, 1, 0);
        winner.update(0, 1, &[9.0; 4], &full, &none);
        assert_eq!(winner.finish().data, [1; 4]);
    }
}
