//! The Laplacian of a row, and the border that rows are continued by.

use std::ops::Range;

/// A function `of` the Laplacian (kernel `[0 1 0; 1 -4 1; 0 1 0]`) of the middle row, with repeated border. Neighbours
/// are added in pairs, so that a constant gives exactly 0.
#[inline(always)]
pub(super) fn laplacian([above, middle, below]: [&[f32]; 3], out: &mut [f32], of: impl Fn(f32) -> f32) {
    let width = middle.len();
    let value = |x: usize, left: usize, right: usize| {
        of((above[x] + below[x]) + (middle[left] + middle[right]) - 4.0 * middle[x])
    };
    out[0] = value(0, 0, 1.min(width - 1));
    out[width - 1] = value(width - 1, width.saturating_sub(2), width - 1);
    if width < 3 {
        return;
    }
    let inner = out[1..width - 1].iter_mut().zip(&middle[..width - 2]).zip(&middle[2..]);
    let columns = above[1..width - 1].iter().zip(&middle[1..width - 1]).zip(&below[1..width - 1]);
    for (((out, left), right), ((above, here), below)) in inner.zip(columns) {
        *out = of((above + below) + (left + right) - 4.0 * here);
    }
}

/// Continues a row by the values at the ends of `inner`.
pub(super) fn repeat_border(row: &mut [f32], inner: Range<usize>) {
    let (left, right) = (row[inner.start], row[inner.end - 1]);
    row[..inner.start].fill(left);
    row[inner.end..].fill(right);
}
