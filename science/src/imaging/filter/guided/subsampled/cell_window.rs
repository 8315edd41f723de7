//! Windows of cells: sums over a window whose outermost cells count in part.

use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// Side of a cell, px.
pub(in super::super) const CELL: usize = 4;

/// A window of `2 whole + 1` cells, and `edge` eighths of the next cells on both sides.
#[derive(Debug, Clone)]
pub(super) struct CellWindow {
    whole: usize,
    edge: u64,
    down: Vec<u64>,
    weighted: Vec<u64>,
    running: Vec<u64>,
}

impl CellWindow {
    pub(super) fn new(radius: usize) -> Self {
        let side = 2 * radius + 1;
        let whole = (side / CELL - 1) / 2;
        let edge = (side - CELL * (2 * whole + 1)) as u64;
        Self { whole, edge, down: Vec::new(), weighted: Vec::new(), running: Vec::new() }
    }

    /// Radius of the window, cells.
    pub(super) fn reach(&self) -> usize {
        self.whole + 1
    }

    /// Sums of `source` (the cells `from`) over the windows around the cells `to`, times 64. Cells outside `from` count
    /// as zero.
    pub(super) fn sums(&mut self, simd: Option<Avx2>, source: &[u64], from: Rect, to: Rect, out: &mut Vec<u64>) {
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
