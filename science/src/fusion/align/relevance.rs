//! Which slices matter for the finest detail of the pyramid image, per block of 32 x 32 px.
//!
//! Level 0 of a pyramid has three quarters of all pixels, and the weight of a slice there grows with the fourth power
//! of the energy of its detail. Most slices are far out of focus in a block: they have no weight, and need not be
//! processed.
//!
//! In: the [`CellEnergies`] of all slices. Out: [`Relevance`]. With `e_n` the energy of slice `n` in a cell, `e` the
//! largest of all slices, and `E_0` that of noise:
//!
//! | block, with the cells up to 8 px around it | slices |
//! |---|---|
//! | `e <= 4 E_0` in all cells, and all of at least 8 slices cover it | all, with equal weights: they are noise alone |
//! | `e <= 4 E_0` in all cells | all |
//! | else | those that cover only a part of it, and those with `e_n >= e / 4` in a cell with `e > 4 E_0` |

use rayon::prelude::*;

use super::{
    cell_energies::{CellEnergies, STEPS, code_of},
    coarse_focus::CELL,
};
use crate::{
    imaging::{Coverage, Rect},
    types::{Control, Interrupted},
};

/// Side of a block, px.
pub(in crate::fusion) const BLOCK: usize = 32;

/// Cells around a block that count, on each side.
const MARGIN: usize = 2;

/// Energy, in multiples of that of noise, from which a cell has texture.
const TEXTURED: f32 = 4.0;

/// Slices from which noise is averaged with equal weights: the estimate of noise is the lower quartile of the slices.
const MIN_SLICES: usize = 8;

/// A slice matters up to a quarter of the largest energy.
const RELEVANT_STEPS: u8 = 2 * STEPS as u8;

impl CellEnergies {
    /// The slices that matter. `noise` is the energy of noise, `coverages` what each slice covers.
    pub(in crate::fusion) fn relevance(
        &self,
        noise: f32,
        coverages: &[Coverage],
        control: &dyn Control,
    ) -> Result<Relevance, Interrupted> {
        let (height, width) =
            (coverages.first().map_or(0, Coverage::height), coverages.first().map_or(0, Coverage::width));
        let (columns, words) = (width.div_ceil(BLOCK), coverages.len().div_ceil(64));
        let textured = code_of(TEXTURED * noise);
        let rows: Vec<Vec<Block>> = (0..height.div_ceil(BLOCK))
            .into_par_iter()
            .map_init(Buffers::default, |buffers, row| {
                self.row_of_blocks((row, columns), textured, coverages, control, buffers)
            })
            .collect::<Result<_, Interrupted>>()?;
        let (mut uniform, mut slices) = (Vec::new(), Vec::new());
        for block in rows.into_iter().flatten() {
            uniform.push(block.uniform);
            slices.extend(block.slices);
        }
        Ok(Relevance { columns, words, uniform, slices })
    }

    fn row_of_blocks(
        &self,
        (row, columns): (usize, usize),
        textured: u8,
        coverages: &[Coverage],
        control: &dyn Control,
        buffers: &mut Buffers,
    ) -> Result<Vec<Block>, Interrupted> {
        const CELLS: usize = BLOCK / CELL;
        let (first, end) = ((row * CELLS).saturating_sub(MARGIN), ((row + 1) * CELLS + MARGIN).min(self.rows));
        let band = Rect { x: 0, y: first, width: self.columns, height: end - first };
        let Buffers { largest, codes, bytes } = buffers;
        largest.clear();
        largest.resize(band.width * band.height, 0);
        for slice in 0..coverages.len() {
            control.check()?;
            self.read(slice, band, codes, bytes)?;
            largest.iter_mut().zip(&*codes).for_each(|(largest, &code)| *largest = code.max(*largest));
        }
        let around =
            |column: usize| (column * CELLS).saturating_sub(MARGIN)..((column + 1) * CELLS + MARGIN).min(self.columns);
        let any = |column: usize, of: &dyn Fn(usize) -> bool| {
            (0..band.height).any(|y| around(column).any(|x| of(y * band.width + x)))
        };
        let words = coverages.len().div_ceil(64);
        let blank = Block { uniform: false, slices: vec![0; words] };
        let mut blocks = vec![blank; columns];
        let has_texture: Vec<bool> = (0..columns).map(|column| any(column, &|at| largest[at] > textured)).collect();
        for (column, block) in blocks.iter_mut().enumerate() {
            block.uniform = !has_texture[column] && coverages.len() >= MIN_SLICES;
        }
        for (slice, coverage) in coverages.iter().enumerate() {
            control.check()?;
            self.read(slice, band, codes, bytes)?;
            for (column, block) in blocks.iter_mut().enumerate() {
                let rect = Rect { x: column * BLOCK, y: row * BLOCK, width: BLOCK, height: BLOCK };
                let covered = coverage.contains(rect.grown(MARGIN * CELL, coverage.width(), coverage.height()));
                block.uniform &= covered;
                let sharp =
                    |at: usize| largest[at] > textured && codes[at].saturating_add(RELEVANT_STEPS) >= largest[at];
                if !has_texture[column] || !covered || any(column, &sharp) {
                    block.slices[slice / 64] |= 1 << (slice % 64);
                }
            }
        }
        Ok(blocks)
    }
}

#[derive(Default)]
struct Buffers {
    largest: Vec<u8>,
    codes: Vec<u8>,
    bytes: Vec<u8>,
}

#[derive(Clone)]
struct Block {
    uniform: bool,
    /// One bit per slice.
    slices: Vec<u64>,
}

