//! The points at which the focus measure of every slice is kept.

use std::ops::Range;

use super::Extent;
use crate::imaging::Plane;

/// Most points of a canvas, about.
const MOST: usize = 40_000;

/// Every `step`-th pixel of every `step`-th row, with a mask those of the object; the same for every slice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Points {
    step: usize,
    /// Row, and the range of its columns in `columns`.
    rows: Vec<(usize, Range<usize>)>,
    columns: Vec<u32>,
}

impl Points {
    /// The points on a `width` x `height` canvas; with `object` (non-zero inside, of the size of the canvas) those of
    /// the object.
    pub fn of(width: usize, height: usize, object: Option<&Plane<u8>>) -> Self {
        let none = Self { step: 1, rows: Vec::new(), columns: Vec::new() };
        let area = match object {
            None => width * height,
            Some(object) => match Extent::of(object) {
                Some(extent) => extent.pixels,
                None => return none,
            },
        };
        if area == 0 {
            return none;
        }
        let mut step = 1;
        let too_many = |step: usize| match object {
            None => width.div_ceil(step) * height.div_ceil(step) > MOST,
            Some(_) => area > MOST * step * step,
        };
        while too_many(step) {
            step += 1;
        }
        let mut points = Self { step, ..none };
        // centred, but inside a canvas that is narrower than a step
        let first = |size: usize| ((step - 1) / 2).min(size - 1);
        for y in (first(height)..height).step_by(step) {
            let start = points.columns.len();
            let counts = |x: &usize| object.is_none_or(|object| object.at(*x, y) != 0);
            points.columns.extend((first(width)..width).step_by(step).filter(counts).map(|x| x as u32));
            if points.columns.len() > start {
                points.rows.push((y, start..points.columns.len()));
            }
        }
        points
    }

    /// Number of points.
    pub fn count(&self) -> usize {
        self.columns.len()
    }

    /// Distance between neighbouring points along a row or a column, px.
    pub fn step(&self) -> usize {
        self.step
    }

    /// The points (x, y), row by row.
    pub fn positions(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.rows.iter().flat_map(|(y, range)| self.columns[range.clone()].iter().map(|&x| (x as usize, *y)))
    }

    /// Appends the values at the points of row `y` to `out`; NaN outside the `known` columns. Call it in ascending
    /// order of rows.
    pub fn pick(&self, y: usize, values: &[f32], known: &Range<usize>, out: &mut Vec<f32>) {
        let Ok(found) = self.rows.binary_search_by_key(&y, |(row, _)| *row) else { return };
        let value = |&x: &u32| {
            let x = x as usize;
            if known.contains(&x) { values[x] } else { f32::NAN }
        };
        out.extend(self.columns[self.rows[found].1.clone()].iter().map(value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_canvas_is_sampled_sparsely_and_a_small_one_completely() {
        let large = Points::of(6000, 4000, None).count();
        assert!((MOST / 2..=MOST).contains(&large), "{large}");
        assert_eq!(Points::of(40, 30, None).count(), 1200);
        assert!(Points::of(6001, 4003, None).positions().all(|(x, y)| x < 6001 && y < 4003));
    }

    #[test]
    fn a_small_object_on_a_large_canvas_is_sampled_densely() {
        let object = Plane::from_fn(3000, 2000, |x, y| u8::from(x / 200 == 5 && y / 100 == 7));
        let points = Points::of(3000, 2000, Some(&object));
        assert_eq!((points.step(), points.count()), (1, 20_000));
        assert!(points.positions().all(|(x, y)| object.at(x, y) != 0));
        assert_eq!(Points::of(3000, 2000, Some(&object.map(|_| 0))).count(), 0);
    }

    #[test]
    fn a_canvas_of_one_row_is_sampled() {
        let count = Points::of(300_000, 1, None).count();
        assert!((MOST / 2..=MOST).contains(&count), "{count}");
        assert_eq!(Points::of(0, 0, None).count(), 0);
    }

    #[test]
    fn picking_row_by_row_gives_the_values_at_the_positions() {
        let points = Points::of(700, 500, None);
        let value = |x: usize, y: usize| (y * 700 + x) as f32;
        let mut picked = Vec::new();
        for y in 0..500 {
            let row: Vec<f32> = (0..700).map(|x| value(x, y)).collect();
            points.pick(y, &row, &(100..600), &mut picked);
        }
        assert_eq!(picked.len(), points.count());
        for ((x, y), found) in points.positions().zip(picked) {
            let known = (100..600).contains(&x);
            assert!(if known { found == value(x, y) } else { found.is_nan() }, "at {x}, {y}");
        }
    }
}
