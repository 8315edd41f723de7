//! Quality index (Piella and Heijmans) per 8x8 window, against the slice with the largest variance in the window.

use super::{
    pixel_weights::{PixelWeights, whole_neighbourhoods},
    sums::ScoreSums,
};
use crate::{
    imaging::Plane,
    quality::{
        deterministic_sum,
        piella::{self, SIDE},
    },
};

const SAMPLES: f32 = (SIDE * SIDE) as f32;

/// Statistics per window of a block: of the fused image, and of the slice with the largest variance so far. The mean of
/// the block is subtracted from every luma, so that squares stay small; variances do not change.
#[derive(Debug)]
pub(super) struct Windows {
    across: usize,
    down: usize,
    middle: f32,
    fused: Plane<f32>,
    fused_mean: Vec<f32>,
    fused_variance: Vec<f32>,
    /// Of the best slice so far; variance -1 without one.
    mean: Vec<f32>,
    variance: Vec<f32>,
    covariance: Vec<f32>,
    /// Of the current slice: window sums of its luma, of its square, and of its product with the fused image.
    sums: [BoxSums; 3],
}

impl Windows {
    pub(super) fn new(fused: &Plane<f32>) -> Self {
        let fits = fused.width >= SIDE && fused.height >= SIDE;
        let (across, down) = if fits { (fused.width + 1 - SIDE, fused.height + 1 - SIDE) } else { (0, 0) };
        let windows = across * down;
        let middle = (deterministic_sum::sum(&fused.data) / fused.data.len().max(1) as f64) as f32;
        // pixels that no slice covers are arbitrary, possibly NaN
        let middle = if middle.is_finite() { middle } else { 127.5 };
        let mut new = Self {
            across,
            down,
            middle,
            fused: fused.map(|v| v - middle),
            fused_mean: vec![0.0; windows],
            fused_variance: vec![0.0; windows],
            mean: vec![0.0; windows],
            variance: vec![-1.0; windows],
            covariance: vec![0.0; windows],
            sums: [(); 3].map(|()| BoxSums::new(if fits { (fused.width, fused.height) } else { (0, 0) })),
        };
        let [one, two, _] = &mut new.sums;
        one.fill(|y, out| out.copy_from_slice(new.fused.row(y)));
        two.fill(|y, out| product(out, new.fused.row(y), new.fused.row(y)));
        for y in 0..down {
            let row = y * across..(y + 1) * across;
            let stored = new.fused_mean[row.clone()].iter_mut().zip(&mut new.fused_variance[row]);
            for ((mean, variance), (sum, squares)) in stored.zip(one.row(y).iter().zip(two.row(y))) {
                *mean = sum / SAMPLES;
                *variance = (squares / SAMPLES - *mean * *mean).max(0.0);
            }
        }
        new
    }

    /// Adds the next slice; `holes` is its validity if it does not cover the whole block.
    pub(super) fn slice(&mut self, luma: &Plane<f32>, holes: Option<&Plane<u8>>) {
        if self.variance.is_empty() {
            return;
        }
        let middle = self.middle;
        let luma = match holes {
            None => luma.map(|v| v - middle),
            // pixels outside a slice are arbitrary, possibly NaN, and must not reach the sums
            Some(valid) => {
                let keep = |(&v, &c): (&f32, &u8)| if c == 0 { 0.0 } else { v - middle };
                let data = luma.data.iter().zip(&valid.data).map(keep).collect();
                Plane { width: luma.width, height: luma.height, data }
            }
        };
        let [one, two, cross] = &mut self.sums;
        one.fill(|y, out| out.copy_from_slice(luma.row(y)));
        two.fill(|y, out| product(out, luma.row(y), luma.row(y)));
        cross.fill(|y, out| product(out, luma.row(y), self.fused.row(y)));
        let valid = holes.map(|valid| whole_neighbourhoods(valid, SIDE));
        let across = self.across;
        let mut spreads = vec![0.0f32; across];
        for y in 0..self.down {
            let row = y * across..(y + 1) * across;
            let (sum, squares, products) = (&one.row(y)[..across], &two.row(y)[..across], &cross.row(y)[..across]);
            for x in 0..across {
                let mean = sum[x] * (1.0 / SAMPLES);
                let spread = squares[x] * (1.0 / SAMPLES) - mean * mean;
                // rounding may make a variance negative
                spreads[x] = if spread > 0.0 { spread } else { 0.0 };
            }
            if let Some(valid) = &valid {
                for (spread, &valid) in spreads.iter_mut().zip(valid.row(y)) {
                    *spread = if valid != 0 { *spread } else { -1.0 };
                }
            }
            let fused_mean = &self.fused_mean[row.clone()];
            let mean = &mut self.mean[row.clone()];
            let variance = &mut self.variance[row.clone()];
            let covariance = &mut self.covariance[row];
            for x in 0..across {
                let here = sum[x] * (1.0 / SAMPLES);
                let common = products[x] * (1.0 / SAMPLES) - here * fused_mean[x];
                let better = spreads[x] > variance[x];
                mean[x] = if better { here } else { mean[x] };
                variance[x] = if better { spreads[x] } else { variance[x] };
                covariance[x] = if better { common } else { covariance[x] };
            }
        }
    }

