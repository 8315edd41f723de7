//! A slice as registration sees it: the fine detail of its grey image at several resolutions.

use rayon::prelude::*;

use crate::calibration::working_image::WorkingImage;
use crate::imaging::{Plane, Raster};

/// Pixels of the image in which slices are registered; a larger slice is averaged over squares first.
pub(super) const MAX_PIXELS: usize = 6_000_000;
/// Least length of the shorter side of the coarsest level, px.
const COARSEST: usize = 40;
/// Cells along the longer side of the image, in which detail and brightness are measured.
const CELLS: usize = 24;

/// A slice, registered or about to be.
pub(super) struct Picture {
    /// Detail at full resolution, then at half, and so on: a band of about an octave around a period of 8 px of the
    /// level.
    pub levels: Vec<Plane<f32>>,
    /// Px of the slice per px of the first level, along each axis.
    pub bin: usize,
    /// Mean brightness and mean squared detail of the cells.
    pub cells: Cells,
}

/// Measurements in a grid of squares.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    /// Cells across.
    pub columns: usize,
    /// Cells down.
    pub rows: usize,
    /// Side of a cell, px of the first level.
    pub side: usize,
    /// Mean grey level per cell, 0 to 255; not a number where a pixel in fifty is at full scale.
    pub brightness: Vec<f32>,
    /// Mean square of the first level per cell.
    pub detail: Vec<f32>,
}

impl Picture {
    /// Px of a slice of this size per px of the first level.
    pub(super) fn bin_of(width: usize, height: usize) -> usize {
        ((width * height) as f64 / MAX_PIXELS as f64).sqrt().ceil().max(1.0) as usize
    }

    /// Of a slice.
    pub(super) fn of(slice: &Raster) -> Self {
        let image = WorkingImage::of(slice, Self::bin_of(slice.width, slice.height));
        let mut plane = image.plane;
        let mut levels = vec![detail(&plane)];
        let cells = Cells::of(&plane, image.full.as_ref(), &levels[0]);
        while plane.width.min(plane.height) >= 2 * COARSEST {
            plane = halved(&plane);
            levels.push(detail(&plane));
        }
        Self { levels, bin: image.bin, cells }
    }

    /// Coordinates in level `level` to px of the slice.
    pub(super) fn to_slice(&self, level: usize, at: [f64; 2]) -> [f64; 2] {
        let side = self.side(level);
        at.map(|v| v * side + (side - 1.0) / 2.0)
    }

    /// Px of the slice to coordinates in level `level`.
    pub(super) fn to_level(&self, level: usize, at: [f64; 2]) -> [f64; 2] {
        let side = self.side(level);
        at.map(|v| (v - (side - 1.0) / 2.0) / side)
    }

    /// Px of the slice per px of level `level`.
    pub(super) fn side(&self, level: usize) -> f64 {
        (self.bin << level) as f64
    }

    /// Index of the cell around a point, px of the slice; `None` outside.
    pub(super) fn cell(&self, at: [f64; 2]) -> Option<usize> {
        let [x, y] = self.to_level(0, at).map(|v| (v + 0.5) / self.cells.side as f64);
        let is_inside = x >= 0.0 && y >= 0.0 && (x as usize) < self.cells.columns && (y as usize) < self.cells.rows;
        is_inside.then(|| y as usize * self.cells.columns + x as usize)
    }
}

impl Cells {
    fn of(plane: &Plane<f32>, full: Option<&Plane<f32>>, detail: &Plane<f32>) -> Self {
        let side = plane.width.max(plane.height).div_ceil(CELLS).max(1);
        let (columns, rows) = (plane.width.div_ceil(side), plane.height.div_ceil(side));
        let mean = |plane: &Plane<f32>, cell: usize, value: &dyn Fn(f32) -> f32| {
            let (x, y) = (cell % columns * side, cell / columns * side);
            let (right, bottom) = ((x + side).min(plane.width), (y + side).min(plane.height));
            let sum: f64 = (y..bottom).flat_map(|y| &plane.row(y)[x..right]).map(|v| f64::from(value(*v))).sum();
            (sum / ((right - x) * (bottom - y)) as f64) as f32
        };
        let brightness = |cell: usize| {
            let is_clipped = full.is_some_and(|full| mean(full, cell, &|v| v) > 0.02);
            if is_clipped { f32::NAN } else { mean(plane, cell, &|v| v) }
        };
        Self {
            columns,
            rows,
            side,
            brightness: (0..columns * rows).map(brightness).collect(),
            detail: (0..columns * rows).map(|cell| mean(detail, cell, &|v| v * v)).collect(),
        }
    }
}

/// The difference of two smooth copies (B-spline wavelet, "a trous"): no mean, no slow shading, little noise.
fn detail(plane: &Plane<f32>) -> Plane<f32> {
    let fine = smoothed(plane, 1);
    let coarse = smoothed(&fine, 2);
    let data = fine.data.par_iter().zip(&coarse.data).map(|(a, b)| a - b).collect();
    Plane { width: plane.width, height: plane.height, data }
}

/// Convolved with `[1 4 6 4 1] / 16` along both axes, taps `gap` px apart; the border is repeated.
fn smoothed(plane: &Plane<f32>, gap: usize) -> Plane<f32> {
    const TAPS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
    let (width, height) = (plane.width, plane.height);
    let mut data = vec![0.0_f32; width * height];
    data.par_chunks_exact_mut(width.max(1)).enumerate().for_each_init(
        || vec![0.0_f32; width + 4 * gap],
        |padded, (y, out)| {
            let row = |k: usize| plane.row((y + k * gap).saturating_sub(2 * gap).min(height - 1));
            let rows = [0, 1, 2, 3, 4].map(row);
            let middle = &mut padded[2 * gap..2 * gap + width];
            for (x, v) in middle.iter_mut().enumerate() {
                *v = (0..5).map(|k| TAPS[k] * rows[k][x]).sum();
            }
            let (first, last) = (middle[0], middle[width - 1]);
            padded[..2 * gap].fill(first);
            padded[2 * gap + width..].fill(last);
            for (x, v) in out.iter_mut().enumerate() {
                *v = (0..5).map(|k| TAPS[k] * padded[x + k * gap]).sum();
            }
        },
    );
    Plane { width, height, data }
}

/// Squares of 2 x 2 px averaged; an odd last row or column is dropped.
fn halved(plane: &Plane<f32>) -> Plane<f32> {
    Plane::from_fn(plane.width / 2, plane.height / 2, |x, y| {
        let (a, b) = (&plane.row(2 * y)[2 * x..2 * x + 2], &plane.row(2 * y + 1)[2 * x..2 * x + 2]);
        (a[0] + a[1] + b[0] + b[1]) / 4.0
    })
}
