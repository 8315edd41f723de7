//! Coefficients `(a, b)` from window sums, for the window around each pixel of a row.

use std::ops::Range;

use super::{
    super::{
        constant_regions::{MapValue, regions_of},
        window::{Guide, RowWindow, SCALE, clip, float, rounded},
    },
    columns::{Columns, add, exchange},
    counts::Counts,
    geometry::{Geometry, Lines},
};
use crate::imaging::{
    Plane,
    simd::{self, Avx2},
};

/// Fits coefficients row by row, from the top down.
#[derive(Debug)]
pub(super) struct Fit {
    simd: Option<Avx2>,
    radius: usize,
    eps: f64,
    unit: f64,
    columns: Columns,
    running: Columns,
    counts: Counts,
}

impl Fit {
    /// Coefficients are in units of 1 / `unit`.
    pub(super) fn new(simd: Option<Avx2>, radius: usize, eps: f64, unit: f64) -> Self {
        let (columns, running) = (Columns::default(), Columns::default());
        Self { simd, radius, eps, unit, columns, running, counts: Counts::default() }
    }

    pub(super) fn start(&mut self, Geometry { centres, fit_pad: pad, .. }: Geometry) {
        self.columns.clear(pad.length);
        self.running.clear(pad.length + 1);
        self.counts.start(pad, centres.width);
    }

    /// The coefficients of the windows centred on row `y`, which must not decrease.
    pub(super) fn row(
        &mut self,
        guide: Guide<'_>,
        map: &Plane<bool>,
        y: usize,
        geometry: Geometry,
        rows: &mut RowWindow,
        out: &mut Lines,
    ) {
        let Geometry { centres, taps, fit_pad: pad, whole, .. } = geometry;
        self.slide(guide, map, y, geometry, rows);
        match whole {
            true => self.counts.whole(rows.rows.len(), pad, self.radius, taps.width),
            false => self.counts.window(self.simd, self.radius),
        }
        self.find_constant_regions(geometry, rows.rows.len(), &mut out.values);
        self.fit(centres.width, out);
        if !whole {
            let valid = clip(&guide.valid[y], centres.x, centres.width);
            for line in [&mut out.a, &mut out.b] {
                line[..valid.start].fill(0);
                line[valid.end..].fill(0);
            }
        }
    }

    /// Moves the column sums to the window of row `y`.
    fn slide(
        &mut self,
        guide: Guide<'_>,
        map: &Plane<bool>,
        y: usize,
        Geometry { taps, fit_pad: pad, whole, .. }: Geometry,
        rows: &mut RowWindow,
    ) {
        let simd = self.simd;
        rows.exchange(y, |enters, leaves| {
            let row = |row: usize| {
                let span = clip(&guide.valid[row], taps.x, taps.width);
                let columns = taps.x + span.start..taps.x + span.end;
                (span, &guide.grey.row(row)[columns.clone()], &map.row(row)[columns])
            };
            let (enters, leaves) = (enters.map(row), leaves.map(row));
            if !whole {
                let span = |row: &Option<(Range<usize>, _, _)>| row.as_ref().map(|row| row.0.clone());
                self.counts.exchange(span(&enters), span(&leaves), pad);
            }
            match (enters, leaves) {
                (Some(enters), Some(leaves)) if enters.0 == leaves.0 => {
                    let part = self.columns.part(pad.left, enters.0);
                    simd::run(
                        simd,
                        #[inline(always)]
                        || exchange(part, (enters.1, enters.2), (leaves.1, leaves.2)),
                    );
                }
                (enters, leaves) => {
                    if let Some((span, grey, map)) = enters {
                        let part = self.columns.part(pad.left, span);
                        simd::run(
                            simd,
                            #[inline(always)]
                            || add::<true>(part, grey, map),
                        );
                    }
                    if let Some((span, grey, map)) = leaves {
                        let part = self.columns.part(pad.left, span);
                        simd::run(
                            simd,
                            #[inline(always)]
                            || add::<false>(part, grey, map),
                        );
                    }
                }
            }
        });
    }

