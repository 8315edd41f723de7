//! Radii up to 127 px: sums of 32 bits (64 for the squares), in rows, without a branch per pixel.
//!
//! Column sums slide down the picture; the sum over a window is the difference of two running sums of them. All of it is
//! done modulo 2^32, so that only the sums over windows must fit. Lines `(a, b)` are made row by row just before they
//! are needed and wait in a ring of `2r + 2` rows, which stays in the cache.

use std::ops::Range;

use super::{
    Guide, SCALE, Window, clip,
    parts::{Held, Tally, parts},
};
use crate::imaging::{
    Plane, Rect,
    simd::{self, Avx2},
};

/// Least bits after the point that `a` and `b` must have.
const LEAST_BITS: i32 = 13;
/// Most of them.
const MOST_BITS: i32 = 18;
/// 2^52, and its bits: a whole number below it, or-ed into them, is that number added.
const TWO_52: f64 = 4_503_599_627_370_496.0;
const TWO_52_BITS: u64 = 0x4330_0000_0000_0000;
/// 1.5 * 2^52: a number below 2^31 added to it is rounded to a whole number, which its low bits hold.
const ROUNDER: f64 = 1.5 * TWO_52;

/// The filter and its buffers.
#[derive(Debug)]
pub(super) struct Narrow {
    simd: Option<Avx2>,
    radius: usize,
    eps: f64,
    unit: f64,
    columns: Columns,
    running: Columns,
    ring: Vec<Lines>,
    tally: Tally,
    averaged: [Vec<u32>; 2],
    averaged_running: [Vec<u32>; 2],
    fit_counts: Counts,
    mean_counts: Counts,
    rows: Option<Rows>,
}

/// Lines of the windows centred on a row.
#[derive(Debug, Default)]
struct Lines {
    a: Vec<u32>,
    b: Vec<u32>,
    held: Vec<Held>,
}

/// How far a pass over the rows has come.
#[derive(Debug)]
struct Rows {
    place: Place,
    next: usize,
    fitted: Window,
    averaged: Window,
}

/// What a pass works on.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Pixels whose results are wanted.
    inner: Rect,
    /// Pixels on which the windows are centred whose lines are averaged for those.
    centres: Rect,
    /// Pixels in those windows.
    taps: Rect,
    fit_pad: Padding,
    mean_pad: Padding,
    /// Whether all pixels of `taps` are valid.
    whole: bool,
}

/// Sums of `I`, `I p`, `p` and `I^2` per column.
#[derive(Debug, Default)]
struct Columns {
    i: Vec<u32>,
    ip: Vec<u32>,
    p: Vec<u32>,
    ii: Vec<u64>,
}

impl Columns {
    fn clear(&mut self, length: usize) {
        for sums in [&mut self.i, &mut self.ip, &mut self.p] {
            sums.clear();
            sums.resize(length, 0);
        }
        self.ii.clear();
        self.ii.resize(length, 0);
    }
}

/// Numbers of valid pixels in the windows of a row.
#[derive(Debug, Default)]
struct Counts {
    /// Rows that the windows had when `n` was worked out, if all their pixels are valid: it depends on nothing else.
    whole_rows: Option<usize>,
    columns: Vec<u32>,
    running: Vec<u32>,
    n: Vec<f64>,
    /// 1 / n, 0 where there is none.
    share: Vec<f64>,
    /// Whether they are those of `columns`: most rows enter where others of the same span leave.
    fresh: bool,
}

impl Narrow {
    /// `None` when the sums of such a filter do not fit.
    pub fn new(simd: Option<Avx2>, radius: usize, eps: f64) -> Option<Self> {
        let n = (2 * radius + 1).pow(2) as f64;
        // |a| <= 1/(4 sqrt eps), |b| <= 1 + |a|
        let largest = n * (1.0 + 0.25 / eps.sqrt());
        let bits = ((f64::from(i32::MAX) / largest).log2().floor() as i32).min(MOST_BITS);
        if n * SCALE > f64::from(u32::MAX) || bits < LEAST_BITS {
            return None;
        }
        Some(Self {
            simd,
            radius,
            eps,
            unit: f64::from(bits).exp2(),
            columns: Columns::default(),
            running: Columns::default(),
            ring: Vec::new(),
            tally: Tally::default(),
            averaged: Default::default(),
            averaged_running: Default::default(),
            fit_counts: Counts::default(),
            mean_counts: Counts::default(),
            rows: None,
        })
    }

