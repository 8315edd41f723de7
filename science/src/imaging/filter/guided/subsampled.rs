//! The fast guided filter (He and Sun 2015), for large radii and large `eps`: coefficients once per cell of 4 x 4 px.
//!
//! The coefficients `(a, b)` of neighbouring windows of 91 px hardly differ. So they are fitted at the centre of each
//! cell only, over windows of the full size (cells at the rim count in part), weighted by the number of valid pixels of
//! the cell. Their means are interpolated between cell centres and applied to the guide at full resolution. The results
//! are within 0.01 of those of the per-pixel kernels, mostly within 0.001, for a sixteenth of the work.
//!
//! The origin of a tile must be a multiple of [`CELL`], so that its cells are those of the whole image. All sums are
//! integers: neither tiling nor vector instructions change a bit.

use super::{Guide, SCALE, clip};
use crate::imaging::{
    Plane, Rect,
    simd::{self, Avx2},
};

/// Side of a cell, px.
pub(super) const CELL: usize = 4;
/// Supported radii, px: large compared with a cell, and small enough for sums of squares of 52 bits.
const RADII: std::ops::RangeInclusive<usize> = 24..=63;
/// Smallest supported `eps`: below it the coefficients vary too much within a cell.
const LEAST_EPS: f64 = 0.05;
/// Coefficients are stored in units of 2^-20.
const UNIT: f64 = 1_048_576.0;
const TWO_52: f64 = 4_503_599_627_370_496.0;
const TWO_52_BITS: u64 = 0x4330_0000_0000_0000;
/// Adding this to a number below 2^31 rounds it to an integer, which is in the low bits of the sum.
const ROUNDER: f64 = 1.5 * TWO_52;

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

/// A window of `2 whole + 1` cells, and `edge` eighths of the next cells on both sides.
#[derive(Debug, Clone)]
struct CellWindow {
    whole: usize,
    edge: u64,
    down: Vec<u64>,
    weighted: Vec<u64>,
    running: Vec<u64>,
}

impl CellWindow {
    fn new(radius: usize) -> Self {
        let side = 2 * radius + 1;
        let whole = (side / CELL - 1) / 2;
        let edge = (side - CELL * (2 * whole + 1)) as u64;
        Self { whole, edge, down: Vec::new(), weighted: Vec::new(), running: Vec::new() }
    }

    /// Radius of the window, cells.
    fn reach(&self) -> usize {
        self.whole + 1
    }

    /// Sums of `source` (the cells `from`) over the windows around the cells `to`, times 64. Cells outside `from` count
    /// as zero.
    fn sums(&mut self, simd: Option<Avx2>, source: &[u64], from: Rect, to: Rect, out: &mut Vec<u64>) {
        let (reach, edge) = (self.reach(), self.edge);
        let Self { whole, down, weighted, running, .. } = self;
        let padded = to.width + 2 * reach;
        // index of the first column of `from` among the columns of all windows
        let left = from.x + reach - to.x;
        down.clear();
        down.resize(from.width, 0);
        weighted.clear();
        weighted.resize(padded, 0);
        running.resize(padded + 1, 0);
        out.resize(to.width * to.height, 0);
        let row = |y: usize| &source[(y - from.y) * from.width..][..from.width];
        let end = from.y + from.height;
        let mut held = from.y..from.y;
        for (y, out) in (to.y..).zip(out.chunks_exact_mut(to.width.max(1))) {
            let wanted = y.saturating_sub(*whole).max(from.y)..(y + *whole + 1).min(end);
            for y in held.end..wanted.end {
                down.iter_mut().zip(row(y)).for_each(|(sum, v)| *sum = sum.wrapping_add(*v));
            }
            for y in held.start..wanted.start {
                down.iter_mut().zip(row(y)).for_each(|(sum, v)| *sum = sum.wrapping_sub(*v));
            }
            held = wanted;
            let inner = &mut weighted[left..left + from.width];
            inner.iter_mut().zip(&*down).for_each(|(weighted, sum)| *weighted = sum << 3);
            for y in [y.checked_sub(reach), Some(y + reach)].into_iter().flatten() {
                if (from.y..end).contains(&y) {
                    inner.iter_mut().zip(row(y)).for_each(|(sum, v)| *sum = sum.wrapping_add(v.wrapping_mul(edge)));
                }
            }
            simd::prefix_u64(simd, weighted, running);
            let (weighted, running) = (&*weighted, &*running);
            simd::run(
                simd,
                #[inline(always)]
                || across(weighted, running, reach, edge, out),
            );
        }
    }
}

