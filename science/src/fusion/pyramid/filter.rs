//! The filters of the pyramid: reduce, expand and smooth (Burt & Adelson 1983, with `a = 3/8`: the binomial kernel).
//!
//! Every pixel is computed by the same operations in the same order in any rectangle, so that tiles do not affect the
//! result.

use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// A rectangle of the plane of a level.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Patch<T> {
    /// The rectangle.
    pub rect: Rect,
    /// Its values, row by row.
    pub data: Vec<T>,
}

/// A level: three channels (only the first is used for grey), and weights.
pub(super) type Level = [Patch<f32>; 4];

/// Index of the weights in a [`Level`].
pub(super) const WEIGHT: usize = 3;

impl<T: Copy> Patch<T> {
    /// Sets the rectangle, filled with `value`.
    pub(super) fn reset(&mut self, rect: Rect, value: T) {
        self.data.clear();
        self.shape(rect, value);
    }

    /// Sets the rectangle; its values are unspecified.
    pub(super) fn shape(&mut self, rect: Rect, value: T) {
        self.rect = rect;
        self.data.resize(rect.width * rect.height, value);
    }

    /// The part of row `y` of the plane that is in the rectangle.
    pub(super) fn row(&self, y: usize) -> &[T] {
        &self.data[(y - self.rect.y) * self.rect.width..][..self.rect.width]
    }

    /// `width` values of row `y`, from column `x` on.
    pub(super) fn part(&self, x: usize, y: usize, width: usize) -> &[T] {
        &self.row(y)[x - self.rect.x..][..width]
    }

    /// The part of row `y` of the plane that is in the rectangle, mutable.
    pub(super) fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.data[(y - self.rect.y) * self.rect.width..][..self.rect.width]
    }

    /// The same part of row `y` as [`Patch::part`], mutable.
    pub(super) fn part_mut(&mut self, x: usize, y: usize, width: usize) -> &mut [T] {
        let start = x - self.rect.x;
        &mut self.row_mut(y)[start..start + width]
    }

    /// Whether row `y` of the plane is in the rectangle.
    fn has_row(&self, y: usize) -> bool {
        (self.rect.y..self.rect.y + self.rect.height).contains(&y)
    }
}

