//! The fingerprint of the grid in one slice: what makes its cells differ from each other.
//!
//! Input: the contrast image of a slice and the positions of its dots. Output: per cell of the grid (one dot and the
//! ground around it), and per cell of the continued grid beyond the outermost dots, its deviation from the mean cell:
//! missing dots, dirt, errors of print, the end of the grid, the table. The mean cell is removed because it is the same
//! after any shift by whole steps.

use std::sync::Arc;

use super::cells::{CELL, Cell, SIDE, Samples};
use super::presence::{Presence, presence};
use crate::calibration::lattice::{Label, MIN_DOTS, Places, label_range};
use crate::calibration::{dlt, statistics::median_of, working_image::WorkingImage};
use crate::imaging::Plane;
use crate::types::Homography;

/// Most cells of a fingerprint. A larger grid is cut to its middle.
pub(in crate::calibration) const MAX_CELLS: usize = 16_384;
/// Most memory of a fingerprint, bytes: one per sample, and one per cell.
pub(in crate::calibration) const MAX_BYTES: usize = MAX_CELLS * (CELL + 1);
/// Dots that the homography from labels to pixels is fitted to, at most.
const MAX_PAIRS: usize = 400;
/// Most points per sample along each axis.
const MAX_POINTS: usize = 8;
/// Deviations beyond this many times their RMS are cut: a single cell must not decide.
const CUT: f64 = 4.0;
/// Stored value of the RMS deviation; [`CUT`] times it fits into a byte.
const UNIT: f64 = 31.0;
/// Largest share of full-scale pixels in a cell.
const MAX_CLIPPED: f32 = 0.02;

/// Cells nearer to the border of the image than this, in grid steps, have deviations only where the grid ends before
/// the border. Dots that the border cuts disturb the flat field, which would be taken for a property of the target.
const BORDER: f64 = 1.0;

/// Marks samples outside the image, and near its border.
pub(super) const OUTSIDE: i8 = i8::MIN;
/// The fingerprint of a slice. Copies share what they hold.
#[derive(Debug, Clone)]
pub(in crate::calibration) struct Fingerprint {
    /// Label of the first cell.
    pub(super) origin: Label,
    /// Cells per row.
    pub(super) columns: usize,
    /// Rows of cells.
    pub(super) rows: usize,
    /// Per cell what it shows, row by row.
    pub(super) presence: Arc<[Presence]>,
    /// Per cell [`CELL`] deviations from the mean cell, row by row; [`OUTSIDE`] where the image ends.
    pub(super) samples: Arc<[i8]>,
    /// Grid coordinates (labels) -> px of the slice.
    pub(super) to_slice: Homography,
    /// Dot pitch, px of the slice.
    pub(super) pitch: f64,
}

impl Fingerprint {
    /// Measures the fingerprint. `places` are px of the working image. `None` when the grid is degenerate.
    pub(in crate::calibration) fn measure(
        image: &WorkingImage,
        contrast: &Plane<f32>,
        places: &Places,
        pitch: f64,
    ) -> Option<Self> {
        let every = places.len().div_ceil(MAX_PAIRS).max(1);
        let pairs = |to: &dyn Fn([f64; 2]) -> [f64; 2]| -> Vec<dlt::Pair> {
            places.iter().step_by(every).map(|(l, p)| (l.map(f64::from), to(*p))).collect()
        };
        let grid = dlt::fit(&pairs(&|p| p))?;
        let to_slice = dlt::fit(&pairs(&|p| image.to_slice(p)))?;
        let (origin, columns, rows) = extent(&grid, contrast, places)?;
        let count = columns * rows;
        let label = |k: usize| [origin[0] + (k % columns) as i32, origin[1] + (k / columns) as i32];
        let points = ((pitch / SIDE as f64 / 1.5).ceil() as usize).clamp(3, MAX_POINTS);
        let cells: Vec<Option<Samples>> = (0..count)
            .map(|k| {
                let at = label(k);
                let cell = Cell::new(&grid, at, places.get(&at).copied());
                let clipped = image.full.as_ref().and_then(|full| cell.samples(full, points));
                let is_clipped = clipped.is_some_and(|c| c.iter().flatten().any(|share| *share > MAX_CLIPPED));
                (!is_clipped).then(|| cell.samples(contrast, points)).flatten()
            })
            .collect();
        let known: Vec<usize> = (0..count).filter(|&k| cells[k].is_some() && places.contains_key(&label(k))).collect();
        if known.len() < MIN_DOTS {
            return None;
        }
        let pattern: [f64; CELL] = std::array::from_fn(|n| {
            median_of(known.iter().filter_map(|&k| cells[k].and_then(|c| c[n]).map(f64::from)))
        });
        let presence = presence(&cells, &pattern, &known);
        // distance from the border of the image, grid steps
        let inside = |l: Label| {
            let [x, y] = grid.apply(l.map(f64::from));
            let (right, bottom) = (contrast.width as f64 - 1.0 - x, contrast.height as f64 - 1.0 - y);
            x.min(y).min(right).min(bottom) / pitch
        };
        let is_no_dot = |label: Label| {
            let k = cell_index(label, origin, columns, rows);
            k.is_some_and(|k| matches!(presence[k], Presence::Gap | Presence::Unclear))
        };
        let is_clear = |k: usize| {
            let [x, y] = label(k);
            let mut around = (-1..=1).flat_map(|j| (-1..=1).map(move |i| [x + i, y + j]));
            inside([x, y]) >= BORDER || around.all(|l| !(-0.1..1.0).contains(&inside(l)) || is_no_dot(l))
        };
        let clear: Vec<Option<Samples>> =
            cells.into_iter().enumerate().map(|(k, cell)| cell.filter(|_| is_clear(k))).collect();
        let samples = deviations(&clear, &pattern, columns);
        let (presence, samples) = (presence.into(), samples.into());
        Some(Self { origin, columns, rows, presence, samples, to_slice, pitch: pitch * image.bin as f64 })
    }

