//! What is around some pixels of a tile.

use crate::imaging::Rect;

/// The smallest rectangle of the canvas around `pixels`, each an index within the tile `rect`, row by row.
pub(super) fn bounds(pixels: impl Iterator<Item = usize>, rect: Rect) -> Rect {
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for at in pixels {
        let (x, y) = (at % rect.width, at / rect.width);
        (left, right, top, bottom) = (left.min(x), right.max(x), top.min(y), bottom.max(y));
    }
    let (left, top) = (left.min(right), top.min(bottom));
    Rect { x: rect.x + left, y: rect.y + top, width: right - left + 1, height: bottom - top + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_hold_all_pixels_and_no_more() {
        let rect = Rect { x: 100, y: 50, width: 20, height: 10 };
        let at = |x: usize, y: usize| y * 20 + x;
        let around = bounds([at(7, 2), at(3, 8), at(5, 5)].into_iter(), rect);
        assert_eq!(around, Rect { x: 103, y: 52, width: 5, height: 7 });
    }
}