/// Sums along a row of cells.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn across(weighted: &[u64], running: &[u64], reach: usize, edge: u64, out: &mut [u64]) {
    let count = out.len();
    let (first, last) = (&weighted[..count], &weighted[2 * reach..][..count]);
    let (start, end) = (&running[1..][..count], &running[2 * reach..][..count]);
    for x in 0..count {
        let edges = first[x].wrapping_add(last[x]).wrapping_mul(edge);
        out[x] = (end[x].wrapping_sub(start[x]) << 3).wrapping_add(edges);
    }
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

/// Between the middles of which cells a pixel lies: the first of them, and the share of the second.
fn between(y: usize) -> (isize, f32) {
    let first = (y + CELL / 2) / CELL;
    (first as isize - 1, SHARES[(y + CELL / 2) % CELL])
}

/// Shares of the second of two cells in the pixels between their middles.
const SHARES: [f32; CELL] = [0.125, 0.375, 0.625, 0.875];

#[inline(always)]
fn spread(cells: &[f32], out: &mut [f32]) {
    for (out, pair) in out.as_chunks_mut::<CELL>().0.iter_mut().zip(cells.windows(2)) {
        *out = SHARES.map(|share| pair[0] + share * (pair[1] - pair[0]));
    }
}

/// Cells that are summed up at a time.
const REGION: usize = 8;

/// Sums of `I`, `I p`, `p` and `I^2` over the cells of four rows.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn sum_cells(grey: [&[u16]; CELL], map: [&[bool]; CELL], [i, ip, p, ii]: [&mut [u64]; 4]) {
    let mut x = 0;
    while x < i.len() {
        let cells = REGION.min(i.len() - x);
        let (mut of_i, mut of_ip, mut of_p, mut of_ii) =
            ([0u32; REGION * CELL], [0u32; REGION * CELL], [0u32; REGION * CELL], [0u64; REGION * CELL]);
        for (grey, map) in grey.iter().zip(&map) {
            let (grey, map) = (&grey[x * CELL..(x + cells) * CELL], &map[x * CELL..(x + cells) * CELL]);
            for k in 0..cells * CELL {
                let (value, inside) = (u32::from(grey[k]), u32::from(map[k]));
                of_i[k] += value;
                of_p[k] += inside;
                of_ip[k] += value & 0u32.wrapping_sub(inside);
            }
            for k in 0..cells * CELL {
                of_ii[k] += u64::from(grey[k]) * u64::from(grey[k]);
            }
        }
        for cell in 0..cells {
            let of = |sums: &[u32; REGION * CELL]| u64::from(sums[cell * CELL..(cell + 1) * CELL].iter().sum::<u32>());
            (i[x + cell], ip[x + cell], p[x + cell]) = (of(&of_i), of(&of_ip), of(&of_p));
            ii[x + cell] = of_ii[cell * CELL..(cell + 1) * CELL].iter().sum();
        }
        x += cells;
    }
}

/// Coefficients of windows from their sums, times the number of valid pixels of the cell in the middle.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn lines([i, ip, p, ii, n]: [&[u64]; 5], own: &[u64], eps: f64, a: &mut [u64], b: &mut [u64]) {
    let count = a.len();
    let (i, ip, p, ii, n) = (&i[..count], &ip[..count], &p[..count], &ii[..count], &n[..count]);
    let (own, b) = (&own[..count], &mut b[..count]);
    // below 2^52
    let float = |value: u64| f64::from_bits(TWO_52_BITS | value) - TWO_52;
    let (scaled_eps, scaled_unit) = (eps * SCALE * SCALE, SCALE * UNIT);
    for x in 0..count {
        let (i, ip, p, ii, n) = (float(i[x]), float(ip[x]), float(p[x]), float(ii[x]), float(n[x]));
        // where the map is the same everywhere both products are the same, bit for bit, and a = 0
        let covariance = n * ip - i * p;
        let variance = n * ii - i * i;
        let divisor = variance + scaled_eps * (n * n);
        let divisor = if n > 0.0 { divisor } else { 1.0 };
        let slope = covariance * scaled_unit / divisor;
        let offset = (p * UNIT - slope * i * (1.0 / SCALE)) / if n > 0.0 { n } else { 1.0 };
        let whole = |value: f64| i64::from((value + ROUNDER).to_bits() as i32).cast_unsigned();
        a[x] = whole(slope).wrapping_mul(own[x]);
        b[x] = whole(offset).wrapping_mul(own[x]);
    }
}
