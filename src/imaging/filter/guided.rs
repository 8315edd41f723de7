//! The guided filter (He, Sun & Tang 2013) of a binary map with a grey guide, on valid pixels alone.
//!
//! In each window of `(2r + 1)^2` px: `a = cov(I, p) / (var(I) + eps)`, `b = mean(p) - a mean(I)`; the result
//! at a pixel is `mean(a) I + mean(b)` over the windows that hold it. Pixels outside the picture and pixels
//! that the slice does not cover do not exist: they are in no sum, no count, and no window is centred on them.
//!
//! Exactness: the guide is an integer (0..65535), so the window sums of `I`, `I^2`, `p` and `I p` are exact,
//! and `var` and `cov` come from exact numerators; with `eps` of 1e-6 single precision would lose 6 % of it.
//! `a` and `b` are rounded to 2^-18 and summed exactly too. Hence the result is the same for any tiling, and
//! where `p` is constant in reach it is exactly that constant.

use std::ops::Range;

use crate::imaging::{Plane, Rect};

/// Full scale of the guide.
const SCALE: f64 = 65_535.0;
/// `a` and `b` are kept in units of 2^-18: they stay below 8192 for every allowed `eps` (|a| <= 1/(4 sqrt eps)).
const UNIT: f64 = 262_144.0;

/// A window of a picture with what the guided filter needs of it.
#[derive(Debug, Clone, Copy)]
pub struct Guide<'a> {
    /// Grey values, 0..65535.
    pub grey: &'a Plane<u16>,
    /// The valid columns of each row.
    pub valid: &'a [Range<usize>],
}

/// Radius and regularisation of a guided filter, and the buffers that it uses again and again.
#[derive(Debug)]
pub struct GuidedFilter {
    radius: usize,
    eps: f64,
    columns: Vec<Sums>,
    lines: Vec<Line>,
    averaged: Vec<Sums>,
}

/// Sums of `[I, I^2, p, I p]` (or of `[a, b]`) and the number of pixels in them.
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

impl GuidedFilter {
    /// A guided filter with windows of `(2 * radius + 1)^2` px and regularisation `eps` for intensities in 0..1.
    pub fn new(radius: usize, eps: f64) -> Self {
        Self { radius, eps, columns: Vec::new(), lines: Vec::new(), averaged: Vec::new() }
    }

    /// How far from a pixel its result looks.
    pub fn reach(&self) -> usize {
        2 * self.radius
    }