/// The binomial kernel of 5 taps.
const BINOMIAL: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
/// That kernel convolved with itself.
pub(super) const ENERGY_KERNEL: [f32; 9] = [
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
/// Reach of [`ENERGY_KERNEL`], px.
pub(super) const ENERGY_REACH: usize = ENERGY_KERNEL.len() / 2;

/// The three pixels of a coarse row of `length` px that a fine pixel is interpolated from: index of the first, and
/// weights. Pixels beyond the ends have the weight 0, and the weights add up to 1.
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

/// Per level of `lengths` px along one axis, and per pixel: the fraction of its kernel that lies on the canvas.
pub(super) fn weights_along(lengths: &[usize]) -> Vec<Vec<f32>> {
    let mut levels = vec![vec![1.0f32; lengths[0]]];
    for &length in &lengths[1..] {
        let finer = &levels[levels.len() - 1];
        let of = |x: usize| -> f32 {
            let around = BINOMIAL
                .iter()
                .enumerate()
                .filter_map(|(tap, weight)| Some(weight * finer.get((2 * x + tap).checked_sub(2)?).copied()?));
            around.fold(0.0, |sum, part| sum + part)
        };
        levels.push((0..length).map(of).collect());
    }
    levels
}

/// The filters and their buffers.
#[derive(Default)]
pub(super) struct Filters {
    nothing: Vec<f32>,
    line: Vec<f32>,
    halves: [Vec<f32>; 2],
    across: Patch<f32>,
}

impl Filters {
    /// Reduces `fine` to the rectangle `rect` of the next coarser plane. Pixels beyond the canvas count as 0.
    pub(super) fn reduce(&mut self, simd: Option<Avx2>, fine: &Patch<f32>, rect: Rect, out: &mut Patch<f32>) {
        let Self { nothing, line, halves, across } = self;
        across.shape(Rect { x: rect.x, width: rect.width, ..fine.rect }, 0.0);
        // two zeros before the first pixel that is needed, at least two after the last
        let skipped = fine.rect.x as isize - (2 * rect.x as isize - 2);
        let length = 2 * rect.width + 4;
        for y in fine.rect.y..fine.rect.y + fine.rect.height {
            place_row(fine.row(y), skipped, length, line);
            let row = across.row_mut(y);
            simd::run(
                simd,
                #[inline(always)]
                || {
                    split(line, halves);
                    let [even, odd] = &*halves;
                    let count = row.len();
                    weigh(row, [even, odd, &even[1..], &odd[1..], &even[2..]].map(|taps| &taps[..count]), &BINOMIAL);
                },
            );
        }
        out.shape(rect, 0.0);
        nothing.clear();
        nothing.resize(rect.width, 0.0);
        for y in rect.y..rect.y + rect.height {
            let rows = std::array::from_fn(|tap| {
                let from = (2 * y + tap).checked_sub(2).filter(|&from| across.has_row(from));
                from.map_or(&nothing[..], |from| across.row(from))
            });
            let row = out.row_mut(y);
            simd::run(
                simd,
                #[inline(always)]
                || weigh(row, rows, &BINOMIAL),
            );
        }
    }

    /// Expands `coarse`, part of a plane of `size`, to the columns `columns` of row `y` of the next finer plane.
    pub(super) fn expand<'a>(
        &mut self,
        simd: Option<Avx2>,
        coarse: &Patch<f32>,
        size: (usize, usize),
        (y, columns): (usize, &std::ops::Range<usize>),
        out: &'a mut Vec<f32>,
    ) -> &'a mut [f32] {
        let Self { line, .. } = self;
        let (first_row, weights) = taps(y, size.1);
        // coarse pixels under the columns, and one on each side if it exists
        let (start, end) = (columns.start / 2, (columns.end - 1) / 2 + 1);
        let (from, to) = ((start.max(1) - 1).max(coarse.rect.x), (end + 1).min(coarse.rect.x + coarse.rect.width));
        let count = end - start;
        line.clear();
        line.resize(count + 2, 0.0);
        out.resize(2 * count, 0.0);
        let mut rows = (first_row..).zip(weights).filter(|row| row.1 > 0.0);
        let mut next = || rows.next().map(|(row, weight)| (coarse.part(from, row as usize, to - from), weight));
        let rows = [next(), next(), next()];
        simd::run(
            simd,
            #[inline(always)]
            || {
                add_up(rows, &mut line[from + 1 - start..][..to - from]);
                let [before, here, after] = [0, 1, 2].map(|by| &line[by..by + count]);
                for (((out, before), here), after) in
                    out.as_chunks_mut::<2>().0.iter_mut().zip(before).zip(here).zip(after)
                {
                    *out = [0.125 * before + 0.75 * here + 0.125 * after, 0.5 * here + 0.5 * after];
                }
            },
        );
        // at the ends of the plane the weights differ
        let last = 2 * (size.0 - 1);
        for x in [0, last, last + 1] {
            if (2 * start..2 * end).contains(&x) {
                let (first, weights) = taps(x, size.0);
                let sum = (first..)
                    .zip(weights)
                    .filter(|tap| tap.1 > 0.0)
                    .fold(0.0, |sum, (at, weight)| sum + weight * line[(at + 1) as usize - start]);
                out[x - 2 * start] = sum;
            }
        }
        &mut out[columns.start - 2 * start..][..columns.len()]
    }

    /// Smooths `values` by the kernel of 5 taps, in `rect`. `values` must have all pixels that this depends on; pixels
    /// beyond the canvas count as 0.
    pub(super) fn smooth(&mut self, simd: Option<Avx2>, values: &Patch<f32>, rect: Rect, out: &mut Patch<f32>) {
        let Self { nothing, line, across, .. } = self;
        let reach = BINOMIAL.len() / 2;
        across.shape(Rect { x: rect.x, width: rect.width, ..values.rect }, 0.0);
        let skipped = values.rect.x as isize + reach as isize - rect.x as isize;
        for y in values.rect.y..values.rect.y + values.rect.height {
            place_row(values.row(y), skipped, rect.width + 2 * reach, line);
            let row = across.row_mut(y);
            simd::run(
                simd,
                #[inline(always)]
                || weigh(row, std::array::from_fn(|tap| &line[tap..]), &BINOMIAL),
            );
        }
        out.shape(rect, 0.0);
        nothing.clear();
        nothing.resize(rect.width, 0.0);
        for y in rect.y..rect.y + rect.height {
            let rows = std::array::from_fn(|tap| {
                let from = (y + tap).checked_sub(reach).filter(|&from| across.has_row(from));
                from.map_or(&nothing[..], |from| across.row(from))
            });
            let row = out.row_mut(y);
            simd::run(
                simd,
                #[inline(always)]
                || weigh(row, rows, &BINOMIAL),
            );
        }
    }
}

/// The weighted sum of `K` rows.
#[inline(always)]
pub(super) fn weigh<const K: usize>(out: &mut [f32], rows: [&[f32]; K], kernel: &[f32; K]) {
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

/// The weighted sum of up to three rows.
#[inline(always)]
fn add_up(rows: [Option<(&[f32], f32)>; 3], out: &mut [f32]) {
    match rows {
        [Some((a, u)), None, _] => out.iter_mut().zip(a).for_each(|(out, a)| *out = u * a),
        [Some((a, u)), Some((b, v)), None] => {
            out.iter_mut().zip(a).zip(b).for_each(|((out, a), b)| *out = u * a + v * b);
        }
        [Some((a, u)), Some((b, v)), Some((c, w))] => {
            out.iter_mut().zip(a).zip(b).zip(c).for_each(|(((out, a), b), c)| *out = u * a + v * b + w * c);
        }
        [None, ..] => {}
    }
}

/// The even and the odd elements of `line`.
#[inline(always)]
pub(super) fn split<T: Copy + Default>(line: &[T], [even, odd]: &mut [Vec<T>; 2]) {
    let pairs = line.as_chunks::<2>().0;
    even.resize(pairs.len(), T::default());
    odd.resize(pairs.len(), T::default());
    for (([first, second], even), odd) in pairs.iter().zip(even).zip(odd) {
        (*even, *odd) = (*first, *second);
    }
}

/// Writes `row` into a line of `length` zeros, starting at `at`; pixels before the line are omitted.
fn place_row(row: &[f32], at: isize, length: usize, line: &mut Vec<f32>) {
    line.clear();
    line.resize(length, 0.0);
    let (skip, at) = if at < 0 { (at.unsigned_abs(), 0) } else { (0, at as usize) };
    let row = row.get(skip..).unwrap_or_default();
    let count = row.len().min(length.saturating_sub(at));
    line[at..at + count].copy_from_slice(&row[..count]);
}
