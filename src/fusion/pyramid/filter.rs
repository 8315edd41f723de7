//! The filters of the pyramid: reduce, expand (Burt & Adelson 1983, a = 3/8: the binomial kernel) and smooth.
//!
//! Every pixel is computed by the same operations in the same order, whatever the rectangle it is computed in.

use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// A pixel: three channels (of a grey picture the first), and a weight.
pub(super) type Pixel = [f32; 4];

/// Pixels of one level: a rectangle of the plane of that level.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Patch<T> {
    /// Where it lies.
    pub rect: Rect,
    /// Its pixels, row by row.
    pub data: Vec<T>,
}

impl<T: Copy> Patch<T> {
    /// Makes this `rect`, filled with `value`.
    pub fn reset(&mut self, rect: Rect, value: T) {
        self.rect = rect;
        self.data.clear();
        self.data.resize(rect.width * rect.height, value);
    }

    /// Row `y` of the plane.
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[(y - self.rect.y) * self.rect.width..][..self.rect.width]
    }

    /// The same.
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[(y - self.rect.y) * self.rect.width..][..self.rect.width]
    }

    /// Whether row `y` of the plane lies in this.
    fn has_row(&self, y: usize) -> bool {
        (self.rect.y..self.rect.y + self.rect.height).contains(&y)
    }
}

/// Middle of the kernel that levels are reduced with.
pub(super) const MIDDLE: f32 = 0.375;
const REDUCE: [f32; 5] = [0.0625, 0.25, MIDDLE, 0.25, 0.0625];
/// Twice the kernel of [`REDUCE`], one after the other.
const SMOOTH: [f32; 9] = [
    1.0 / 256.0,
    8.0 / 256.0,
    28.0 / 256.0,
    56.0 / 256.0,
    70.0 / 256.0,
    56.0 / 256.0,
    28.0 / 256.0,
    8.0 / 256.0,
    1.0 / 256.0,
];
/// Reach of [`Filters::smooth`], px.
pub(super) const SMOOTHING: usize = SMOOTH.len() / 2;

#[inline(always)]
fn add(sum: &mut Pixel, weight: f32, pixel: &Pixel) {
    for (sum, value) in sum.iter_mut().zip(pixel) {
        *sum += weight * value;
    }
}

/// Where three pixels of a coarse row lie that a fine pixel is made of, and their weights. Beyond the ends of a
/// plane of `length` coarse pixels there is nothing, and the others weigh more.
fn taps(fine: usize, length: usize) -> (isize, [f32; 3]) {
    let middle = (fine / 2) as isize;
    let (first, mut weights) = match fine % 2 {
        0 => (middle - 1, [0.125, 0.75, 0.125]),
        _ => (middle, [0.5, 0.5, 0.0]),
    };
    let mut total = 0.0;
    for (at, weight) in (first..).zip(&mut weights) {
        if at < 0 || at >= length as isize {
            *weight = 0.0;
        }
        total += *weight;
    }
    (first, weights.map(|weight| weight / total))
}

/// Buffers of the filters.
pub(super) struct Filters {
    simd: Option<Avx2>,
    nothing: Vec<Pixel>,
    line: Vec<Pixel>,
    wide: Vec<Pixel>,
    half: Patch<Pixel>,
    narrow: Vec<f32>,
    across: Patch<f32>,
}

impl Default for Filters {
    fn default() -> Self {
        Self {
            simd: Avx2::detect(),
            nothing: Vec::new(),
            line: Vec::new(),
            wide: Vec::new(),
            half: Patch::default(),
            narrow: Vec::new(),
            across: Patch::default(),
        }
    }
}

impl Filters {
    /// The next coarser level of `fine`: sums, also of the weights. Beyond the canvas there is nothing.
    pub fn reduce(&mut self, fine: &Patch<Pixel>, rect: Rect, out: &mut Patch<Pixel>) {
        self.half.reset(Rect { x: rect.x, width: rect.width, ..fine.rect }, [0.0; 4]);
        // two pixels of nothing before the first one that is needed, at least two after the last
        let skipped = fine.rect.x as isize - (2 * rect.x as isize - 2);
        let length = 2 * rect.width + 3;
        for y in fine.rect.y..fine.rect.y + fine.rect.height {
            laid(fine.row(y), skipped, length, &mut self.line);
            let (line, row) = (&self.line[..], self.half.row_mut(y));
            simd::run(
                self.simd,
                #[inline(always)]
                || halve(row, line),
            );
        }
        out.reset(rect, [0.0; 4]);
        self.nothing.resize(rect.width, [0.0; 4]);
        for y in rect.y..rect.y + rect.height {
            let rows = std::array::from_fn(|tap| {
                let from = (2 * y + tap).checked_sub(2).filter(|&from| self.half.has_row(from));
                from.map_or(&self.nothing[..], |from| self.half.row(from)).as_flattened()
            });
            let row = out.row_mut(y).as_flattened_mut();
            simd::run(
                self.simd,
                #[inline(always)]
                || weigh(row, rows, &REDUCE),
            );
        }
    }

