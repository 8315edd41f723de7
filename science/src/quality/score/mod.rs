//! Score of the fused image against the slices: how well it preserves the detail of the sharpest slice, block by block.
//!
//! The published metrics sum over all sources, which rewards blur when there are many slices, because most of them are
//! blurred at any pixel. Here each pixel (or 8x8 window) is compared with its sharpest slice alone. Slices are streamed
//! through a [`Scorer`], so that memory per block does not grow with their number.

mod gradients;
mod pixel_weights;
mod sums;
mod windows;

use super::{
    clipping::{FULL, ZERO},
    deterministic_sum,
};
use crate::imaging::Plane;

use gradients::Gradients;
pub(super) use gradients::sobel;
use pixel_weights::PixelWeights;
pub(super) use pixel_weights::{same_shape, whole_neighbourhoods};
use sums::Ratio;
pub use sums::ScoreSums;
use windows::Windows;

/// A pixel of the fused image overshoots if it is more than this outside the range of the slices, grey levels.
const OVERSHOOT_LEVELS: f32 = 1.0;

/// Scores one block, slice by slice.
///
/// Neighbourhoods (3x3 for gradients, 8x8 for windows) lie entirely inside the block and inside the part that a slice
/// covers. With an object mask a gradient counts if its pixel belongs to the object, a window if all its pixels do.
#[derive(Debug)]
pub struct Scorer<'a> {
    fused: &'a Plane<f32>,
    object: Option<&'a Plane<u8>>,
    gradients: Gradients,
    windows: Windows,
    lowest: Vec<f32>,
    highest: Vec<f32>,
}

impl<'a> Scorer<'a> {
    /// A scorer for one block. `fused` is the luma (0..255) of the fused image as it is written; `object` (255 inside,
    /// 0 outside) restricts the score to the object and is ignored if it has another size.
    pub fn new(fused: &'a Plane<f32>, object: Option<&'a Plane<u8>>) -> Self {
        let object = object.filter(|object| same_shape(object, fused));
        let pixels = fused.data.len();
        Self {
            fused,
            object,
            gradients: Gradients::new(fused.width, fused.height),
            windows: Windows::new(fused),
            lowest: vec![f32::INFINITY; pixels],
            highest: vec![f32::NEG_INFINITY; pixels],
        }
    }

    /// Adds the next slice, in ascending order: its warped luma (0..255) and validity (255 valid; none if the slice
    /// covers the whole block). Planes of another size than `fused` are ignored.
    pub fn slice(&mut self, luma: &Plane<f32>, valid: Option<&Plane<u8>>) {
        if !same_shape(luma, self.fused) || valid.is_some_and(|valid| !same_shape(valid, self.fused)) {
            return;
        }
        let holes = valid.filter(|valid| valid.data.contains(&0));
        let range = self.lowest.iter_mut().zip(&mut self.highest).zip(&luma.data);
        match holes {
            None => range.for_each(|((low, high), &value)| {
                *low = if value < *low { value } else { *low };
                *high = if value > *high { value } else { *high };
            }),
            Some(valid) => range.zip(&valid.data).for_each(|(((low, high), &value), &covered)| {
                *low = if covered != 0 && value < *low { value } else { *low };
                *high = if covered != 0 && value > *high { value } else { *high };
            }),
        }
        self.gradients.slice(luma, holes);
        self.windows.slice(luma, holes);
    }

    /// The sums over the block.
    pub fn sums(self) -> ScoreSums {
        let covered = PixelWeights::of(self.fused, |i| self.highest[i] > f32::NEG_INFINITY);
        let counts = match self.object {
            None => covered.clone(),
            Some(object) => {
                PixelWeights::of(self.fused, |i| self.highest[i] > f32::NEG_INFINITY && object.data[i] != 0)
            }
        };
        let mut sums = ScoreSums::default();
        self.gradients.sum(self.fused, &counts, &covered, &mut sums);
        self.windows.sum(&counts, &mut sums);
        differences(self.fused, &counts, &mut sums);
        self.range(&counts, &mut sums);
        sums
    }

    /// Sums the overshoot beyond the range of the slices, clipped pixels, and grey levels.
    fn range(&self, counts: &PixelWeights, sums: &mut ScoreSums) {
        let width = self.fused.width;
        let (mut beyond, mut outside, mut clipped) = (vec![0.0; width], vec![0.0; width], vec![0.0; width]);
        for y in 0..self.fused.height {
            let row = y * width..(y + 1) * width;
            let range = self.lowest[row.clone()].iter().zip(&self.highest[row]);
            let out = beyond.iter_mut().zip(&mut outside).zip(&mut clipped);
            for (((beyond, outside), clipped), (&value, (&low, &high))) in out.zip(self.fused.row(y).iter().zip(range))
            {
                let over = if value > high { value - high } else { 0.0 };
                let under = if value < low { low - value } else { 0.0 };
                // without any slice both bounds are infinite, and 0 (the weight) times infinity is NaN
                let both = (over + under).min(255.0);
                *beyond = both;
                *outside = if both > OVERSHOOT_LEVELS { 1.0 } else { 0.0 };
                *clipped = if (ZERO..FULL).contains(&value) { 0.0 } else { 1.0 };
            }
            let weights = counts.weights.row(y);
            let count = deterministic_sum::sum(weights);
            sums.overshoot.add(deterministic_sum::dot(&outside, weights), count);
            sums.overshoot_levels.add(deterministic_sum::dot(&beyond, weights), count);
            sums.clipped.add(deterministic_sum::dot(&clipped, weights), count);
            sums.level.add(deterministic_sum::dot(self.fused.row(y), weights), count);
        }
    }
}

/// Sums the squared differences to the right and lower neighbours, where both pixels count.
fn differences(fused: &Plane<f32>, counts: &PixelWeights, sums: &mut ScoreSums) {
    if fused.width == 0 {
        return;
    }
    let (mut squares, mut weights) = (vec![0.0f32; fused.width], vec![0.0f32; fused.width]);
    let mut squared = |(a, wa): (&[f32], &[f32]), (b, wb): (&[f32], &[f32]), ratio: &mut Ratio| {
        let length = a.len();
        for ((square, a), b) in squares.iter_mut().zip(a).zip(b) {
            *square = (a - b) * (a - b);
        }
        for ((weight, a), b) in weights.iter_mut().zip(wa).zip(wb) {
            *weight = a * b;
        }
        ratio.add(
            deterministic_sum::dot(&squares[..length], &weights[..length]),
            deterministic_sum::sum(&weights[..length]),
        );
    };
    let last = fused.width - 1;
    for y in 0..fused.height {
        let (row, here) = (fused.row(y), counts.weights.row(y));
        squared((&row[..last], &here[..last]), (&row[1..], &here[1..]), &mut sums.right);
        if y + 1 < fused.height {
            squared((row, here), (fused.row(y + 1), counts.weights.row(y + 1)), &mut sums.below);
        }
    }
}

#[cfg(test)]
mod tests;