    /// Which value the map has in the windows of each region, by prefix sums of `p`.
    fn find_constant_regions(
        &mut self,
        Geometry { centres, taps, fit_pad: pad, whole, .. }: Geometry,
        rows: usize,
        values: &mut Vec<MapValue>,
    ) {
        let span = 2 * self.radius + 1;
        simd::prefix_u32(self.simd, &self.columns.p, &mut self.running.p);
        values.clear();
        values.extend(regions_of(centres.width).map(|part| {
            let (start, end) = (part.start, part.end - 1 + span);
            let columns = end.min(pad.left + taps.width).saturating_sub(start.max(pad.left));
            match self.running.p[end].wrapping_sub(self.running.p[start]) as usize {
                0 => MapValue::Zero,
                sum if whole && sum == rows * columns => MapValue::One,
                _ => MapValue::Mixed,
            }
        }));
    }

    /// The coefficients of a row of `width` windows whose regions have `values`.
    fn fit(&mut self, width: usize, Lines { a, b, values }: &mut Lines) {
        let (simd, span) = (self.simd, 2 * self.radius + 1);
        a.resize(width, 0);
        b.resize(width, 0);
        if values.contains(&MapValue::Mixed) {
            simd::prefix_u32(simd, &self.columns.i, &mut self.running.i);
            simd::prefix_u32(simd, &self.columns.ip, &mut self.running.ip);
            simd::prefix_u64(simd, &self.columns.ii, &mut self.running.ii);
        }
        let (running, counts, eps, unit) = (&self.running, &self.counts, self.eps, self.unit);
        for (part, value) in regions_of(width).zip(values.iter()) {
            let (a, b) = (&mut a[part.clone()], &mut b[part.clone()]);
            match value {
                MapValue::Zero => {
                    a.fill(0);
                    b.fill(0);
                }
                MapValue::One => {
                    a.fill(0);
                    b.fill(unit as u32);
                }
                MapValue::Mixed => {
                    let counts = (&counts.n[part.clone()], &counts.share[part.clone()]);
                    simd::run(
                        simd,
                        #[inline(always)]
                        || lines(running, part.start, span, counts, eps, unit, (a, b)),
                    );
                }
            }
        }
    }
}

/// `a` and `b`, in units of 1 / `unit` and rounded, of a row of windows of `span` columns, the first of which begins at
/// column `start` of the running sums.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn lines(
    running: &Columns,
    start: usize,
    span: usize,
    (n, share): (&[f64], &[f64]),
    eps: f64,
    unit: f64,
    (a, b): (&mut [u32], &mut [u32]),
) {
    let count = a.len();
    let (n, share, b) = (&n[..count], &share[..count], &mut b[..count]);
    let (i0, i1) = (&running.i[start..start + count], &running.i[start + span..start + span + count]);
    let (ip0, ip1) = (&running.ip[start..start + count], &running.ip[start + span..start + span + count]);
    let (p0, p1) = (&running.p[start..start + count], &running.p[start + span..start + span + count]);
    let (ii0, ii1) = (&running.ii[start..start + count], &running.ii[start + span..start + span + count]);
    let (scaled_eps, scaled_unit) = (eps * SCALE * SCALE, SCALE * unit);
    for x in 0..count {
        let i = f64::from(i1[x].wrapping_sub(i0[x]));
        let ip = f64::from(ip1[x].wrapping_sub(ip0[x]));
        let p = f64::from(p1[x].wrapping_sub(p0[x]));
        // below 2^48
        let ii = float(ii1[x].wrapping_sub(ii0[x]));
        let n = n[x];
        // both numerators are differences of integers, so a constant map gives exactly a = 0
        let covariance = n * ip - i * p;
        let variance = n * ii - i * i;
        // without pixels this is 0 / 1
        let divisor = variance + scaled_eps * (n * n);
        let divisor = if n > 0.0 { divisor } else { 1.0 };
        let slope = covariance * scaled_unit / divisor;
        let offset = (p * unit - slope * i * (1.0 / SCALE)) * share[x];
        a[x] = rounded(slope).cast_unsigned();
        b[x] = rounded(offset).cast_unsigned();
    }
}
