//! The largest value in the square around each pixel.

use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// For each pixel of `rect`, the largest of `values` within `REACH` px along both axes. `values` are those of `window`,
/// which contains `rect`, row by row. Outside the window they count as 0.
pub(super) fn sliding_maximum<const REACH: usize>(values: &[u16], window: Rect, rect: Rect) -> Vec<u16> {
    let (simd, side, width) = (Avx2::detect(), 2 * REACH + 1, rect.width);
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    // the maximum along each row, of the rows up to `REACH` above and below the rectangle; 0 beyond the window
    let mut across = vec![0u16; width * (rect.height + 2 * REACH)];
    let (mut line, mut spare) = (Vec::new(), Vec::new());
    let columns = left.saturating_sub(REACH)..(left + width + REACH).min(window.width);
    let rows = top.saturating_sub(REACH)..(top + rect.height + REACH).min(window.height);
    let at = REACH - left.min(REACH);
    for (y, out) in rows.clone().zip(across.chunks_exact_mut(width.max(1)).skip(REACH - top.min(REACH))) {
        line.clear();
        line.resize(at, 0);
        line.extend_from_slice(&values[y * window.width..][columns.clone()]);
        line.resize(width + 2 * REACH, 0);
        simd::run(
            simd,
            #[inline(always)]
            || {
                let length = doubled(side, |length| {
                    spare.clear();
                    spare.extend_from_slice(&line[length..]);
                    raise(&mut line, &spare);
                });
                out.copy_from_slice(&line[..width]);
                raise(out, &line[side - length..]);
            },
        );
    }
    simd::run(
        simd,
        #[inline(always)]
        || {
            // each row takes up rows below it that have not changed yet
            let length = doubled(side, |length| {
                for y in 0..(rect.height + 2 * REACH).saturating_sub(length) {
                    let (here, below) = across.split_at_mut((y + length) * width);
                    raise(&mut here[y * width..(y + 1) * width], &below[..width]);
                }
            });
            for y in 0..rect.height {
                let (here, below) = across.split_at_mut((y + side - length) * width);
                raise(&mut here[y * width..(y + 1) * width], &below[..width]);
            }
        },
    );
    across.truncate(width * rect.height);
    across
}

/// Calls `double` for the lengths 1, 2, 4 and so on, while twice the length is at most `side`: each time, maxima over
/// windows of a length become maxima over windows twice as long. Returns the length that is reached; two windows of
/// this length cover one of `side`.
#[inline(always)]
fn doubled(side: usize, mut double: impl FnMut(usize)) -> usize {
    let mut length = 1;
    while 2 * length <= side {
        double(length);
        length *= 2;
    }
    length
}

/// Raises each value to its counterpart in `to` where that is larger.
#[inline(always)]
fn raise(values: &mut [u16], to: &[u16]) {
    values.iter_mut().zip(to).for_each(|(value, &to)| *value = to.max(*value));
}

#[cfg(test)]
mod tests {
    use super::*;

    const REACH: usize = 4;

    #[test]
    fn the_maximum_is_that_of_the_square_around_each_pixel() {
        let window = Rect { x: 5, y: 7, width: 23, height: 17 };
        let values: Vec<u16> = (0..23 * 17u32).map(|at| ((at * 7919 + 13) % 101) as u16).collect();
        let parts = [(5, 7, 23, 17), (9, 8, 6, 3), (20, 20, 8, 4)];
        for rect in parts.map(|(x, y, width, height)| Rect { x, y, width, height }) {
            let maximum = sliding_maximum::<REACH>(&values, window, rect);
            for y in 0..rect.height {
                for x in 0..rect.width {
                    let (u, v) = (rect.x - window.x + x, rect.y - window.y + y);
                    let rows = v.saturating_sub(REACH)..(v + REACH + 1).min(17);
                    let of_row = |row: usize| &values[row * 23..][u.saturating_sub(REACH)..(u + REACH + 1).min(23)];
                    let expected = rows.flat_map(of_row).copied().max().unwrap_or(0);
                    assert_eq!(maximum[y * rect.width + x], expected);
                }
            }
        }
    }
}
