//! The integer kernel, for radii up to 127 px: 32-bit sums (64-bit for squares), row by row, without a branch per
//! pixel.
//!
//! Column sums slide down the image; a window sum is the difference of two prefix sums of them. All sums wrap modulo
//! 2^32, so only the window sums must fit. Coefficients `(a, b)` are computed row by row just before they are needed,
//! and kept in a ring buffer of `2r + 2` rows, which stays in the cache.

mod columns;
mod counts;
mod fit;
mod geometry;

use columns::exchange_row;
use counts::Counts;
use fit::Fit;
use geometry::{Geometry, Lines};

use super::{
    constant_regions::{MapValue, RegionCounts, regions_of},
    window::{Guide, Padding, RowWindow, SCALE, clip},
};
use crate::imaging::{
    Plane, Rect,
    simd::{self, Avx2},
};

/// Minimum number of fractional bits of `a` and `b`.
const LEAST_BITS: i32 = 13;
/// Maximum number of fractional bits.
const MOST_BITS: i32 = 18;

/// The kernel and its buffers.
#[derive(Debug)]
pub(super) struct Integer {
    simd: Option<Avx2>,
    radius: usize,
    unit: f64,
    fit: Fit,
    ring: Vec<Lines>,
    regions: RegionCounts,
    averaged: [Vec<u32>; 2],
    averaged_running: [Vec<u32>; 2],
    counts: Counts,
    rows: Option<Progress>,
}

/// The state of a pass over the rows.
#[derive(Debug)]
struct Progress {
    geometry: Geometry,
    next: usize,
    fitted: RowWindow,
    averaged: RowWindow,
}

impl Integer {
    /// `None` when the sums do not fit.
    pub(super) fn new(simd: Option<Avx2>, radius: usize, eps: f64) -> Option<Self> {
        let n = (2 * radius + 1).pow(2) as f64;
        // |a| <= 1/(4 sqrt eps), |b| <= 1 + |a|
        let largest = n * (1.0 + 0.25 / eps.sqrt());
        let bits = ((f64::from(i32::MAX) / largest).log2().floor() as i32).min(MOST_BITS);
        if n * SCALE > f64::from(u32::MAX) || bits < LEAST_BITS {
            return None;
        }
        let unit = f64::from(bits).exp2();
        Some(Self {
            simd,
            radius,
            unit,
            fit: Fit::new(simd, radius, eps, unit),
            ring: Vec::new(),
            regions: RegionCounts::default(),
            averaged: Default::default(),
            averaged_running: Default::default(),
            counts: Counts::default(),
            rows: None,
        })
    }

    /// Prepares for the rows of `inner`.
    pub(super) fn start(&mut self, guide: Guide<'_>, inner: Rect) {
        let (width, height, radius) = (guide.grey.width, guide.grey.height, self.radius);
        let centres = inner.grown(radius, width, height);
        let taps = centres.grown(radius, width, height);
        let fit_pad = Padding::new(centres, taps, radius);
        let mean_pad = Padding::new(inner, centres, radius);
        let whole = guide.valid[taps.y..taps.y + taps.height]
            .iter()
            .all(|span| span.start <= taps.x && span.end >= taps.x + taps.width);

        for (sums, running) in self.averaged.iter_mut().zip(&mut self.averaged_running) {
            sums.clear();
            sums.resize(mean_pad.length, 0);
            running.resize(mean_pad.length + 1, 0);
        }
        self.ring.resize_with(2 * radius + 2, Default::default);
        self.counts.start(mean_pad, inner.width);
        self.regions.start(centres.width);
        let (fitted, averaged) = (RowWindow::new(radius, height), RowWindow::new(radius, height));
        let geometry = Geometry { inner, centres, taps, fit_pad, mean_pad, whole };
        self.fit.start(geometry);
        self.rows = Some(Progress { geometry, next: inner.y, fitted, averaged });
    }

