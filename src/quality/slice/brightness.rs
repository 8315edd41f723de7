//! Brightness of a slice over that of the reference, from means of blocks that both cover.

use super::is_clipped;
use crate::imaging::Plane;

/// About this many blocks over the canvas: large against any defocus, small against uneven light.
const BLOCKS: usize = 768;
/// No block is smaller than this, px.
const LEAST_SIDE: usize = 16;
/// Blocks darker than this (0..255) say more of noise and black level than of light.
const LEAST_MEAN: f32 = 4.0;
/// Blocks with a larger share of clipped pixels are passed over.
const MOST_CLIPPED: f32 = 0.01;

/// Mean brightness before gain per block; NaN where the slice does not cover the whole block, or too dark,
/// or clipped.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Blocks {
    means: Vec<f32>,
}

impl Blocks {
    pub(super) fn of(luma: &Plane<f32>, valid: &Plane<u8>, gain: f32) -> Self {
        let side = ((luma.data.len() / BLOCKS) as f64).sqrt() as usize;
        let side = side.max(LEAST_SIDE).min(luma.width.min(luma.height)).max(1);
        let (across, down) = (luma.width / side, luma.height / side);
        let mut means = Vec::with_capacity(across * down);
        for block_y in 0..down {
            for block_x in 0..across {
                means.push(mean(luma, valid, gain, (block_x * side, block_y * side), side));
            }
        }
        Self { means }
    }

    /// Median over the blocks that both have; none when they share none.
    pub(crate) fn exposure_ratio(&self, reference: &Self) -> Option<f64> {
        if self.means.len() != reference.means.len() {
            return None;
        }
        let pairs = self.means.iter().zip(&reference.means);
        let mut ratios: Vec<f32> = pairs.map(|(mine, its)| mine / its).filter(|ratio| ratio.is_finite()).collect();
        crate::quality::statistics::median(&mut ratios).map(f64::from)
    }
}

fn mean(luma: &Plane<f32>, valid: &Plane<u8>, gain: f32, (x, y): (usize, usize), side: usize) -> f32 {
    let (mut sum, mut clipped) = (0.0f64, 0);
    for row in y..y + side {
        let (values, covered) = (&luma.row(row)[x..x + side], &valid.row(row)[x..x + side]);
        if covered.contains(&0) {
            return f32::NAN;
        }
        sum += super::sum_of(values);
        clipped += values.iter().filter(|&&value| is_clipped(value, gain)).count();
    }
    let pixels = (side * side) as f32;
    let mean = sum as f32 / pixels / gain;
    if clipped as f32 > MOST_CLIPPED * pixels || mean < LEAST_MEAN {
        return f32::NAN;
    }
    mean
}
