//! One cell of the grid, a dot and the ground around it, as samples of the contrast image.

use crate::calibration::{lattice::Label, working_image::sample};
use crate::imaging::Plane;
use crate::types::Homography;

/// Samples per cell along each axis.
pub(super) const SIDE: usize = 4;
/// Samples per cell.
pub(super) const CELL: usize = SIDE * SIDE;
/// Fewest samples of a cell that must be in the image.
const MIN_INSIDE: usize = 8;

/// The samples of a cell; `None` outside the image.
pub(super) type Samples = [Option<f32>; CELL];

/// One cell: its centre and the two grid steps there, px.
pub(super) struct Cell {
    at: [f64; 2],
    steps: [[f64; 2]; 2],
}

impl Cell {
    /// The cell at `label` of the `grid`, centred on the measured position where there is one.
    pub(super) fn new(grid: &Homography, label: Label, measured: Option<[f64; 2]>) -> Self {
        let to = |dx: f64, dy: f64| grid.apply([f64::from(label[0]) + dx, f64::from(label[1]) + dy]);
        let step = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
        let steps = [step(to(0.5, 0.0), to(-0.5, 0.0)), step(to(0.0, 0.5), to(0.0, -0.5))];
        Self { at: measured.unwrap_or_else(|| to(0.0, 0.0)), steps }
    }

    /// Mean over the points of sample `n`, with `points` points along each axis; `None` when one is outside.
    fn sample(&self, plane: &Plane<f32>, n: usize, points: usize) -> Option<f32> {
        let mut sum = 0.0_f32;
        for q in 0..points * points {
            let along = |k: usize, q: usize| (k as f64 + (q as f64 + 0.5) / points as f64) / SIDE as f64 - 0.5;
            let (u, v) = (along(n % SIDE, q % points), along(n / SIDE, q / points));
            sum += sample(plane, [0, 1].map(|a| self.at[a] + u * self.steps[0][a] + v * self.steps[1][a]))?;
        }
        Some(sum / (points * points) as f32)
    }

    /// `None` when too much of the cell is outside.
    pub(super) fn samples(&self, plane: &Plane<f32>, points: usize) -> Option<Samples> {
        let near = |v: f64, size: usize| v > -1e6 && v < size as f64 + 1e6;
        if !near(self.at[0], plane.width) || !near(self.at[1], plane.height) {
            return None;
        }
        let out: Samples = std::array::from_fn(|n| self.sample(plane, n, points).filter(|v| v.is_finite()));
        (out.iter().flatten().count() >= MIN_INSIDE).then_some(out)
    }
}
