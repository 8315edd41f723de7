//! Sampling: the blocks in which the fused image is scored, and the points at which the focus measure of every slice is
//! kept.
//!
//! Both depend on the size of the canvas and on the mask alone, so that the metrics depend neither on the number of
//! threads nor on the tiles of the fusion.

mod blocks;
mod points;

pub use blocks::Blocks;
pub use points::Points;

use crate::imaging::{Plane, Rect};

/// Bounding box and area of an object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub(super) bounds: Rect,
    pixels: usize,
}

impl Extent {
    /// None for an empty object.
    pub(super) fn of(object: &Plane<u8>) -> Option<Self> {
        let (mut top, mut bottom, mut left, mut right, mut pixels) = (None, 0, object.width, 0, 0);
        for y in 0..object.height {
            let row = object.row(y);
            // a plain sum is vectorised; most rows need no more
            let inside: usize = row.chunks(128).map(|part| usize::from(ones(part))).sum();
            if inside == 0 {
                continue;
            }
            pixels += inside;
            top = top.or(Some(y));
            bottom = y;
            left = row[..left.min(row.len())].iter().position(|&v| v != 0).unwrap_or(left);
            right = right + row[right..].iter().rposition(|&v| v != 0).map_or(0, |last| last + 1);
        }
        let top = top?;
        Some(Self { bounds: Rect { x: left, y: top, width: right - left, height: bottom + 1 - top }, pixels })
    }
}

/// Number of non-zero pixels among at most 128.
fn ones(part: &[u8]) -> u8 {
    part.iter().map(|&v| u8::from(v != 0)).sum()
}

/// Number of object pixels in `rect`.
pub(super) fn object_pixels(object: &Plane<u8>, rect: Rect) -> usize {
    let row = |y: usize| &object.row(y)[rect.x..rect.x + rect.width];
    (rect.y..rect.y + rect.height).flat_map(|y| row(y).chunks(128)).map(|part| usize::from(ones(part))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extent_is_the_bounding_box_and_the_number_of_its_pixels() {
        let object =
            Plane::from_fn(300, 50, |x, y| if (40..290).contains(&x) && (7..9).contains(&y) { 255u8 } else { 0 });
        let extent = Extent::of(&object).unwrap();
        assert_eq!((extent.bounds, extent.pixels), (Rect { x: 40, y: 7, width: 250, height: 2 }, 500));
        let mut dot = Plane::filled(300, 50, 0u8);
        dot.row_mut(20)[299] = 1;
        dot.row_mut(30)[3] = 1;
        let extent = Extent::of(&dot).unwrap();
        assert_eq!((extent.bounds, extent.pixels), (Rect { x: 3, y: 20, width: 297, height: 11 }, 2));
        assert!(Extent::of(&Plane::filled(9, 9, 0u8)).is_none());
    }
}