/// How a slice enters a block of level 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::fusion) enum Use {
    /// It has no weight there.
    None,
    /// Weighted by the energy of its detail.
    ByEnergy,
    /// With the same weight as all other slices.
    Equally,
}

/// The slices that matter, per block of [`BLOCK`] x [`BLOCK`] px.
#[derive(Debug, PartialEq)]
pub(in crate::fusion) struct Relevance {
    columns: usize,
    /// Words of 64 slices per block.
    words: usize,
    uniform: Vec<bool>,
    slices: Vec<u64>,
}

impl Relevance {
    /// How `slice` enters the block in which the pixel (`x`, `y`) lies.
    pub(in crate::fusion) fn of(&self, slice: usize, x: usize, y: usize) -> Use {
        let block = y / BLOCK * self.columns + x / BLOCK;
        let matters = self.slices[block * self.words + slice / 64] >> (slice % 64) & 1 == 1;
        match (self.uniform[block], matters) {
            (true, _) => Use::Equally,
            (false, true) => Use::ByEnergy,
            (false, false) => Use::None,
        }
    }

    /// Calls `part` with each part of `rect` in which `slice` is used as `how`: blocks side by side are one part.
    pub(in crate::fusion) fn parts(&self, slice: usize, rect: Rect, how: Use, mut part: impl FnMut(Rect)) {
        let (right, bottom) = (rect.x + rect.width, rect.y + rect.height);
        let mut y = rect.y;
        while y < bottom {
            let below = ((y / BLOCK + 1) * BLOCK).min(bottom);
            let mut x = rect.x;
            while x < right {
                let start = x;
                while x < right && self.of(slice, x, y) == how {
                    x = ((x / BLOCK + 1) * BLOCK).min(right);
                }
                if start < x {
                    part(Rect { x: start, y, width: x - start, height: below - y });
                } else {
                    x = ((x / BLOCK + 1) * BLOCK).min(right);
                }
            }
            y = below;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::types::{Cancelled, NoControl};

    /// The relevance in ten slices of 96 x 64 px, of which the blocks on the left have noise alone, and those on the
    /// right a texture that slice 3 shows sharp and slice 4 half as sharp.
    fn relevance(coverage_of_last: Coverage) -> Relevance {
        relevance_under(&NoControl, coverage_of_last).unwrap()
    }

    fn relevance_under(control: &dyn Control, coverage_of_last: Coverage) -> Result<Relevance, Interrupted> {
        let energies = CellEnergies::create(&std::env::temp_dir(), 96, 64).unwrap();
        let energy = |slice: usize, column: usize| match (slice, column >= 16) {
            (3, true) => 90.0,
            (4, true) => 45.0,
            (slice, _) => 1.0 + 0.1 * slice as f32,
        };
        let mut coverages = vec![Coverage::full(96, 64); 9];
        coverages.push(coverage_of_last);
        for slice in 0..10 {
            let cells: Vec<f32> = (0..24 * 16).map(|at| energy(slice, at % 24)).collect();
            energies.write(slice, &cells).unwrap();
        }
        energies.relevance(1.2, &coverages, control)
    }

    /// Cancels at the given check.
    struct CancelAt(usize, AtomicUsize);

    impl Control for CancelAt {
        fn progress(&self, _stage: &'static str, _completed: usize, _total: usize) {}

        fn check(&self) -> Result<(), Cancelled> {
            if self.1.fetch_add(1, Ordering::Relaxed) == self.0 { Err(Cancelled) } else { Ok(()) }
        }
    }

    #[test]
    fn a_cancel_is_noticed_at_every_slice_that_is_read() {
        // two rows of blocks, for each of which ten slices are read twice
        for check in 0..40 {
            let stop = relevance_under(&CancelAt(check, AtomicUsize::new(0)), Coverage::full(96, 64));
            assert!(matches!(stop, Err(Interrupted::Cancelled(_))), "check {check}: {stop:?}");
        }
    }

    #[test]
    fn slices_far_out_of_focus_do_not_matter_where_there_is_texture() {
        let relevance = relevance(Coverage::full(96, 64));
        let used = |x: usize| -> Vec<Use> { (0..10).map(|slice| relevance.of(slice, x, 40)).collect() };
        assert_eq!(used(10), [Use::Equally; 10]);
        for x in [40, 80] {
            let sharp = [3, 4];
            let expected = |slice: usize| if sharp.contains(&slice) { Use::ByEnergy } else { Use::None };
            assert_eq!(used(x), (0..10).map(expected).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_slice_that_covers_a_part_of_a_block_matters_there() {
        let shifted = crate::types::Homography::similarity(1.0, [-20.0, 0.0]);
        let relevance = relevance(Coverage::of(&shifted, (96, 64), 96, 64));
        // nothing left of column 20
        assert_eq!(relevance.of(9, 10, 0), Use::ByEnergy);
        assert_eq!(relevance.of(0, 10, 0), Use::ByEnergy);
        assert_eq!(relevance.of(9, 80, 0), Use::None);
    }

    #[test]
    fn parts_are_the_blocks_side_by_side() {
        let relevance = relevance(Coverage::full(96, 64));
        let mut parts = Vec::new();
        relevance.parts(3, Rect { x: 20, y: 10, width: 70, height: 30 }, Use::ByEnergy, |part| parts.push(part));
        let part = |y: usize, height: usize| Rect { x: 32, y, width: 58, height };
        assert_eq!(parts, [part(10, 22), part(32, 8)]);
    }
}
