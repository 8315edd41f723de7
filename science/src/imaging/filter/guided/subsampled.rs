//! The fast guided filter (He and Sun 2015), for large radii and large `eps`: coefficients once per cell of 4 x 4 px.
//!
//! The coefficients `(a, b)` of neighbouring windows of 91 px hardly differ. So they are fitted at the centre of each
//! cell only, over windows of the full size (cells at the rim count in part), weighted by the number of valid pixels of
//! the cell. Their means are interpolated between cell centres and applied to the guide at full resolution. The results
//! are within 0.01 of those of the per-pixel kernels, mostly within 0.001, for a sixteenth of the work.
//!
//! The origin of a tile must be a multiple of [`CELL`], so that its cells are those of the whole image. All sums are
//! integers: neither tiling nor vector instructions change a bit.

mod cell_window;
mod kernels;

pub(super) use cell_window::CELL;

use super::window::{Guide, SCALE, clip};
use crate::imaging::{
    Plane, Rect,
    simd::{self, Avx2},
};
use cell_window::CellWindow;
use kernels::{UNIT, between, lines, spread, sum_cells};

/// Supported radii, px: large compared with a cell, and small enough for sums of squares of 52 bits.
const RADII: std::ops::RangeInclusive<usize> = 24..=63;
/// Smallest supported `eps`: below it the coefficients vary too much within a cell.
const LEAST_EPS: f64 = 0.05;
/// The kernel and its buffers.
#[derive(Debug)]
pub(super) struct Subsampled {
    simd: Option<Avx2>,
    eps: f64,
    window: CellWindow,
    /// Per cell: sums of `I`, `I p`, `p`, `I^2` and the number of valid pixels.
    sums: [Vec<u64>; 5],
    /// The same for the windows around the cells, times 64.
    fitted: [Vec<u64>; 5],
    /// `a`, `b` and 1, times the number of valid pixels of the cell.
    lines: [Vec<u64>; 3],
    averaged: [Vec<u64>; 3],
    /// Mean `a` per unit of the guide, and mean `b`, per cell.
    means: [Vec<f32>; 2],
    /// The same interpolated between rows of cells, and for each pixel of a row.
    between: [Vec<f32>; 2],
    of_pixels: [Vec<f32>; 2],
    rows: Buffers,
    inner: Rect,
    /// The cells that `means` covers.
    out: Rect,
    next: usize,
}

/// Copies of the pixel rows of one row of cells that are not valid throughout.
#[derive(Debug, Default)]
struct Buffers {
    grey: [Vec<u16>; CELL],
    map: [Vec<bool>; CELL],
}

impl Subsampled {
    /// `None` when the parameters need coefficients for each pixel.
    pub(super) fn new(simd: Option<Avx2>, radius: usize, eps: f64) -> Option<Self> {
        if !RADII.contains(&radius) || eps < LEAST_EPS {
            return None;
        }
        let nowhere = Rect { x: 0, y: 0, width: 0, height: 0 };
        Some(Self {
            simd,
            eps,
            window: CellWindow::new(radius),
            sums: Default::default(),
            fitted: Default::default(),
            lines: Default::default(),
            averaged: Default::default(),
            means: Default::default(),
            between: Default::default(),
            of_pixels: Default::default(),
            rows: Buffers::default(),
            inner: nowhere,
            out: nowhere,
            next: 0,
        })
    }

    /// Radius of the support, px: two windows, the cells of the interpolation, and the rest of the last cell.
    pub(super) fn reach(&self) -> usize {
        2 * CELL * (self.window.reach() + 1)
    }

    /// Prepares for the rows of `inner`.
    pub(super) fn start(&mut self, guide: Guide<'_>, map: &Plane<bool>, inner: Rect) {
        (self.inner, self.next) = (inner, inner.y);
        if inner.width == 0 || inner.height == 0 {
            return;
        }
        let columns = guide.grey.width.div_ceil(CELL);
        let rows = guide.grey.height.div_ceil(CELL);
        let first = [inner.x / CELL, inner.y / CELL];
        let last = [(inner.x + inner.width - 1) / CELL, (inner.y + inner.height - 1) / CELL];
        let own = Rect { x: first[0], y: first[1], width: last[0] - first[0] + 1, height: last[1] - first[1] + 1 };
        let out = own.grown(1, columns, rows);
        let centres = out.grown(self.window.reach(), columns, rows);
        let taps = centres.grown(self.window.reach(), columns, rows);
        self.out = out;
        self.count(guide, map, taps);
        for (sums, fitted) in self.sums.iter().zip(&mut self.fitted) {
            self.window.sums(self.simd, sums, taps, centres, fitted);
        }
        self.fit(taps, centres);
        for (lines, averaged) in self.lines.iter().zip(&mut self.averaged) {
            self.window.sums(self.simd, lines, centres, out, averaged);
        }
        self.average();
    }