    /// Calls `each` for every row of `rect` of the next finer level with that row, expanded from `coarse`, which
    /// is part of a plane of `size`.
    pub fn expand(
        &mut self,
        coarse: &Patch<Pixel>,
        size: (usize, usize),
        rect: Rect,
        mut each: impl FnMut(usize, &[Pixel]),
    ) {
        let columns: Vec<(usize, [f32; 3])> = (rect.x..rect.x + rect.width)
            .map(|x| {
                let (first, weights) = taps(x, size.0);
                ((first + 1 - coarse.rect.x as isize).max(0) as usize, weights)
            })
            .collect();
        for y in rect.y..rect.y + rect.height {
            let (first, weights) = taps(y, size.1);
            // one pixel before, two after
            self.line.clear();
            self.line.resize(coarse.rect.width + 3, [0.0; 4]);
            for (from, weight) in (first..).zip(weights) {
                if weight > 0.0 {
                    let (line, row) = (self.line[1..].as_flattened_mut(), coarse.row(from as usize).as_flattened());
                    simd::run(
                        self.simd,
                        #[inline(always)]
                        || line.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value),
                    );
                }
            }
            self.wide.resize(columns.len(), [0.0; 4]);
            let (line, wide) = (&self.line[..], &mut self.wide[..]);
            simd::run(
                self.simd,
                #[inline(always)]
                || widen(wide, line, &columns),
            );
            each(y, &self.wide);
        }
    }

    /// `values` smoothed, in `rect`, which lies in them with all that is looked at, save what lies beyond the
    /// canvas: that counts as 0.
    pub fn smooth(&mut self, values: &Patch<f32>, rect: Rect, out: &mut Patch<f32>) {
        self.convolve(&SMOOTH, values, rect, out);
    }

    /// The same with the kernel that levels are reduced with.
    pub fn smooth_less(&mut self, values: &Patch<f32>, rect: Rect, out: &mut Patch<f32>) {
        self.convolve(&REDUCE, values, rect, out);
    }

    fn convolve<const K: usize>(&mut self, kernel: &[f32; K], values: &Patch<f32>, rect: Rect, out: &mut Patch<f32>) {
        let reach = kernel.len() / 2;
        self.across.reset(Rect { x: rect.x, width: rect.width, ..values.rect }, 0.0);
        let skipped = values.rect.x as isize + reach as isize - rect.x as isize;
        for y in values.rect.y..values.rect.y + values.rect.height {
            laid(values.row(y), skipped, rect.width + 2 * reach, &mut self.narrow);
            let (row, line) = (self.across.row_mut(y), &self.narrow[..]);
            simd::run(
                self.simd,
                #[inline(always)]
                || weigh(row, std::array::from_fn(|tap| &line[tap..]), kernel),
            );
        }
        out.reset(rect, 0.0);
        self.narrow.clear();
        self.narrow.resize(rect.width, 0.0);
        for y in rect.y..rect.y + rect.height {
            let rows = std::array::from_fn(|tap| {
                let from = (y + tap).checked_sub(reach).filter(|&from| self.across.has_row(from));
                from.map_or(&self.narrow[..], |from| self.across.row(from))
            });
            let row = out.row_mut(y);
            simd::run(
                self.simd,
                #[inline(always)]
                || weigh(row, rows, kernel),
            );
        }
    }
}

/// Sums of `K` rows, each with its weight.
#[inline(always)]
fn weigh<const K: usize>(out: &mut [f32], rows: [&[f32]; K], kernel: &[f32; K]) {
    let count = out.len();
    let rows = rows.map(|row| &row[..count]);
    for (x, out) in out.iter_mut().enumerate() {
        let mut sum = 0.0;
        for tap in 0..K {
            sum += kernel[tap] * rows[tap][x];
        }
        *out = sum;
    }
}

/// Every other pixel of `line`, from its third on, with its neighbours.
#[inline(always)]
fn halve(out: &mut [Pixel], line: &[Pixel]) {
    for (out, around) in out.iter_mut().zip(line.windows(REDUCE.len()).step_by(2)) {
        let mut sum = [0.0; 4];
        for (weight, pixel) in REDUCE.iter().zip(around) {
            add(&mut sum, *weight, pixel);
        }
        *out = sum;
    }
}

/// Fine pixels, each of three of `line` from the given one on.
#[inline(always)]
fn widen(out: &mut [Pixel], line: &[Pixel], columns: &[(usize, [f32; 3])]) {
    for (out, (first, weights)) in out.iter_mut().zip(columns) {
        let mut sum = [0.0; 4];
        for (weight, pixel) in weights.iter().zip(&line[*first..*first + 3]) {
            add(&mut sum, *weight, pixel);
        }
        *out = sum;
    }
}

/// `row` in a line of `length`, starting at `at` (what would come before the line is left out), nothing around it.
fn laid<T: Copy + Default>(row: &[T], at: isize, length: usize, line: &mut Vec<T>) {
    line.clear();
    line.resize(length, T::default());
    let (skip, at) = if at < 0 { (at.unsigned_abs(), 0) } else { (0, at as usize) };
    for (to, from) in line.iter_mut().skip(at).zip(row.iter().skip(skip)) {
        *to = *from;
    }
}
