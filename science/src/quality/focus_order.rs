//! Focus order: whether the slices come in the order of focus.
//!
//! In the right order the saliency of every part of the object rises to one peak and falls again. A misplaced slice
//! makes a dent or a spike in most of these curves at once. With `l(n)` the logarithm of the saliency of a cell in
//! slice `n`, the excess variation of an order is the mean over the cells of
//!
//! `sum |l(n + 1) - l(n)| - (2 max l - l(first) - l(last))`,
//!
//! which is 0 for curves with one peak. A slice is misplaced if moving it alone removes a considerable part of the
//! excess.

use crate::{
    imaging::Slices,
    types::{Control, Interrupted},
};

/// Cells in each direction over the canvas: coarse, because misplaced slices were also warped by a wrong homography.
const GRID: usize = 20;
/// A cell needs this many points.
const LEAST_POINTS: usize = 6;
/// With fewer cells, or fewer slices, nothing is said about the order.
const LEAST_CELLS: usize = 12;
const LEAST_SLICES: usize = 4;
/// A cell counts if its largest saliency is more than this many times its smallest.
const LEAST_RISE: f32 = 1.3;
/// Moving a slice must remove at least this much excess, in the natural logarithm of saliency, ...
const LEAST_GAIN: f32 = 0.08;
/// ... and at least this share of the whole excess.
const LEAST_GAIN_SHARE: f32 = 0.25;
/// The slices with the largest dents that are tried per round.
const SUSPECTS: usize = 6;

/// True when focus moves more steadily in `order` than in the order of `slices`, by as much as a misplaced slice needs
/// to be reported. Loads every slice once, one at a time. `order` holds 0-based indices of `slices`.
///
/// # Errors
/// Those of loading, and a cancellation by `control`.
pub fn focus_prefers(
    slices: &(impl Slices + ?Sized),
    order: &[usize],
    control: &dyn Control,
) -> Result<bool, Interrupted> {
    Ok(FocusCurves::of_slices(slices, control)?.prefer(order))
}

/// The logarithm of the mean saliency over the slices, cell by cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct FocusCurves {
    slices: usize,
    cells: Vec<Vec<f32>>,
}

impl FocusCurves {
    /// From textured pixels: the position of each and its saliency in every slice (0: unknown). `slices` is their
    /// number.
    pub(super) fn of<'a>(
        textured: impl Iterator<Item = ((usize, usize), &'a [f32])>,
        (width, height): (usize, usize),
        slices: usize,
    ) -> Self {
        let mut sums = vec![(0usize, vec![0.0f32; slices]); GRID * GRID];
        for ((x, y), saliency) in textured {
            if saliency.iter().any(|&value| value <= 0.0) {
                continue;
            }
            let cell = &mut sums[(y * GRID / height.max(1)) * GRID + x * GRID / width.max(1)];
            cell.0 += 1;
            cell.1.iter_mut().zip(saliency).for_each(|(sum, value)| *sum += value);
        }
        let rises = |values: &[f32]| {
            let (low, high) = values.iter().fold((f32::MAX, 0.0f32), |(low, high), &v| (low.min(v), high.max(v)));
            high > LEAST_RISE * low
        };
        let cells = sums.into_iter().filter(|(count, values)| *count >= LEAST_POINTS && rises(values));
        Self { slices, cells: cells.map(|(_, values)| values.into_iter().map(f32::ln).collect()).collect() }
    }

    /// From slices as they were stored: the mean squared gradient of the cells.
    fn of_slices(slices: &(impl Slices + ?Sized), control: &dyn Control) -> Result<Self, Interrupted> {
        let mut energies: Vec<Vec<f32>> = vec![Vec::new(); GRID * GRID];
        for index in 0..slices.count() {
            control.check()?;
            let luma = slices.load(index)?.luma();
            control.check()?;
            let (width, height) = (luma.width, luma.height);
            let mut sums = vec![(0.0f64, 0usize); GRID * GRID];
            for y in 1..height {
                let cells = &mut sums[y * GRID / height * GRID..][..GRID];
                for (x, ((&value, &left), &above)) in
                    luma.row(y).iter().skip(1).zip(luma.row(y)).zip(luma.row(y - 1).iter().skip(1)).enumerate()
                {
                    let cell = &mut cells[(x + 1) * GRID / width];
                    cell.0 += f64::from((value - left).powi(2) + (value - above).powi(2));
                    cell.1 += 1;
                }
            }
            energies.iter_mut().zip(sums).for_each(|(cell, (sum, n))| cell.push((sum / n.max(1) as f64) as f32));
        }
        let rises = |values: &Vec<f32>| {
            let (low, high) = values.iter().fold((f32::MAX, 0.0f32), |(low, high), &v| (low.min(v), high.max(v)));
            low > 0.0 && high > LEAST_RISE * low
        };
        let cells = energies.into_iter().filter(rises).map(|values| values.into_iter().map(f32::ln).collect());
        Ok(Self { slices: slices.count(), cells: cells.collect() })
    }