    /// Starts at the first row of `inner`.
    pub fn start(&mut self, guide: Guide<'_>, inner: Rect) {
        let (width, height, radius) = (guide.grey.width, guide.grey.height, self.radius);
        let centres = inner.grown(radius, width, height);
        let taps = centres.grown(radius, width, height);
        let fit_pad = Padding::new(centres, taps, radius);
        let mean_pad = Padding::new(inner, centres, radius);
        let whole = guide.valid[taps.y..taps.y + taps.height]
            .iter()
            .all(|span| span.start <= taps.x && span.end >= taps.x + taps.width);

        self.columns.clear(fit_pad.length);
        self.running.clear(fit_pad.length + 1);
        for (sums, running) in self.averaged.iter_mut().zip(&mut self.averaged_running) {
            sums.clear();
            sums.resize(mean_pad.length, 0);
            running.resize(mean_pad.length + 1, 0);
        }
        self.ring.resize_with(2 * radius + 2, Default::default);
        self.fit_counts.start(fit_pad, centres.width);
        self.mean_counts.start(mean_pad, inner.width);
        self.tally.start(centres.width);
        let (fitted, averaged) = (Window::new(radius, height), Window::new(radius, height));
        let place = Place { inner, centres, taps, fit_pad, mean_pad, whole };
        self.rows = Some(Rows { place, next: inner.y, fitted, averaged });
    }

