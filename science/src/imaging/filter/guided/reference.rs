//! The reference kernel: any radius and any `eps`. Sums are `f64`, which represents all occurring integers exactly.

use super::window::{Guide, Padding, RowWindow, SCALE, clip};
use crate::imaging::{Plane, Rect};

/// `a` and `b` are stored in units of 2^-18: they are below 8192 for every allowed `eps` (|a| <= 1/(4 sqrt eps)).
const UNIT: f64 = 262_144.0;

/// The kernel and its buffers.
#[derive(Debug)]
pub(super) struct Reference {
    radius: usize,
    eps: f64,
    columns: Vec<Sums>,
    lines: Vec<Line>,
    averaged: Vec<Sums>,
    /// The results, in rows of `width`; row `next` is returned next.
    out: Vec<f32>,
    width: usize,
    next: usize,
}

/// Sums of `[I, I^2, p, I p]` (or of `[a, b]`) and the number of pixels.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    values: [f64; 4],
    count: f64,
}

/// Coefficients of one window, in units of 2^-18.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    a: i32,
    b: i32,
}

impl Reference {
    pub(super) fn new(radius: usize, eps: f64) -> Self {
        let (columns, lines, averaged, out) = Default::default();
        Self { radius, eps, columns, lines, averaged, out, width: 0, next: 0 }
    }

    pub(super) fn start(&mut self, guide: Guide<'_>, map: &Plane<bool>, inner: Rect) {
        let (width, height) = (guide.grey.width, guide.grey.height);
        let centres = inner.grown(self.radius, width, height);
        self.fit(guide, map, centres);
        let mut out = std::mem::take(&mut self.out);
        out.resize(inner.width * inner.height, 0.0);
        self.average(guide, centres, inner, &mut out);
        (self.out, self.width, self.next) = (out, inner.width, 0);
    }

    /// The next row of `inner`.
    pub(super) fn row(&mut self, out: &mut [f32]) {
        let start = self.next * self.width;
        out.copy_from_slice(&self.out[start..start + self.width]);
        self.next += 1;
    }

    /// `a` and `b` of the windows centred on the pixels of `centres`.
    fn fit(&mut self, guide: Guide<'_>, map: &Plane<bool>, centres: Rect) {
        let (radius, eps) = (self.radius, self.eps);
        let (width, height) = (guide.grey.width, guide.grey.height);
        let taps = centres.grown(radius, width, height);
        let pad = Padding::new(centres, taps, radius);
        self.columns.clear();
        self.columns.resize(pad.length, Sums::default());
        self.lines.clear();
        self.lines.resize(centres.width * centres.height, Line::default());

        let mut rows = RowWindow::new(radius, height);
        for (y, line) in (centres.y..).zip(self.lines.chunks_exact_mut(centres.width.max(1))) {
            let columns = &mut self.columns[pad.left..pad.left + taps.width];
            rows.slide(y, |row, sign| {
                let sign = f64::from(sign);
                let span = clip(&guide.valid[row], taps.x, taps.width);
                let grey = &guide.grey.row(row)[taps.x..taps.x + taps.width];
                let map = &map.row(row)[taps.x..taps.x + taps.width];
                for ((sums, &grey), &inside) in
                    columns[span.clone()].iter_mut().zip(&grey[span.clone()]).zip(&map[span])
                {
                    let (grey, p) = (f64::from(grey) * sign, f64::from(u8::from(inside)));
                    let square = grey * grey * sign;
                    sums.values[0] += grey;
                    sums.values[1] += square;
                    sums.values[2] += p * sign;
                    sums.values[3] += grey * p;
                    sums.count += sign;
                }
            });
            let valid = clip(&guide.valid[y], centres.x, centres.width);
            sliding_sums(&self.columns, radius, centres.width, |x, sums| {
                if valid.contains(&x) {
                    line[x] = window_line(sums, eps);
                }
            });
        }
    }

    /// Means of `a` and `b` over the valid centres around each pixel, applied to the guide.
    fn average(&mut self, guide: Guide<'_>, centres: Rect, inner: Rect, out: &mut [f32]) {
        let radius = self.radius;
        let pad = Padding::new(inner, centres, radius);
        self.averaged.clear();
        self.averaged.resize(pad.length, Sums::default());

        let mut rows = RowWindow::new(radius, guide.grey.height);
        for (y, out) in (inner.y..).zip(out.chunks_exact_mut(inner.width.max(1))) {
            let columns = &mut self.averaged[pad.left..pad.left + centres.width];
            let lines = &self.lines;
            rows.slide(y, |row, sign| {
                let sign = f64::from(sign);
                let span = clip(&guide.valid[row], centres.x, centres.width);
                let start = (row - centres.y) * centres.width;
                let lines = &lines[start + span.start..start + span.end];
                for (sums, line) in columns[span].iter_mut().zip(lines) {
                    sums.values[0] += f64::from(line.a) * sign;
                    sums.values[1] += f64::from(line.b) * sign;
                    sums.count += sign;
                }
            });
            let valid = clip(&guide.valid[y], inner.x, inner.width);
            let grey = &guide.grey.row(y)[inner.x..inner.x + inner.width];
            sliding_sums(&self.averaged, radius, inner.width, |x, sums| {
                let [a, b, ..] = sums.values;
                let value = (a * f64::from(grey[x]) / SCALE + b) / (sums.count * UNIT);
                out[x] = if valid.contains(&x) { value as f32 } else { 0.0 };
            });
        }
    }
}

/// `a` and `b` of one window from its sums.
#[inline(always)]
fn window_line(sums: &Sums, eps: f64) -> Line {
    let [i, ii, p, ip] = sums.values;
    let n = sums.count;
    // both numerators are differences of integers, so a constant map gives exactly a = 0
    let covariance = n * ip - i * p;
    let variance = n * ii - i * i;
    let a = covariance * SCALE / (variance + eps * (n * SCALE) * (n * SCALE));
    let b = (p - a * i / SCALE) / n;
    Line { a: (a * UNIT).round() as i32, b: (b * UNIT).round() as i32 }
}

/// Calls `each(x, sums)` with the sums of `columns[x..=x + 2 * radius]` for `x` in `0..count`.
#[inline(always)]
fn sliding_sums(columns: &[Sums], radius: usize, count: usize, mut each: impl FnMut(usize, &Sums)) {
    if count == 0 {
        return;
    }
    let mut sums = Sums::default();
    for column in &columns[..2 * radius] {
        for (sum, value) in sums.values.iter_mut().zip(column.values) {
            *sum += value;
        }
        sums.count += column.count;
    }
    let (leaving, entering) = (&columns[..count], &columns[2 * radius..2 * radius + count]);
    for (x, (leaving, entering)) in leaving.iter().zip(entering).enumerate() {
        for (sum, value) in sums.values.iter_mut().zip(entering.values) {
            *sum += value;
        }
        sums.count += entering.count;
        each(x, &sums);
        for (sum, value) in sums.values.iter_mut().zip(leaving.values) {
            *sum -= value;
        }
        sums.count -= leaving.count;
    }
}
