//! The slices that are the sharpest somewhere in a rectangle. Any other slice has the weight 0 at each pixel whose
//! filter windows lie within the rectangle, and is skipped there.

use crate::{
    fusion::plan::UNCOVERED,
    imaging::{Plane, Rect},
};

/// Side of a cell, px.
const CELL: usize = 32;

/// Per cell: the set of slices that are the sharpest at one of its pixels.
pub(super) struct Presence {
    columns: usize,
    /// Words of a set.
    words: usize,
    slices: usize,
    bits: Vec<u64>,
}

/// The slices that are the sharpest somewhere in a rectangle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Present {
    /// Ascending indices.
    pub slices: Vec<usize>,
    /// Whether any pixel is covered by no slice.
    pub uncovered: bool,
}

impl Presence {
    /// `index` is the sharpest slice per pixel.
    pub(super) fn new(index: &Plane<u16>, slices: usize) -> Self {
        let (columns, rows) = (index.width.div_ceil(CELL), index.height.div_ceil(CELL));
        // one more bit: pixels that no slice covers
        let words = (slices + 1).div_ceil(64);
        let mut bits = vec![0u64; columns * rows * words];
        for y in 0..index.height {
            let cells = &mut bits[y / CELL * columns * words..][..columns * words];
            for (cell, run) in cells.chunks_exact_mut(words).zip(index.row(y).chunks(CELL)) {
                for &slice in run {
                    let bit = if slice == UNCOVERED { slices } else { usize::from(slice) };
                    cell[bit / 64] |= 1 << (bit % 64);
                }
            }
        }
        Self { columns, words, slices, bits }
    }

    /// The slices in `rect`, and perhaps some less than [`CELL`] px beside it.
    pub(super) fn within(&self, rect: Rect) -> Present {
        let mut set = vec![0u64; self.words];
        for row in rect.y / CELL..(rect.y + rect.height).div_ceil(CELL) {
            for column in rect.x / CELL..(rect.x + rect.width).div_ceil(CELL) {
                let cell = &self.bits[(row * self.columns + column) * self.words..][..self.words];
                for (all, some) in set.iter_mut().zip(cell) {
                    *all |= some;
                }
            }
        }
        let has = |bit: usize| set[bit / 64] >> (bit % 64) & 1 == 1;
        Present { slices: (0..self.slices).filter(|&slice| has(slice)).collect(), uncovered: has(self.slices) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_has_the_slices_in_it_and_none_far_away() {
        let index = Plane::from_fn(200, 100, |x, y| match (x, y) {
            (..60, _) => 70,
            (190.., 90..) => UNCOVERED,
            _ => 3,
        });
        let presence = Presence::new(&index, 71);
        let within = |x, y, width, height| presence.within(Rect { x, y, width, height });
        assert_eq!(within(0, 0, 20, 100), Present { slices: vec![70], uncovered: false });
        assert_eq!(within(50, 0, 20, 10), Present { slices: vec![3, 70], uncovered: false });
        assert_eq!(within(195, 95, 5, 5), Present { slices: vec![3], uncovered: true });
    }
}