    /// Filters `map` (true = 1) inside `inner`; `out` gets `inner.width * inner.height` results, row-major, 0
    /// at pixels that are not valid. They are not clamped.
    ///
    /// The edges of the guide count as the end of the picture: give it [`GuidedFilter::reach`] px around
    /// `inner` wherever the picture goes on.
    pub fn apply(&mut self, guide: Guide<'_>, map: &Plane<bool>, inner: Rect, out: &mut [f32]) {
        let (width, height) = (guide.grey.width, guide.grey.height);
        let centres = inner.grown(self.radius, width, height);
        self.fit(guide, map, centres);
        self.average(guide, centres, inner, out);
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

        let mut rows = Window::new(radius, height);
        for (y, line) in (centres.y..).zip(self.lines.chunks_exact_mut(centres.width.max(1))) {
            let columns = &mut self.columns[pad.left..pad.left + taps.width];
            rows.slide(y, |row, sign| {
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

        let mut rows = Window::new(radius, guide.grey.height);
        for (y, out) in (inner.y..).zip(out.chunks_exact_mut(inner.width.max(1))) {
            let columns = &mut self.averaged[pad.left..pad.left + centres.width];
            let lines = &self.lines;
            rows.slide(y, |row, sign| {
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
    // Both numerators are differences of whole numbers, so that a flat map gives exactly a = 0.
    let covariance = n * ip - i * p;
    let variance = n * ii - i * i;
    let a = covariance * SCALE / (variance + eps * (n * SCALE) * (n * SCALE));
    let b = (p - a * i / SCALE) / n;
    Line { a: (a * UNIT).round() as i32, b: (b * UNIT).round() as i32 }
}

/// The rows of a window that slides down: each row is added once and taken out once.
struct Window {
    radius: usize,
    height: usize,
    held: Range<usize>,
}

impl Window {
    fn new(radius: usize, height: usize) -> Self {
        Self { radius, height, held: 0..0 }
    }

    /// Moves to row `y`; `update(row, sign)` adds (+1) or takes out (-1) a row. `y` grows from call to call.
    fn slide(&mut self, y: usize, mut update: impl FnMut(usize, f64)) {
        let wanted = y.saturating_sub(self.radius)..(y + self.radius + 1).min(self.height);
        let from = if self.held.is_empty() { wanted.start } else { self.held.end };
        for row in from..wanted.end {
            update(row, 1.0);
        }
        if !self.held.is_empty() {
            for row in self.held.start..wanted.start {
                update(row, -1.0);
            }
        }
        self.held = wanted;
    }
}

/// Where column sums lie in a buffer with room for windows that hang over the ends of the picture.
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

/// The part of `span` inside the columns `start..start + width`, in their own count.
fn clip(span: &Range<usize>, start: usize, width: usize) -> Range<usize> {
    span.start.clamp(start, start + width) - start..span.end.clamp(start, start + width) - start
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speckle(x: usize, y: usize) -> u16 {
        ((x * x * 37 + y * 8123 + x * y * 977) % 65_536) as u16
    }

    struct Case {
        grey: Plane<u16>,
        map: Plane<bool>,
        valid: Vec<Range<usize>>,
    }

    impl Case {
        fn new(width: usize, height: usize, valid: impl Fn(usize) -> Range<usize>) -> Self {
            Self {
                grey: Plane::from_fn(width, height, speckle),
                map: Plane::from_fn(width, height, |x, y| (x / 5 + y / 7) % 3 == 0),
                valid: (0..height).map(valid).collect(),
            }
        }

        fn filter(&self, radius: usize, eps: f64, inner: Rect) -> Vec<f32> {
            let mut out = vec![f32::NAN; inner.width * inner.height];
            let guide = Guide { grey: &self.grey, valid: &self.valid };
            GuidedFilter::new(radius, eps).apply(guide, &self.map, inner, &mut out);
            out
        }

        /// The definition, window by window, in f64.
        fn definition(&self, radius: usize, eps: f64) -> Plane<f64> {
            let (width, height) = (self.grey.width, self.grey.height);
            let around = |x: usize, y: usize| {
                let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
                rows.flat_map(move |v| (x.saturating_sub(radius)..(x + radius + 1).min(width)).map(move |u| (u, v)))
                    .filter(|&(u, v)| self.valid[v].contains(&u))
                    .collect::<Vec<_>>()
            };
            let intensity = |(x, y): (usize, usize)| f64::from(self.grey.at(x, y)) / SCALE;
            let p = |(x, y): (usize, usize)| f64::from(u8::from(self.map.at(x, y)));
            let lines = Plane::from_fn(width, height, |x, y| {
                let window = around(x, y);
                let n = window.len() as f64;
                let mean_i = window.iter().map(|&at| intensity(at)).sum::<f64>() / n;
                let mean_p = window.iter().map(|&at| p(at)).sum::<f64>() / n;
                let cov = window.iter().map(|&at| (intensity(at) - mean_i) * (p(at) - mean_p)).sum::<f64>() / n;
                let var = window.iter().map(|&at| (intensity(at) - mean_i).powi(2)).sum::<f64>() / n;
                let a = cov / (var + eps);
                (a, mean_p - a * mean_i)
            });
            Plane::from_fn(width, height, |x, y| {
                if !self.valid[y].contains(&x) {
                    return 0.0;
                }
                let window = around(x, y);
                let sum =
                    window.iter().fold((0.0, 0.0), |sum, &(u, v)| (sum.0 + lines.at(u, v).0, sum.1 + lines.at(u, v).1));
                (sum.0 * intensity((x, y)) + sum.1) / window.len() as f64
            })
        }
    }

    #[test]
    fn it_is_he_s_definition_on_the_valid_pixels() {
        for (radius, eps) in [(3, 1e-6), (6, 0.3), (40, 0.3)] {
            for case in [Case::new(31, 26, |_| 0..31), Case::new(31, 26, |y| (y / 3)..(31 - y / 5))] {
                let expected = case.definition(radius, eps);
                let got = case.filter(radius, eps, Rect::whole(31, 26));
                for (got, expected) in got.iter().zip(&expected.data) {
                    assert!((f64::from(*got) - expected).abs() < 1e-5, "{got} instead of {expected}");
                }
            }
        }
    }

    #[test]
    fn a_part_of_a_picture_gets_the_same_bits_as_the_whole() {
        let case = Case::new(90, 70, |y| if y < 9 { 0..0 } else { y / 4..90 });
        for (radius, eps) in [(4, 1e-6), (9, 0.3)] {
            let whole = case.filter(radius, eps, Rect::whole(90, 70));
            let part = Rect { x: 37, y: 22, width: 20, height: 13 };
            let cut = part.grown(2 * radius, 90, 70);
            let small = Case {
                grey: Plane::from_fn(cut.width, cut.height, |x, y| case.grey.at(x + cut.x, y + cut.y)),
                map: Plane::from_fn(cut.width, cut.height, |x, y| case.map.at(x + cut.x, y + cut.y)),
                valid: case.valid[cut.y..cut.y + cut.height].iter().map(|span| clip(span, cut.x, cut.width)).collect(),
            };
            let inner = Rect { x: part.x - cut.x, y: part.y - cut.y, ..part };
            let got = small.filter(radius, eps, inner);
            for y in 0..part.height {
                let start = (part.y + y) * 90 + part.x;
                assert_eq!(got[y * 20..(y + 1) * 20], whole[start..start + 20]);
            }
        }
    }

    #[test]
    fn a_map_that_is_constant_in_reach_comes_back_exactly() {
        let mut case = Case::new(64, 64, |y| if y == 50 { 0..40 } else { 0..64 });
        for value in [false, true] {
            case.map.data.fill(value);
            for (radius, eps) in [(7, 1e-6), (45, 0.3)] {
                let out = case.filter(radius, eps, Rect { x: 0, y: 0, width: 64, height: 50 });
                assert!(out.iter().all(|&v| v == f32::from(u8::from(value))));
            }
        }
    }

    #[test]
    fn windows_without_any_valid_pixel_give_zero_and_never_nan() {
        let case = Case::new(20, 20, |_| 0..0);
        assert!(case.filter(7, 1e-6, Rect::whole(20, 20)).iter().all(|&v| v == 0.0));
    }
}