    /// The sums of the cells `taps`.
    fn count(&mut self, guide: Guide<'_>, map: &Plane<bool>, taps: Rect) {
        let Self { simd, sums, rows, .. } = self;
        for sums in sums.iter_mut() {
            sums.resize(taps.width * taps.height, 0);
        }
        let [i, ip, p, ii, n] = sums;
        let width = taps.width * CELL;
        let start = taps.x * CELL;
        for cells in 0..taps.height {
            let line = cells * taps.width..(cells + 1) * taps.width;
            let n = &mut n[line.clone()];
            n.fill(0);
            let place = |k: usize| (taps.y + cells) * CELL + k;
            let mut whole = [false; CELL];
            for (k, (grey, map_row)) in rows.grey.iter_mut().zip(&mut rows.map).enumerate() {
                let y = place(k);
                let there = width.min(guide.grey.width - start);
                let span = match y < guide.grey.height {
                    true => clip(&guide.valid[y], start, there),
                    false => 0..0,
                };
                whole[k] = span == (0..width);
                if whole[k] {
                    n.iter_mut().for_each(|n| *n += CELL as u64);
                    continue;
                }
                grey.clear();
                grey.resize(span.start, 0);
                map_row.clear();
                map_row.resize(span.start, false);
                if !span.is_empty() {
                    let columns = start + span.start..start + span.end;
                    grey.extend_from_slice(&guide.grey.row(y)[columns.clone()]);
                    map_row.extend_from_slice(&map.row(y)[columns]);
                    for (cell, n) in n.iter_mut().enumerate() {
                        let end = span.end.min((cell + 1) * CELL);
                        *n += end.saturating_sub(span.start.max(cell * CELL)) as u64;
                    }
                }
                grey.resize(width, 0);
                map_row.resize(width, false);
            }
            let columns = start..start + width;
            let grey = std::array::from_fn(|k| match whole[k] {
                true => &guide.grey.row(place(k))[columns.clone()],
                false => rows.grey[k].as_slice(),
            });
            let map = std::array::from_fn(|k| match whole[k] {
                true => &map.row(place(k))[columns.clone()],
                false => rows.map[k].as_slice(),
            });
            let sums = [&mut i[line.clone()], &mut ip[line.clone()], &mut p[line.clone()], &mut ii[line]];
            simd::run(
                *simd,
                #[inline(always)]
                || sum_cells(grey, map, sums),
            );
        }
    }

    /// The coefficients of the cells `centres`.
    fn fit(&mut self, taps: Rect, centres: Rect) {
        for lines in &mut self.lines {
            lines.resize(centres.width * centres.height, 0);
        }
        let [a, b, ones] = &mut self.lines;
        for row in 0..centres.height {
            let line = row * centres.width..(row + 1) * centres.width;
            let own = (centres.y - taps.y + row) * taps.width + centres.x - taps.x;
            let own = &self.sums[4][own..own + centres.width];
            let sums = self.fitted.each_ref().map(|sums| &sums[line.clone()]);
            let (a, b) = (&mut a[line.clone()], &mut b[line.clone()]);
            ones[line].copy_from_slice(own);
            let eps = self.eps;
            simd::run(
                self.simd,
                #[inline(always)]
                || lines(sums, own, eps, a, b),
            );
        }
    }

    /// Means of the coefficients, per cell of `out`.
    fn average(&mut self) {
        let [a, b, ones] = &self.averaged;
        let [mean_a, mean_b] = &mut self.means;
        mean_a.clear();
        mean_b.clear();
        for ((&a, &b), &ones) in a.iter().zip(b).zip(ones) {
            let share = if ones > 0 { 1.0 / (ones as f64 * UNIT) } else { 0.0 };
            mean_a.push((a.cast_signed() as f64 * (share / SCALE)) as f32);
            mean_b.push((b.cast_signed() as f64 * share) as f32);
        }
    }

    /// The next row of `inner`. The guide is the one passed to [`Self::start`].
    pub(super) fn row(&mut self, guide: Guide<'_>, out: &mut [f32]) {
        let (inner, cells, y) = (self.inner, self.out, self.next);
        self.next += 1;
        let (above, share) = between(y);
        let last = cells.y + cells.height - 1;
        let rows = [above.max(cells.y as isize) as usize, (above + 1).min(last as isize) as usize];
        let rows = rows.map(|row| (row - cells.y) * cells.width..(row - cells.y + 1) * cells.width);
        let [rows_above, rows_below] = rows;
        for ((means, between), of_pixels) in self.means.iter().zip(&mut self.between).zip(&mut self.of_pixels) {
            let (above, below) = (&means[rows_above.clone()], &means[rows_below.clone()]);
            between.clear();
            // beyond the outermost cells their values go on
            between.push(0.0);
            between.extend(above.iter().zip(below).map(|(above, below)| above + share * (below - above)));
            between[0] = between[1];
            between.push(between[cells.width]);
            of_pixels.resize(CELL * (cells.width + 1), 0.0);
            simd::run(
                self.simd,
                #[inline(always)]
                || spread(between, of_pixels),
            );
        }
        // the first pixel between cells lies half a cell before the first cell
        let start = inner.x + CELL / 2 - cells.x * CELL;
        let [a, b] = self.of_pixels.each_ref().map(|values| &values[start..start + inner.width]);
        let grey = &guide.grey.row(y)[inner.x..inner.x + inner.width];
        for ((out, &grey), (a, b)) in out.iter_mut().zip(grey).zip(a.iter().zip(b)) {
            *out = a * f32::from(grey) + b;
        }
        let valid = clip(&guide.valid[y], inner.x, inner.width);
        out[..valid.start].fill(0.0);
        out[valid.end..].fill(0.0);
    }
}
