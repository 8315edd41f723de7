//! The number of valid pixels in each window of a row.

use std::ops::Range;

use crate::imaging::{
    filter::guided::window::Padding,
    simd::{self, Avx2},
};

/// The number of valid pixels in each window of a row.
#[derive(Debug, Default)]
pub(super) struct Counts {
    /// Rows per window for which `n` was computed, if all pixels are valid: `n` depends on nothing else.
    whole_rows: Option<usize>,
    columns: Vec<u32>,
    running: Vec<u32>,
    pub(super) n: Vec<f64>,
    /// 1 / n, or 0 where n is 0.
    pub(super) share: Vec<f64>,
    /// True when `n` is up to date with `columns`. Most entering rows have the span of the leaving row.
    fresh: bool,
}

impl Counts {
    pub(super) fn start(&mut self, pad: Padding, width: usize) {
        self.whole_rows = None;
        self.fresh = false;
        self.columns.clear();
        self.columns.resize(pad.length, 0);
        self.running.resize(pad.length + 1, 0);
        self.n.resize(width, 0.0);
        self.share.resize(width, 0.0);
    }

    /// Windows of `rows` rows of `taps` columns whose pixels are all valid.
    pub(super) fn whole(&mut self, rows: usize, pad: Padding, radius: usize, taps: usize) {
        if self.whole_rows == Some(rows) {
            return;
        }
        self.whole_rows = Some(rows);
        for (x, (n, share)) in self.n.iter_mut().zip(&mut self.share).enumerate() {
            let (start, end) = (x.max(pad.left), (x + 2 * radius + 1).min(pad.left + taps));
            *n = (rows * end.saturating_sub(start)) as f64;
            *share = if *n > 0.0 { 1.0 / *n } else { 0.0 };
        }
    }

    /// Adds the valid columns of one row and removes those of another.
    pub(super) fn exchange(&mut self, enters: Option<Range<usize>>, leaves: Option<Range<usize>>, pad: Padding) {
        if enters == leaves {
            return;
        }
        self.fresh = false;
        let columns = &mut self.columns[pad.left..];
        if let Some(span) = enters {
            columns[span].iter_mut().for_each(|count| *count += 1);
        }
        if let Some(span) = leaves {
            columns[span].iter_mut().for_each(|count| *count -= 1);
        }
    }

    /// Computes `n` from the columns.
    pub(super) fn window(&mut self, simd: Option<Avx2>, radius: usize) {
        if self.fresh {
            return;
        }
        self.fresh = true;
        simd::prefix_u32(simd, &self.columns, &mut self.running);
        let (starts, ends) = (&self.running, &self.running[2 * radius + 1..]);
        let (n, share) = (&mut self.n, &mut self.share);
        simd::run(
            simd,
            #[inline(always)]
            || counted(starts, ends, n, share),
        );
    }
}

/// Pixel counts from prefix sums, and their reciprocals.
#[inline(always)]
fn counted(starts: &[u32], ends: &[u32], n: &mut [f64], share: &mut [f64]) {
    for ((n, share), (start, end)) in n.iter_mut().zip(share).zip(starts.iter().zip(ends)) {
        *n = f64::from(end.wrapping_sub(*start));
        let reciprocal = 1.0 / *n;
        *share = if *n > 0.0 { reciprocal } else { 0.0 };
    }
}
