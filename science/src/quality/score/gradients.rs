//! Gradient preservation (Xydeas and Petrovic) against the slice with the strongest gradient at each pixel.

use super::{
    pixel_weights::{PixelWeights, whole_neighbourhoods},
    sums::ScoreSums,
};
use crate::{
    imaging::Plane,
    quality::{deterministic_sum, xydeas},
};

/// The strongest Sobel gradient over the slices so far, per inner pixel of a block; energy -1 without a slice.
#[derive(Debug)]
pub(super) struct Gradients {
    inner: (usize, usize),
    energy: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
    /// Gradients of one row of the current slice.
    row: Row,
}

/// Sobel gradients of a row.
#[derive(Debug)]
struct Row {
    gx: Vec<f32>,
    gy: Vec<f32>,
    energy: Vec<f32>,
}

impl Row {
    fn new(width: usize) -> Self {
        Self { gx: vec![0.0; width], gy: vec![0.0; width], energy: vec![0.0; width] }
    }

    fn fill(&mut self, [upper, middle, lower]: [&[f32]; 3]) {
        let inner = self.gx.len();
        let [upper, middle, lower] = [upper, middle, lower].map(|row| &row[..inner + 2]);
        let (gx, gy, energy) = (&mut self.gx[..inner], &mut self.gy[..inner], &mut self.energy[..inner]);
        for x in 0..inner {
            let (x_part, y_part) = sobel(upper, middle, lower, x);
            gx[x] = x_part;
            gy[x] = y_part;
            energy[x] = x_part * x_part + y_part * y_part;
        }
    }
}

impl Gradients {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let inner = (width.saturating_sub(2), height.saturating_sub(2));
        let pixels = inner.0 * inner.1;
        Self { inner, energy: vec![-1.0; pixels], gx: vec![0.0; pixels], gy: vec![0.0; pixels], row: Row::new(inner.0) }
    }

    /// Adds the next slice; `holes` is its validity if it does not cover the whole block. Of equally strong gradients
    /// the first is kept.
    pub(super) fn slice(&mut self, luma: &Plane<f32>, holes: Option<&Plane<u8>>) {
        if self.energy.is_empty() {
            return;
        }
        let valid = holes.map(|valid| whole_neighbourhoods(valid, 3));
        let width = self.inner.0;
        for y in 0..self.inner.1 {
            self.row.fill([luma.row(y), luma.row(y + 1), luma.row(y + 2)]);
            if let Some(valid) = &valid {
                for (energy, &valid) in self.row.energy.iter_mut().zip(valid.row(y)) {
                    *energy = if valid != 0 { *energy } else { -1.0 };
                }
            }
            let range = y * width..(y + 1) * width;
            let (best, gx, gy) = (&mut self.energy[range.clone()], &mut self.gx[range.clone()], &mut self.gy[range]);
            let (here, here_gx, here_gy) = (&self.row.energy[..width], &self.row.gx[..width], &self.row.gy[..width]);
            for x in 0..width {
                let better = here[x] > best[x];
                best[x] = if better { here[x] } else { best[x] };
                gx[x] = if better { here_gx[x] } else { gx[x] };
                gy[x] = if better { here_gy[x] } else { gy[x] };
            }
        }
    }

    /// Compares with the fused image, at pixels that count and whose neighbourhood is covered.
    pub(super) fn sum(&self, fused: &Plane<f32>, counts: &PixelWeights, covered: &PixelWeights, sums: &mut ScoreSums) {
        if self.energy.is_empty() {
            return;
        }
        let neighbours = covered.whole_neighbourhoods(3);
        let width = self.inner.0;
        let mut of_fused = Row::new(width);
        let [mut weights, mut source, mut strength, mut kept, mut laplacian, mut squares] =
            [(); 6].map(|()| vec![0.0f32; width]);
        for y in 0..self.inner.1 {
            let rows = [fused.row(y), fused.row(y + 1), fused.row(y + 2)];
            for ((weight, counts), neighbours) in
                weights.iter_mut().zip(&counts.weights.row(y + 1)[1..]).zip(neighbours.row(y))
            {
                *weight = counts * neighbours;
            }
            let count = deterministic_sum::sum(&weights);
            if count == 0.0 {
                continue;
            }
            of_fused.fill(rows);
            laplacians(rows, &mut laplacian, &mut squares);
            sums.tenengrad.add(deterministic_sum::dot(&of_fused.energy, &weights), count);
            sums.laplacian.add(deterministic_sum::dot(&laplacian, &weights), count);
            sums.laplacian_squares.add(deterministic_sum::dot(&squares, &weights), count);

            let range = y * width..(y + 1) * width;
            let energy = &self.energy[range.clone()];
            for (weight, &energy) in weights.iter_mut().zip(energy) {
                // covered by several slices together but by no single one
                *weight = if energy >= 0.0 { *weight } else { 0.0 };
            }
            for ((source, strength), (&energy, weight)) in
                source.iter_mut().zip(&mut strength).zip(energy.iter().zip(&weights))
            {
                *source = energy.max(0.0);
                *strength = source.sqrt() * weight;
            }
            sums.retention
                .add(deterministic_sum::dot(&of_fused.energy, &weights), deterministic_sum::dot(&source, &weights));
            let best = (&self.gx[range.clone()], &self.gy[range]);
            xydeas::preservations(best, (&of_fused.gx, &of_fused.gy), &mut kept);
            sums.q_g.add(deterministic_sum::dot(&kept, &strength), deterministic_sum::sum(&strength));
        }
    }
}

/// 4-neighbour Laplacians of the middle row without its end pixels, and their squares.
fn laplacians([upper, middle, lower]: [&[f32]; 3], out: &mut [f32], squares: &mut [f32]) {
    let inner = out.len();
    let [upper, middle, lower] = [upper, middle, lower].map(|row| &row[..inner + 2]);
    let squares = &mut squares[..inner];
    for x in 0..inner {
        let value = upper[x + 1] + lower[x + 1] + middle[x] + middle[x + 2] - 4.0 * middle[x + 1];
        out[x] = value;
        squares[x] = value * value;
    }
}

/// Sobel gradient (x, y) at the centre of the 3x3 pixels that start at column `x`.
#[inline(always)]
pub(in crate::quality) fn sobel(upper: &[f32], middle: &[f32], lower: &[f32], x: usize) -> (f32, f32) {
    let gx = (upper[x + 2] - upper[x]) + 2.0 * (middle[x + 2] - middle[x]) + (lower[x + 2] - lower[x]);
    let gy = (lower[x] - upper[x]) + 2.0 * (lower[x + 1] - upper[x + 1]) + (lower[x + 2] - upper[x + 2]);
    (gx, gy)
}
