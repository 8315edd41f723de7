//! The largest value in the square around each pixel.

use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// For each pixel of `rect`, the largest of `values` within `REACH` px along both axes. `values` are those of `window`,
/// which contains `rect`, row by row; none is below the default of `T`, and there are none outside the window.
pub(super) fn sliding_maximum<T: Copy + Default + PartialOrd, const REACH: usize>(
    values: &[T],
    window: Rect,
    rect: Rect,
) -> Vec<T> {
    let simd = Avx2::detect();
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let mut maximum = vec![T::default(); rect.width * rect.height];
    // the maximum of each column, with `REACH` columns on either side of the rectangle
    let mut columns = vec![T::default(); rect.width + 2 * REACH];
    let first = left.saturating_sub(REACH);
    let end = (left + rect.width + REACH).min(window.width);
    let at = REACH - left.min(REACH);
    for (y, out) in maximum.chunks_exact_mut(rect.width.max(1)).enumerate() {
        let rows = (top + y).saturating_sub(REACH)..(top + y + REACH + 1).min(window.height);
        simd::run(
            simd,
            #[inline(always)]
            || {
                columns.fill(T::default());
                let inside = &mut columns[at..at + end - first];
                for row in rows {
                    raise(inside, &values[row * window.width + first..row * window.width + end]);
                }
                for by in 0..2 * REACH + 1 {
                    raise(out, &columns[by..]);
                }
            },
        );
    }
    maximum
}

/// Raises each value to its counterpart in `to` where that is larger.
#[inline(always)]
fn raise<T: Copy + PartialOrd>(values: &mut [T], to: &[T]) {
    values.iter_mut().zip(to).for_each(|(value, &to)| *value = if to > *value { to } else { *value });
}

#[cfg(test)]
mod tests {
    use super::*;

    const REACH: usize = 4;

    #[test]
    fn the_maximum_is_that_of_the_square_around_each_pixel() {
        let window = Rect { x: 5, y: 7, width: 23, height: 17 };
        let values: Vec<f32> = (0..23 * 17).map(|at| ((at * 7919 + 13) % 101) as f32).collect();
        let parts = [(5, 7, 23, 17), (9, 8, 6, 3), (20, 20, 8, 4)];
        for rect in parts.map(|(x, y, width, height)| Rect { x, y, width, height }) {
            let maximum = sliding_maximum::<f32, REACH>(&values, window, rect);
            for y in 0..rect.height {
                for x in 0..rect.width {
                    let (u, v) = (rect.x - window.x + x, rect.y - window.y + y);
                    let rows = v.saturating_sub(REACH)..(v + REACH + 1).min(17);
                    let of_row = |row: usize| &values[row * 23..][u.saturating_sub(REACH)..(u + REACH + 1).min(23)];
                    let expected = rows.flat_map(of_row).copied().fold(0.0, f32::max);
                    assert_eq!(maximum[y * rect.width + x], expected);
                }
            }
        }
    }
}