    /// The next row of the `inner` that was started with, of the same guide and map.
    pub fn row(&mut self, guide: Guide<'_>, map: &Plane<bool>, out: &mut [f32]) {
        let Some(mut rows) = self.rows.take() else { return };
        let Rows { place, next: y, fitted, averaged } = &mut rows;
        let (Place { inner, centres, mean_pad, whole, .. }, y, radius) = (*place, *y, self.radius);
        averaged.exchange(y, |enters, leaves| {
            if let Some(row) = enters {
                self.fit(guide, map, row, *place, fitted);
            }
            self.exchange_lines(enters, leaves, mean_pad, centres.width);
            if !whole {
                let clipped = |row: usize| clip(&guide.valid[row], centres.x, centres.width);
                self.mean_counts.exchange(enters.map(clipped), leaves.map(clipped), mean_pad);
            }
        });
        match whole {
            true => self.mean_counts.whole(averaged.held.len(), mean_pad, radius, centres.width),
            false => self.mean_counts.window(self.simd, radius),
        }
        let grey = &guide.grey.row(y)[inner.x..inner.x + inner.width];
        let (span, per_unit) = (2 * radius + 1, 1.0 / self.unit);
        let mut summed = false;
        for part in parts(inner.width) {
            let centred = part.start.max(mean_pad.left) - mean_pad.left
                ..(part.end - 1 + span).min(mean_pad.left + centres.width) - mean_pad.left;
            let out = &mut out[part.clone()];
            match self.tally.held(centred) {
                Held::Nothing => out.fill(0.0),
                Held::Everything => out.fill(1.0),
                Held::Both => {
                    if !summed {
                        for (sums, running) in self.averaged.iter().zip(&mut self.averaged_running) {
                            simd::prefix_u32(self.simd, sums, running);
                        }
                        summed = true;
                    }
                    let [a, b] = &self.averaged_running;
                    let (a, b, grey) = (&a[part.start..], &b[part.start..], &grey[part.clone()]);
                    let share = &self.mean_counts.share[part];
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

    /// `a` and `b` of the windows centred on row `y`, into the ring.
    fn fit(
        &mut self,
        guide: Guide<'_>,
        map: &Plane<bool>,
        y: usize,
        Place { centres, taps, fit_pad: pad, whole, .. }: Place,
        rows: &mut Window,
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
                self.fit_counts.exchange(span(&enters), span(&leaves), pad);
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
        match whole {
            true => self.fit_counts.whole(rows.held.len(), pad, self.radius, taps.width),
            false => self.fit_counts.window(simd, self.radius),
        }
        let (span, slot, rows) = (2 * self.radius + 1, y % self.ring.len(), rows.held.len());
        let Lines { a, b, held } = &mut self.ring[slot];
        a.resize(centres.width, 0);
        b.resize(centres.width, 0);
        simd::prefix_u32(simd, &self.columns.p, &mut self.running.p);
        held.clear();
        held.extend(parts(centres.width).map(|part| {
            let (start, end) = (part.start, part.end - 1 + span);
            let columns = end.min(pad.left + taps.width).saturating_sub(start.max(pad.left));
            match self.running.p[end].wrapping_sub(self.running.p[start]) as usize {
                0 => Held::Nothing,
                sum if whole && sum == rows * columns => Held::Everything,
                _ => Held::Both,
            }
        }));
        if held.contains(&Held::Both) {
            simd::prefix_u32(simd, &self.columns.i, &mut self.running.i);
            simd::prefix_u32(simd, &self.columns.ip, &mut self.running.ip);
            simd::prefix_u64(simd, &self.columns.ii, &mut self.running.ii);
        }
        let (running, counts, eps, unit) = (&self.running, &self.fit_counts, self.eps, self.unit);
        for (part, held) in parts(centres.width).zip(held.iter()) {
            let (a, b) = (&mut a[part.clone()], &mut b[part.clone()]);
            match held {
                Held::Nothing => {
                    a.fill(0);
                    b.fill(0);
                }
                Held::Everything => {
                    a.fill(0);
                    b.fill(unit as u32);
                }
                Held::Both => {
                    let counts = (&counts.n[part.clone()], &counts.share[part.clone()]);
                    simd::run(
                        simd,
                        #[inline(always)]
                        || lines(running, part.start, span, counts, eps, unit, (a, b)),
                    );
                }
            }
        }
        if !whole {
            let valid = clip(&guide.valid[y], centres.x, centres.width);
            for line in [a, b] {
                line[..valid.start].fill(0);
                line[valid.end..].fill(0);
            }
        }
    }

    /// Adds a row of lines of the ring to the column sums, and takes one out.
    fn exchange_lines(&mut self, enters: Option<usize>, leaves: Option<usize>, pad: Padding, width: usize) {
        let (slots, simd) = (self.ring.len(), self.simd);
        if let Some(row) = enters {
            self.tally.enter(&self.ring[row % slots].held);
        }
        if let Some(row) = leaves {
            self.tally.leave(&self.ring[row % slots].held);
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

impl Columns {
    /// The sums of the columns `span` of the taps.
    fn part(&mut self, left: usize, span: Range<usize>) -> Part<'_> {
        let columns = left + span.start..left + span.end;
        Part {
            i: &mut self.i[columns.clone()],
            ip: &mut self.ip[columns.clone()],
            p: &mut self.p[columns.clone()],
            ii: &mut self.ii[columns],
        }
    }
}

struct Part<'a> {
    i: &'a mut [u32],
    ip: &'a mut [u32],
    p: &'a mut [u32],
    ii: &'a mut [u64],
}

impl Counts {
    fn start(&mut self, pad: Padding, width: usize) {
        self.whole_rows = None;
        self.fresh = false;
        self.columns.clear();
        self.columns.resize(pad.length, 0);
        self.running.resize(pad.length + 1, 0);
        self.n.resize(width, 0.0);
        self.share.resize(width, 0.0);
    }

    /// Windows of `rows` rows whose pixels are all valid, as far as there are columns: `taps` of them.
    fn whole(&mut self, rows: usize, pad: Padding, radius: usize, taps: usize) {
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

    /// Adds the valid columns of one row, and takes out those of another.
    fn exchange(&mut self, enters: Option<Range<usize>>, leaves: Option<Range<usize>>, pad: Padding) {
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

    /// Works out `n` from the columns.
    fn window(&mut self, simd: Option<Avx2>, radius: usize) {
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

/// Numbers of pixels from running counts, and their reciprocals.
#[inline(always)]
fn counted(starts: &[u32], ends: &[u32], n: &mut [f64], share: &mut [f64]) {
    for ((n, share), (start, end)) in n.iter_mut().zip(share).zip(starts.iter().zip(ends)) {
        *n = f64::from(end.wrapping_sub(*start));
        let reciprocal = 1.0 / *n;
        *share = if *n > 0.0 { reciprocal } else { 0.0 };
    }
}

/// Where column sums lie in a buffer with room for windows that hang over the ends of the picture.
#[derive(Debug, Clone, Copy)]
struct Padding {
    left: usize,
    length: usize,
}

impl Padding {
    /// For windows of `radius` around the columns of `centres`, with sums of the columns of `taps`.
    fn new(centres: Rect, taps: Rect, radius: usize) -> Self {
        Self { left: radius - (centres.x - taps.x), length: centres.width + 2 * radius }
    }
}

#[inline(always)]
fn exchange(part: Part<'_>, enters: (&[u16], &[bool]), leaves: (&[u16], &[bool])) {
    let Part { i, ip, p, ii } = part;
    sum_rows(i, ip, p, enters, leaves);
    square_rows(ii, enters.0, leaves.0);
}

#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "several slices side by side")]
fn sum_rows(i: &mut [u32], ip: &mut [u32], p: &mut [u32], enters: (&[u16], &[bool]), leaves: (&[u16], &[bool])) {
    let n = i.len();
    let (ip, p) = (&mut ip[..n], &mut p[..n]);
    let (enters, enters_in, leaves, leaves_in) = (&enters.0[..n], &enters.1[..n], &leaves.0[..n], &leaves.1[..n]);
    for x in 0..n {
        let (e, l) = (u32::from(enters[x]), u32::from(leaves[x]));
        let (e_in, l_in) = (u32::from(enters_in[x]), u32::from(leaves_in[x]));
        i[x] = i[x].wrapping_add(e).wrapping_sub(l);
        p[x] = p[x].wrapping_add(e_in).wrapping_sub(l_in);
        let (e, l) = (e & 0u32.wrapping_sub(e_in), l & 0u32.wrapping_sub(l_in));
        ip[x] = ip[x].wrapping_add(e).wrapping_sub(l);
    }
}

#[inline(always)]
fn square_rows(ii: &mut [u64], enters: &[u16], leaves: &[u16]) {
    for ((ii, &e), &l) in ii.iter_mut().zip(enters).zip(leaves) {
        let (e, l) = (u64::from(e), u64::from(l));
        *ii = ii.wrapping_add(e * e).wrapping_sub(l * l);
    }
}

#[inline(always)]
fn add<const ENTERS: bool>(part: Part<'_>, grey: &[u16], map: &[bool]) {
    let sign = if ENTERS { 1u32 } else { u32::MAX };
    let sums = part.i.iter_mut().zip(part.ip).zip(part.p);
    for (((i, ip), p), (&grey, &inside)) in sums.zip(grey.iter().zip(map)) {
        let (grey, inside) = (u32::from(grey), u32::from(inside));
        *i = i.wrapping_add(grey.wrapping_mul(sign));
        *ip = ip.wrapping_add((grey & 0u32.wrapping_sub(inside)).wrapping_mul(sign));
        *p = p.wrapping_add(inside.wrapping_mul(sign));
    }
    for (ii, &grey) in part.ii.iter_mut().zip(grey) {
        let square = u64::from(grey) * u64::from(grey);
        *ii = if ENTERS { ii.wrapping_add(square) } else { ii.wrapping_sub(square) };
    }
}

#[inline(always)]
fn exchange_row(sums: &mut [u32], enters: &[u32], leaves: &[u32]) {
    for ((sum, &enters), &leaves) in sums.iter_mut().zip(enters).zip(leaves) {
        *sum = sum.wrapping_add(enters).wrapping_sub(leaves);
    }
}

/// `a` and `b`, in units of 1 / `unit` and rounded, of a row of windows of `span` columns, the first of which begins at
/// column `start` of the running sums.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "several slices side by side")]
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
        // below 2^46
        let ii = f64::from_bits(TWO_52_BITS | ii1[x].wrapping_sub(ii0[x])) - TWO_52;
        let n = n[x];
        // Both numerators are differences of whole numbers, so that a flat map gives exactly a = 0.
        let covariance = n * ip - i * p;
        let variance = n * ii - i * i;
        // where there is no pixel, 0 / 1
        let divisor = variance + scaled_eps * (n * n);
        let divisor = if n > 0.0 { divisor } else { 1.0 };
        let slope = covariance * scaled_unit / divisor;
        let offset = (p * unit - slope * i * (1.0 / SCALE)) * share[x];
        a[x] = (slope + ROUNDER).to_bits() as u32;
        b[x] = (offset + ROUNDER).to_bits() as u32;
    }
}

/// The result at a row of pixels, from running sums of the lines.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "several slices side by side")]
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