    /// True when the slices come in `order` rather than in their own order.
    fn prefer(&self, order: &[usize]) -> bool {
        if self.slices < LEAST_SLICES || self.cells.len() < LEAST_CELLS || order.len() != self.slices {
            return false;
        }
        let excess = self.excess(&(0..self.slices).collect::<Vec<_>>());
        excess - self.excess(order) >= LEAST_GAIN.max(LEAST_GAIN_SHARE * excess)
    }

    /// The slices in the order of focus, if they do not come in that order or its reverse; else none.
    pub(super) fn other_order(&self) -> Option<Vec<u32>> {
        if self.slices < LEAST_SLICES || self.cells.len() < LEAST_CELLS {
            return None;
        }
        let mut order: Vec<usize> = (0..self.slices).collect();
        let mut excess = self.excess(&order);
        for _ in 0..self.slices {
            let Some((moved, less)) = self.best_move(&order, excess) else { break };
            if excess - less < LEAST_GAIN.max(LEAST_GAIN_SHARE * excess) {
                break;
            }
            (order, excess) = (moved, less);
        }
        let in_order = order.iter().enumerate().all(|(place, &slice)| place == slice);
        (!in_order).then(|| order.into_iter().map(|slice| slice as u32).collect())
    }

    /// The order with the least excess among those with one slice moved, and its excess; none if no move helps.
    fn best_move(&self, order: &[usize], excess: f32) -> Option<(Vec<usize>, f32)> {
        let mut suspects: Vec<(f32, usize)> = (0..order.len()).map(|place| (self.dent(order, place), place)).collect();
        suspects.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Option<(Vec<usize>, f32)> = None;
        for &(_, from) in suspects.iter().take(SUSPECTS) {
            for to in 0..order.len() {
                let mut moved = order.to_vec();
                let slice = moved.remove(from);
                moved.insert(to, slice);
                let less = self.excess(&moved);
                if less < best.as_ref().map_or(excess, |best| best.1) {
                    best = Some((moved, less));
                }
            }
        }
        best
    }

    /// Excess variation of an order: mean over the cells of the variation beyond one rise and one fall.
    fn excess(&self, order: &[usize]) -> f32 {
        let of_cell = |cell: &Vec<f32>| {
            let value = |place: usize| cell[order[place]];
            let (mut highest, mut variation) = (value(0), 0.0);
            for place in 1..order.len() {
                variation += (value(place) - value(place - 1)).abs();
                highest = highest.max(value(place));
            }
            variation - (2.0 * highest - value(0) - value(order.len() - 1))
        };
        self.cells.iter().map(of_cell).sum::<f32>() / self.cells.len() as f32
    }

    /// How far the slice at position `place` lies above both of its neighbours, or below both; mean over the cells.
    fn dent(&self, order: &[usize], place: usize) -> f32 {
        let neighbour = |other: Option<usize>| other.and_then(|other| order.get(other));
        let of_cell = |cell: &Vec<f32>| {
            let here = cell[order[place]];
            let away = |other: Option<usize>| neighbour(other).map(|&slice| here - cell[slice]);
            match (away(place.checked_sub(1)), away(Some(place + 1))) {
                (Some(a), Some(b)) if a * b > 0.0 => a.abs().min(b.abs()),
                (Some(only), None) | (None, Some(only)) => only.abs() / 2.0,
                _ => 0.0,
            }
        };
        self.cells.iter().map(of_cell).sum::<f32>() / self.cells.len() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Curves of an object that extends over all slices, which come in the order `order`.
    fn curves(order: &[usize]) -> FocusCurves {
        let slices = order.len();
        let cell = |c: usize| {
            let depth = c as f32 / 40.0 * (slices - 1) as f32;
            let scatter = |n: usize| 0.04 * (((c * 31 + n * 17) % 13) as f32 / 13.0 - 0.5);
            order.iter().map(|&n| (2.0 + 20.0 / (1.0 + ((n as f32 - depth) / 1.5).powi(2))).ln() + scatter(n)).collect()
        };
        FocusCurves { slices, cells: (0..40).map(cell).collect() }
    }

    #[test]
    fn the_right_order_and_its_reverse_are_kept() {
        for count in [4, 9, 30] {
            let order: Vec<usize> = (0..count).collect();
            assert_eq!(curves(&order).other_order(), None);
            assert_eq!(curves(&order.into_iter().rev().collect::<Vec<_>>()).other_order(), None);
        }
    }

    #[test]
    fn two_swapped_slices_are_put_back() {
        assert_eq!(curves(&[0, 1, 2, 4, 3, 5, 6, 7, 8]).other_order().unwrap(), [0, 1, 2, 4, 3, 5, 6, 7, 8]);
        assert_eq!(curves(&[0, 6, 2, 3, 4, 5, 1, 7, 8]).other_order().unwrap(), [0, 6, 2, 3, 4, 5, 1, 7, 8]);
    }

    #[test]
    fn a_random_order_is_recognised_as_wrong() {
        assert!(curves(&[5, 0, 7, 2, 8, 1, 6, 3, 4]).other_order().is_some());
    }

    #[test]
    fn too_few_cells_or_slices_give_no_order() {
        assert_eq!(curves(&[0, 2, 1]).other_order(), None);
        assert_eq!(FocusCurves::default().other_order(), None);
    }
}
