//! Whether the slices stand in the order of focus.
//!
//! In the right order every part of the object becomes sharp once and unsharp again: its saliency climbs to one peak.
//! A slice out of its place makes a dent or a spike in most parts at once. The measure is how much more the curves go up
//! and down than to one peak and back; a slice is misplaced when moving it alone takes a good part of that away.

/// Cells in each direction over the canvas: coarse, because slices out of order are also warped by another's homography.
const GRID: usize = 20;
/// A cell needs so many points.
const LEAST_POINTS: usize = 6;
/// Fewer cells say nothing of order, nor do fewer slices.
const LEAST_CELLS: usize = 12;
const LEAST_SLICES: usize = 4;
/// A cell whose sharpest slice is not this much over its least sharp one has no focus.
const LEAST_RISE: f32 = 1.3;
/// Moving a slice must take away this much, in the natural logarithm of saliency, mean over the cells ...
const WORTH: f32 = 0.08;
/// ... and this part of all that goes up and down too much.
const WORTH_OF_ALL: f32 = 0.25;
/// So many slices that look misplaced are tried per round.
const SUSPECTS: usize = 6;

/// Logarithms of the saliency, cell by cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct FocusCurves {
    slices: usize,
    cells: Vec<Vec<f32>>,
}

impl FocusCurves {
    /// From textured pixels: where each lies, and its saliency in every slice (0: not known).
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

    /// The slices in the order of focus, when that is not the order in which they came.
    pub(super) fn other_order(&self) -> Option<Vec<u32>> {
        if self.slices < LEAST_SLICES || self.cells.len() < LEAST_CELLS {
            return None;
        }
        let mut order: Vec<usize> = (0..self.slices).collect();
        let mut excess = self.excess(&order);
        for _ in 0..self.slices {
            let Some((moved, less)) = self.best_move(&order, excess) else { break };
            if excess - less < WORTH.max(WORTH_OF_ALL * excess) {
                break;
            }
            (order, excess) = (moved, less);
        }
        let in_order = order.iter().enumerate().all(|(place, &slice)| place == slice);
        (!in_order).then(|| order.into_iter().map(|slice| slice as u32).collect())
    }

    /// The order with one slice moved that goes up and down least.
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

    /// How much the curves go up and down beyond one climb and one fall, mean over the cells.
    fn excess(&self, order: &[usize]) -> f32 {
        let of_cell = |cell: &Vec<f32>| {
            let value = |place: usize| cell[order[place]];
            let (mut highest, mut ways) = (value(0), 0.0);
            for place in 1..order.len() {
                ways += (value(place) - value(place - 1)).abs();
                highest = highest.max(value(place));
            }
            ways - (2.0 * highest - value(0) - value(order.len() - 1))
        };
        self.cells.iter().map(of_cell).sum::<f32>() / self.cells.len() as f32
    }

    /// How far the slice at `place` stands out between its neighbours, mean over the cells.
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

    /// FocusCurves of an object whose depth runs over the slices, seen in the order `order`.
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
    fn the_right_order_and_its_reverse_are_left_alone() {
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
    fn a_wild_order_is_not_taken_for_the_right_one() {
        assert!(curves(&[5, 0, 7, 2, 8, 1, 6, 3, 4]).other_order().is_some());
    }

    #[test]
    fn too_few_cells_or_slices_say_nothing() {
        assert_eq!(curves(&[0, 2, 1]).other_order(), None);
        assert_eq!(FocusCurves::default().other_order(), None);
    }
}