    /// Number of the cell with this label; `None` beyond the fingerprint or where the cell is invalid.
    pub(super) fn cell(&self, label: Label) -> Option<usize> {
        let k = cell_index(label, self.origin, self.columns, self.rows)?;
        (self.presence[k] != Presence::Invalid).then_some(k)
    }

    /// Labels and numbers of the valid cells.
    pub(super) fn cells(&self) -> impl Iterator<Item = (Label, usize)> + '_ {
        let label = |k: usize| [self.origin[0] + (k % self.columns) as i32, self.origin[1] + (k / self.columns) as i32];
        (0..self.presence.len()).filter(|&k| self.presence[k] != Presence::Invalid).map(move |k| (label(k), k))
    }

    /// The deviations of cell `k`.
    pub(super) fn deviations(&self, k: usize) -> &[i8] {
        &self.samples[k * CELL..(k + 1) * CELL]
    }

    /// The deviation at grid coordinates `at`, interpolated; `None` beyond the valid cells.
    pub(super) fn deviation_at(&self, at: [f64; 2]) -> Option<f64> {
        // in samples from the first sample of the first cell
        let [x, y] = [0, 1].map(|a| (at[a] - f64::from(self.origin[a]) + 0.5) * SIDE as f64 - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let value = |x: f64, y: f64| {
            let label = [0, 1].map(|a| self.origin[a] + ([x, y][a] / SIDE as f64).floor() as i32);
            let inside = [x, y].map(|v| v.rem_euclid(SIDE as f64) as usize);
            let sample = self.samples[self.cell(label)? * CELL + inside[1] * SIDE + inside[0]];
            (sample != OUTSIDE).then(|| f64::from(sample))
        };
        let (fx, fy) = (x - x0, y - y0);
        let top = value(x0, y0)? * (1.0 - fx) + value(x0 + 1.0, y0)? * fx;
        let bottom = value(x0, y0 + 1.0)? * (1.0 - fx) + value(x0 + 1.0, y0 + 1.0)? * fx;
        Some(top * (1.0 - fy) + bottom * fy)
    }

    /// The fingerprint of the target turned or mirrored about its middle cell: the cell at `middle + d` becomes that at
    /// `middle + turn(d)`. `turn` is one of the 8 symmetries of the square grid.
    pub(super) fn turned(&self, turn: impl Fn([i32; 2]) -> [i32; 2]) -> Self {
        let middle = [self.origin[0] + self.columns as i32 / 2, self.origin[1] + self.rows as i32 / 2];
        let about = |l: Label| {
            let [x, y] = turn([l[0] - middle[0], l[1] - middle[1]]);
            [middle[0] + x, middle[1] + y]
        };
        let last = [self.origin[0] + self.columns as i32 - 1, self.origin[1] + self.rows as i32 - 1];
        let (a, b) = (about(self.origin), about(last));
        let origin = [a[0].min(b[0]), a[1].min(b[1])];
        let columns = (a[0] - b[0]).unsigned_abs() as usize + 1;
        let rows = (a[1] - b[1]).unsigned_abs() as usize + 1;
        let mut presence = vec![Presence::Invalid; columns * rows];
        let mut samples = vec![OUTSIDE; columns * rows * CELL];
        for (label, k) in self.cells() {
            let to = about(label);
            let n = (to[1] - origin[1]) as usize * columns + (to[0] - origin[0]) as usize;
            presence[n] = self.presence[k];
            for (i, value) in self.deviations(k).iter().enumerate() {
                // positions of samples in a cell are odd multiples of half a sample
                let side = SIDE as i32;
                let [x, y] = turn([2 * (i as i32 % side) - side + 1, 2 * (i as i32 / side) - side + 1]);
                let [x, y] = [x, y].map(|v| ((v + side - 1) / 2) as usize);
                samples[n * CELL + y * SIDE + x] = *value;
            }
        }
        Self { origin, columns, rows, presence: presence.into(), samples: samples.into(), ..*self }
    }

    /// Adds `shift` to all labels.
    pub(in crate::calibration) fn relabel(&mut self, shift: Label) {
        self.origin = [self.origin[0] + shift[0], self.origin[1] + shift[1]];
        let [a, b, c, d, e, f, g, h, i] = self.to_slice.0;
        let [x, y] = shift.map(f64::from);
        // the old labels are the new ones minus the shift
        let moved = [a, b, c - a * x - b * y, d, e, f - d * x - e * y, g, h, i - g * x - h * y];
        self.to_slice = Homography(moved.map(|v| v / moved[8]));
    }
}

