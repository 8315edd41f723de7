//! The filters of the pyramid: reduce, expand (Burt & Adelson 1983, a = 3/8: the binomial kernel) and smooth.
//!
//! Every pixel is computed by the same operations in the same order, whatever the rectangle it is computed in.

use crate::imaging::Rect;

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
#[derive(Default)]
pub(super) struct Filters {
    line: Vec<Pixel>,
    wide: Vec<Pixel>,
    half: Patch<Pixel>,
    narrow: Vec<f32>,
    across: Patch<f32>,
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
            for (c, out) in self.half.row_mut(y).iter_mut().enumerate() {
                for (weight, pixel) in REDUCE.iter().zip(&self.line[2 * c..]) {
                    add(out, *weight, pixel);
                }
            }
        }
        out.reset(rect, [0.0; 4]);
        for y in rect.y..rect.y + rect.height {
            for (tap, weight) in REDUCE.iter().enumerate() {
                let Some(from) = (2 * y + tap).checked_sub(2).filter(|&from| self.half.has_row(from)) else { continue };
                for (out, pixel) in out.row_mut(y).iter_mut().zip(self.half.row(from)) {
                    add(out, *weight, pixel);
                }
            }
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
                    let row = coarse.row(from as usize);
                    self.line[1..].iter_mut().zip(row).for_each(|(sum, pixel)| add(sum, weight, pixel));
                }
            }
            self.wide.clear();
            self.wide.extend(columns.iter().map(|(first, weights)| {
                let mut sum = [0.0; 4];
                for (weight, pixel) in weights.iter().zip(&self.line[*first..]) {
                    add(&mut sum, *weight, pixel);
                }
                sum
            }));
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

    fn convolve(&mut self, kernel: &[f32], values: &Patch<f32>, rect: Rect, out: &mut Patch<f32>) {
        let reach = kernel.len() / 2;
        self.across.reset(Rect { x: rect.x, width: rect.width, ..values.rect }, 0.0);
        let skipped = values.rect.x as isize + reach as isize - rect.x as isize;
        for y in values.rect.y..values.rect.y + values.rect.height {
            laid(values.row(y), skipped, rect.width + 2 * reach, &mut self.narrow);
            let row = self.across.row_mut(y);
            for (tap, weight) in kernel.iter().enumerate() {
                for (out, value) in row.iter_mut().zip(&self.narrow[tap..]) {
                    *out += weight * value;
                }
            }
        }
        out.reset(rect, 0.0);
        for y in rect.y..rect.y + rect.height {
            for (tap, weight) in kernel.iter().enumerate() {
                let Some(from) = (y + tap).checked_sub(reach).filter(|&from| self.across.has_row(from)) else {
                    continue;
                };
                for (out, value) in out.row_mut(y).iter_mut().zip(self.across.row(from)) {
                    *out += weight * value;
                }
            }
        }
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
