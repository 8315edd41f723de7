//! Gradient preservation against the sharpest slice per pixel.

use super::{Sums, whole_neighbourhoods};
use crate::{imaging::Plane, quality::xydeas};

/// The strongest Sobel gradient over the slices so far, per inner pixel of a tile.
#[derive(Debug)]
pub(super) struct Gradients {
    width: usize,
    height: usize,
    energy: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
}

impl Gradients {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let inner = width.saturating_sub(2) * height.saturating_sub(2);
        Self { width, height, energy: vec![-1.0; inner], gx: vec![0.0; inner], gy: vec![0.0; inner] }
    }

    /// Takes the next slice; `holes` is its validity when it does not cover the whole tile. A slice that is
    /// as sharp as one before it does not replace it.
    pub(super) fn slice(&mut self, luma: &Plane<f32>, holes: Option<&Plane<u8>>) {
        if self.energy.is_empty() {
            return;
        }
        let valid = holes.map(|valid| whole_neighbourhoods(valid, 3));
        let inner = self.width - 2;
        for y in 0..self.height - 2 {
            let [upper, middle, lower] = [luma.row(y), luma.row(y + 1), luma.row(y + 2)].map(|row| &row[..inner + 2]);
            let range = y * inner..(y + 1) * inner;
            let energy = &mut self.energy[range.clone()];
            let (best_gx, best_gy) = (&mut self.gx[range.clone()], &mut self.gy[range.clone()]);
            for x in 0..inner {
                let (gx, gy) = sobel(upper, middle, lower, x);
                let here = gx * gx + gy * gy;
                let better = here > energy[x] && valid.as_ref().is_none_or(|valid| valid.data[range.start + x] != 0);
                energy[x] = if better { here } else { energy[x] };
                best_gx[x] = if better { gx } else { best_gx[x] };
                best_gy[x] = if better { gy } else { best_gy[x] };
            }
        }
    }

    /// Compares with the fused image, on pixels that count and have their neighbourhood covered.
    pub(super) fn sum(&self, fused: &Plane<f32>, counts: &Plane<u8>, covered: &Plane<u8>, sums: &mut Sums) {
        if self.energy.is_empty() {
            return;
        }
        let neighbours = whole_neighbourhoods(covered, 3);
        let inner = self.width - 2;
        for y in 0..self.height - 2 {
            let [upper, middle, lower] = [fused.row(y), fused.row(y + 1), fused.row(y + 2)];
            for x in 0..inner {
                let i = y * inner + x;
                if counts.at(x + 1, y + 1) == 0 || neighbours.data[i] == 0 {
                    continue;
                }
                let (gx, gy) = sobel(upper, middle, lower, x);
                let energy = gx * gx + gy * gy;
                sums.tenengrad.add(f64::from(energy), 1.0);
                let laplacian =
                    f64::from(upper[x + 1] + lower[x + 1] + middle[x] + middle[x + 2] - 4.0 * middle[x + 1]);
                sums.laplacian.add(laplacian, 1.0);
                sums.laplacian_squares.add(laplacian * laplacian, 1.0);
                if self.energy[i] < 0.0 {
                    // covered, but by no single slice: a seam of validity
                    continue;
                }
                sums.retention.add(f64::from(energy), f64::from(self.energy[i]));
                let weight = f64::from(self.energy[i].sqrt());
                if weight > 0.0 {
                    let kept = xydeas::preservation((self.gx[i], self.gy[i]), (gx, gy));
                    sums.q_g.add(f64::from(kept) * weight, weight);
                }
            }
        }
    }
}

/// Sobel gradient (x, y) at the middle of the 3x3 pixels that begin at column `x`.
#[inline(always)]
pub(in crate::quality) fn sobel(upper: &[f32], middle: &[f32], lower: &[f32], x: usize) -> (f32, f32) {
    let gx = (upper[x + 2] - upper[x]) + 2.0 * (middle[x + 2] - middle[x]) + (lower[x + 2] - lower[x]);
    let gy = (lower[x] - upper[x]) + 2.0 * (lower[x + 1] - upper[x + 1]) + (lower[x + 2] - upper[x + 2]);
    (gx, gy)
}