    /// Sums the windows whose pixels all count.
    pub(super) fn sum(&self, counts: &PixelWeights, sums: &mut ScoreSums) {
        if self.variance.is_empty() {
            return;
        }
        let whole = counts.whole_neighbourhoods(SIDE);
        let (mut index, mut weights) = (vec![0.0f32; self.across], vec![0.0f32; self.across]);
        for y in 0..self.down {
            let row = y * self.across..(y + 1) * self.across;
            let best =
                self.mean[row.clone()].iter().zip(&self.variance[row.clone()]).zip(&self.covariance[row.clone()]);
            let fused = self.fused_mean[row.clone()].iter().zip(&self.fused_variance[row]);
            let out = index.iter_mut().zip(&mut weights).zip(whole.row(y));
            for (((index, weight), counts), (((mean, variance), covariance), (fused_mean, fused_variance))) in
                out.zip(best.zip(fused))
            {
                let variance = if *variance > 0.0 { *variance } else { 0.0 };
                let (source, fused) = ((mean + self.middle, variance), (fused_mean + self.middle, *fused_variance));
                *index = piella::index_of_many(source, fused, *covariance);
                *weight = variance * counts;
            }
            sums.q_w.add(deterministic_sum::dot(&index, &weights), deterministic_sum::sum(&weights));
        }
    }
}

fn product(out: &mut [f32], a: &[f32], b: &[f32]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a * b;
    }
}

/// Sums over all 8x8 windows of a plane, by doubling: sums of 2 neighbours, of 2 such sums, and of 2 of those. Unlike
/// running sums they accumulate no rounding errors, and every step is an addition of rows.
#[derive(Debug)]
struct BoxSums {
    width: usize,
    height: usize,
    /// Sums per upper left corner; the last 7 columns and rows are meaningless.
    data: Vec<f32>,
    line: Vec<f32>,
}

impl BoxSums {
    fn new((width, height): (usize, usize)) -> Self {
        Self { width, height, data: vec![0.0; width * height], line: vec![0.0; width] }
    }

    /// Computes the sums of the plane whose rows `row` writes.
    fn fill(&mut self, row: impl Fn(usize, &mut [f32])) {
        let width = self.width;
        if width == 0 {
            return;
        }
        for (y, sums) in self.data.chunks_exact_mut(width).enumerate() {
            row(y, &mut self.line);
            pairs(sums, &self.line, 1);
            pairs(&mut self.line, sums, 2);
            pairs(sums, &self.line, 4);
        }
        for step in [1, 2, 4] {
            for y in 0..self.height - step {
                let (upper, lower) = self.data.split_at_mut((y + step) * width);
                let row = &mut upper[y * width..(y + 1) * width];
                row.iter_mut().zip(&lower[..width]).for_each(|(sum, below)| *sum += below);
            }
        }
    }

    /// The sums of the windows that start in row `y`.
    fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width - (SIDE - 1)]
    }
}

/// Sums of values that are `step` apart.
fn pairs(out: &mut [f32], values: &[f32], step: usize) {
    for ((out, one), other) in out.iter_mut().zip(values).zip(&values[step..]) {
        *out = one + other;
    }
}
