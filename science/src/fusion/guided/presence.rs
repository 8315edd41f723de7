//! Which slices won anywhere near a place: where a slice won nowhere in reach of its filters, its weight is
//! exactly 0, and it need not be looked at.

use crate::{
    fusion::UNCOVERED,
    imaging::{Plane, Rect},
};

/// Side of the squares that presence is noted for, px.
const CELL: usize = 32;

/// Per square of [`CELL`] px: the set of slices that won a pixel of it.
pub(super) struct Presence {
    columns: usize,
    words: usize,
    slices: usize,
    bits: Vec<u64>,
}

/// Slices that won somewhere in a rectangle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Present {
    /// Ascending.
    pub slices: Vec<usize>,
    /// Whether some pixel is covered by no slice.
    pub uncovered: bool,
}

impl Presence {
    pub(super) fn new(index: &Plane<u16>, slices: usize) -> Self {
        let (columns, rows) = (index.width.div_ceil(CELL), index.height.div_ceil(CELL));
        // one more bit for pixels that no slice covers
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

    /// Slices that won a pixel in `rect` (or, at most [`CELL`] px, beside it).
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
    fn a_rectangle_knows_the_slices_in_it_and_not_those_far_away() {
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