    /// The next row of `inner`. The guide is the one passed to [`Self::start`].
    pub(super) fn row(&mut self, guide: Guide<'_>, map: &Plane<bool>, out: &mut [f32]) {
        let Some(mut rows) = self.rows.take() else { return };
        let Progress { geometry, next: y, fitted, averaged } = &mut rows;
        let (Geometry { inner, centres, mean_pad, whole, .. }, y, radius) = (*geometry, *y, self.radius);
        averaged.exchange(y, |enters, leaves| {
            if let Some(row) = enters {
                let slot = row % self.ring.len();
                self.fit.row(guide, map, row, *geometry, fitted, &mut self.ring[slot]);
            }
            self.exchange_lines(enters, leaves, mean_pad, centres.width);
            if !whole {
                let clipped = |row: usize| clip(&guide.valid[row], centres.x, centres.width);
                self.counts.exchange(enters.map(clipped), leaves.map(clipped), mean_pad);
            }
        });
        match whole {
            true => self.counts.whole(averaged.rows.len(), mean_pad, radius, centres.width),
            false => self.counts.window(self.simd, radius),
        }
        let grey = &guide.grey.row(y)[inner.x..inner.x + inner.width];
        let (span, per_unit) = (2 * radius + 1, 1.0 / self.unit);
        let mut summed = false;
        for part in regions_of(inner.width) {
            let centred = part.start.max(mean_pad.left) - mean_pad.left
                ..(part.end - 1 + span).min(mean_pad.left + centres.width) - mean_pad.left;
            let out = &mut out[part.clone()];
            match self.regions.value(centred) {
                MapValue::Zero => out.fill(0.0),
                MapValue::One => out.fill(1.0),
                MapValue::Mixed => {
                    if !summed {
                        for (sums, running) in self.averaged.iter().zip(&mut self.averaged_running) {
                            simd::prefix_u32(self.simd, sums, running);
                        }
                        summed = true;
                    }
                    let [a, b] = &self.averaged_running;
                    let (a, b, grey) = (&a[part.start..], &b[part.start..], &grey[part.clone()]);
                    let share = &self.counts.share[part];
                    simd::run(
                        self.simd,
                        #[inline(always)]
                        || means(grey, a, b, span, share, per_unit, out),
                    );
                }
            }
        }
        if !whole {
            let valid = clip(&guide.valid[y], inner.x, inner.width);
            out[..valid.start].fill(0.0);
            out[valid.end..].fill(0.0);
        }
        rows.next += 1;
        self.rows = Some(rows);
    }

    /// Adds a row of coefficients to the column sums and removes another.
    fn exchange_lines(&mut self, enters: Option<usize>, leaves: Option<usize>, pad: Padding, width: usize) {
        let (slots, simd) = (self.ring.len(), self.simd);
        if let Some(row) = enters {
            self.regions.enter(&self.ring[row % slots].values);
        }
        if let Some(row) = leaves {
            self.regions.leave(&self.ring[row % slots].values);
        }
        let which: [fn(&Lines) -> &[u32]; 2] = [|lines| &lines.a, |lines| &lines.b];
        for (which, sums) in which.into_iter().zip(&mut self.averaged) {
            let sums = &mut sums[pad.left..pad.left + width];
            let row = |row: usize| &which(&self.ring[row % slots])[..width];
            match (enters.map(row), leaves.map(row)) {
                (Some(enters), Some(leaves)) => simd::run(
                    simd,
                    #[inline(always)]
                    || exchange_row(sums, enters, leaves),
                ),
                (Some(enters), None) => sums.iter_mut().zip(enters).for_each(|(sum, v)| *sum = sum.wrapping_add(*v)),
                (None, Some(leaves)) => sums.iter_mut().zip(leaves).for_each(|(sum, v)| *sum = sum.wrapping_sub(*v)),
                (None, None) => {}
            }
        }
    }
}

/// The results of a row, from prefix sums of the coefficients.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn means(grey: &[u16], a: &[u32], b: &[u32], span: usize, share: &[f64], per_unit: f64, out: &mut [f32]) {
    let count = out.len();
    let (grey, share) = (&grey[..count], &share[..count]);
    let (a0, a1) = (&a[..count], &a[span..span + count]);
    let (b0, b1) = (&b[..count], &b[span..span + count]);
    for x in 0..count {
        let a = f64::from(a1[x].wrapping_sub(a0[x]).cast_signed());
        let b = f64::from(b1[x].wrapping_sub(b0[x]).cast_signed());
        out[x] = ((a * f64::from(grey[x]) * (1.0 / SCALE) + b) * (share[x] * per_unit)) as f32;
    }
}