/// Number of the cell with this label; `None` beyond the fingerprint.
fn cell_index(label: Label, origin: Label, columns: usize, rows: usize) -> Option<usize> {
    let [x, y] = [0, 1].map(|a| usize::try_from(label[a] - origin[a]).ok());
    Some(y.filter(|y| *y < rows)? * columns + x.filter(|x| *x < columns)?)
}

/// Cells of a range of labels.
pub(super) fn size(range: [i32; 2]) -> usize {
    (i64::from(range[1]) - i64::from(range[0]) + 1).max(1) as usize
}

/// Cuts the ranges of columns and rows to their middle, for at most [`MAX_CELLS`] cells.
pub(super) fn cut(ranges: &mut [[i32; 2]; 2]) {
    while size(ranges[0]).saturating_mul(size(ranges[1])) > MAX_CELLS {
        let longer = usize::from(size(ranges[1]) > size(ranges[0]));
        ranges[longer] = [ranges[longer][0] + 1, ranges[longer][1] - 1];
    }
}

/// First label, columns and rows of the cells that the image shows.
fn extent(grid: &Homography, plane: &Plane<f32>, places: &Places) -> Option<(Label, usize, usize)> {
    let back = grid.inverse()?;
    let (right, bottom) = (plane.width as f64 - 1.0, plane.height as f64 - 1.0);
    let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|p| back.apply(p));
    let mut ranges = [0, 1].map(|axis: usize| {
        let (low, high) = label_range(places.keys().copied(), axis);
        let seen = corners.iter().fold((low, high), |b, p| {
            // with strong perspective a corner may lie beyond the horizon
            let at = p[axis].clamp(f64::from(low) - 64.0, f64::from(high) + 64.0);
            if at.is_finite() { (b.0.min(at.floor() as i32), b.1.max(at.ceil() as i32)) } else { b }
        });
        [seen.0, seen.1]
    });
    cut(&mut ranges);
    Some(([ranges[0][0], ranges[1][0]], size(ranges[0]), size(ranges[1])))
}

/// Deviations from the mean cell, without what varies slowly from cell to cell (light, contrast, the shape of the
/// dots), in units of their RMS. What varies slowly looks the same after a shift by one step, and would outweigh what
/// does not.
fn deviations(cells: &[Option<Samples>], pattern: &[f64; CELL], columns: usize) -> Vec<i8> {
    let off =
        |cell: &Samples| -> [Option<f64>; CELL] { std::array::from_fn(|n| cell[n].map(|v| f64::from(v) - pattern[n])) };
    let offs: Vec<Option<[Option<f64>; CELL]>> = cells.iter().map(|cell| cell.as_ref().map(off)).collect();
    let (columns, rows) = (columns as i32, (cells.len() / columns) as i32);
    // per sample the mean over the cells around
    let around = |k: usize| -> [f64; CELL] {
        let [x, y] = [k as i32 % columns, k as i32 / columns];
        let near = (-2..=2).flat_map(|j| (-2..=2).map(move |i| [x + i, y + j]));
        let inside = near.filter(|[x, y]| (0..columns).contains(x) && (0..rows).contains(y));
        let mut sums = [[0.0; 2]; CELL];
        for off in inside.filter_map(|[x, y]| offs[(y * columns + x) as usize].as_ref()) {
            for (sum, v) in sums.iter_mut().zip(off) {
                *sum = v.map_or(*sum, |v| [sum[0] + v, sum[1] + 1.0]);
            }
        }
        sums.map(|[sum, count]| sum / count.max(1.0))
    };
    let mut out: Vec<Option<f64>> = vec![None; cells.len() * CELL];
    for (k, off) in offs.iter().enumerate() {
        let Some(off) = off else { continue };
        let slow = around(k);
        for ((out, v), slow) in out[k * CELL..].iter_mut().zip(off).zip(slow) {
            *out = v.map(|v| v - slow);
        }
    }
    let (sum, count) = out.iter().flatten().fold((0.0, 0.0), |s, v| (s.0 + v * v, s.1 + 1.0_f64));
    let rms = (sum / count.max(1.0)).sqrt().max(1e-9);
    out.iter().map(|v| v.map_or(OUTSIDE, |v| ((v / rms).clamp(-CUT, CUT) * UNIT).round() as i8)).collect()
}
