//! The quality index per 8x8 window against the slice with the largest variance there.

use super::{Sums, whole_neighbourhoods};
use crate::{imaging::Plane, quality::piella};

/// Side of a window, px (Piella & Heijmans 2003).
const SIDE: usize = 8;
const SAMPLES: f64 = (SIDE * SIDE) as f64;

/// Subtracted from every luma, so that squares stay small; no variance feels it.
const MIDDLE: f64 = 127.5;

/// Statistics per window of a tile: of the fused image, and of the slice with the largest variance so far.
#[derive(Debug)]
pub(super) struct Windows {
    across: usize,
    down: usize,
    fused: Vec<Moments>,
    best: Vec<Best>,
    columns: Columns,
}

#[derive(Debug, Clone, Copy)]
struct Moments {
    mean: f32,
    variance: f32,
}

#[derive(Debug, Clone, Copy)]
struct Best {
    mean: f32,
    variance: f32,
    covariance: f32,
}

/// Sums over eight rows per column: of a, a*a and a*b. In f64 they can run down the tile without drift.
#[derive(Debug)]
struct Columns {
    a: Vec<f64>,
    aa: Vec<f64>,
    ab: Vec<f64>,
}

impl Columns {
    fn new(width: usize) -> Self {
        Self { a: vec![0.0; width], aa: vec![0.0; width], ab: vec![0.0; width] }
    }

    fn clear(&mut self) {
        [&mut self.a, &mut self.aa, &mut self.ab].into_iter().for_each(|column| column.fill(0.0));
    }

    /// Adds row `a` (with its partner `b`), `sign` 1, or takes it away, `sign` -1.
    fn add(&mut self, a: &[f32], b: &[f32], sign: f64) {
        let width = self.a.len();
        let (a, b) = (&a[..width], &b[..width]);
        let (sum_a, sum_aa, sum_ab) = (&mut self.a[..width], &mut self.aa[..width], &mut self.ab[..width]);
        for x in 0..width {
            let (va, vb) = (f64::from(a[x]) - MIDDLE, f64::from(b[x]) - MIDDLE);
            sum_a[x] += sign * va;
            sum_aa[x] += sign * (va * va);
            sum_ab[x] += sign * (va * vb);
        }
    }
}

/// Sum of eight neighbours beginning at `x`, in pairs.
#[inline(always)]
fn eight(v: &[f64], x: usize) -> f64 {
    let v = &v[x..x + SIDE];
    ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]))
}

impl Windows {
    pub(super) fn new(fused: &Plane<f32>) -> Self {
        let fits = fused.width >= SIDE && fused.height >= SIDE;
        let (across, down) = if fits { (fused.width + 1 - SIDE, fused.height + 1 - SIDE) } else { (0, 0) };
        let none = Best { mean: 0.0, variance: -1.0, covariance: 0.0 };
        let mut windows = Self {
            across,
            down,
            fused: Vec::with_capacity(across * down),
            best: vec![none; across * down],
            columns: Columns::new(fused.width),
        };
        let mut moments = Vec::with_capacity(across * down);
        windows.each_row(fused, fused, |_, columns| {
            for x in 0..across {
                let mean = eight(&columns.a, x) / SAMPLES;
                let variance = eight(&columns.aa, x) / SAMPLES - mean * mean;
                moments.push(Moments { mean: mean as f32, variance: variance.max(0.0) as f32 });
            }
        });
        windows.fused = moments;
        windows
    }

    /// Runs down the rows of windows with the column sums of `a` and `a * b`.
    fn each_row(&mut self, a: &Plane<f32>, b: &Plane<f32>, mut row: impl FnMut(usize, &Columns)) {
        self.columns.clear();
        for y in 0..SIDE.min(if self.down > 0 { SIDE - 1 } else { 0 }) {
            self.columns.add(a.row(y), b.row(y), 1.0);
        }
        for y in 0..self.down {
            self.columns.add(a.row(y + SIDE - 1), b.row(y + SIDE - 1), 1.0);
            row(y, &self.columns);
            self.columns.add(a.row(y), b.row(y), -1.0);
        }
    }

    /// Takes the next slice; `holes` is its validity when it does not cover the whole tile.
    pub(super) fn slice(&mut self, fused: &Plane<f32>, luma: &Plane<f32>, holes: Option<&Plane<u8>>) {
        if self.best.is_empty() {
            return;
        }
        let valid = holes.map(|valid| whole_neighbourhoods(valid, SIDE));
        // what lies outside a slice may be anything: it must not reach the running sums
        let filled = holes.map(|valid| {
            let keep = |(&v, &c): (&f32, &u8)| if c == 0 { MIDDLE as f32 } else { v };
            let data = luma.data.iter().zip(&valid.data).map(keep).collect();
            Plane { width: luma.width, height: luma.height, data }
        });
        let luma = filled.as_ref().unwrap_or(luma);
        let across = self.across;
        let mut best = std::mem::take(&mut self.best);
        let moments = std::mem::take(&mut self.fused);
        self.each_row(luma, fused, |y, columns| {
            let range = y * across..(y + 1) * across;
            let start = range.start;
            for (x, (best, fused)) in best[range.clone()].iter_mut().zip(&moments[range]).enumerate() {
                let mean = eight(&columns.a, x) / SAMPLES;
                let variance = (eight(&columns.aa, x) / SAMPLES - mean * mean) as f32;
                let better = variance > best.variance && valid.as_ref().is_none_or(|valid| valid.data[start + x] != 0);
                if better {
                    let covariance = eight(&columns.ab, x) / SAMPLES - mean * f64::from(fused.mean);
                    *best = Best { mean: mean as f32, variance, covariance: covariance as f32 };
                }
            }
        });
        self.best = best;
        self.fused = moments;
    }

    /// Adds the windows of which every pixel counts.
    pub(super) fn sum(&self, counts: &Plane<u8>, sums: &mut Sums) {
        if self.best.is_empty() {
            return;
        }
        let whole = whole_neighbourhoods(counts, SIDE);
        for ((best, fused), &counts) in self.best.iter().zip(&self.fused).zip(&whole.data) {
            if counts == 0 || best.variance <= 0.0 {
                continue;
            }
            let source = piella::Moments { mean: f64::from(best.mean) + MIDDLE, variance: f64::from(best.variance) };
            let fused = piella::Moments { mean: f64::from(fused.mean) + MIDDLE, variance: f64::from(fused.variance) };
            let index = piella::index(source, fused, f64::from(best.covariance));
            sums.q_w.add(index * source.variance, source.variance);
        }
    }
}
