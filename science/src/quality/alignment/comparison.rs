//! One window of a slice compared with a slice after it.

use super::{
    phase_correlation::{Correlator, Strictness},
    shift::{ReadWindow, Shift},
};
use crate::imaging::{Plane, Rect};

/// Least share of pixels in a window that both slices cover.
const LEAST_VALID: f64 = 0.9;

/// Compares windows of one size, at full or reduced resolution.
pub(super) struct Comparison<'a> {
    read: &'a ReadWindow<'a>,
    correlator: Correlator,
    /// Side of a window, px.
    side: usize,
    /// Side of the squares of pixels that become one, px.
    reduction: usize,
}

impl<'a> Comparison<'a> {
    /// Of windows of `side` px, each square of `reduction` x `reduction` px averaged. `side` is a multiple of it.
    pub(super) fn new(read: &'a ReadWindow<'a>, side: usize, reduction: usize, strictness: Strictness) -> Self {
        Self { read, correlator: Correlator::new(side / reduction, strictness), side, reduction }
    }

    /// The shifts from slice `from` to slice `to`, of the windows that have one.
    pub(super) fn shifts(&self, from: usize, to: usize, windows: &[Rect]) -> Vec<Shift> {
        windows.iter().filter_map(|window| self.shift((from, *window), (to, *window))).collect()
    }

    /// The shift from a window of a slice to a window of the same size of another slice; none if they have no common
    /// texture, or if the slices do not cover them.
    pub(super) fn shift(&self, (from, window): (usize, Rect), (to, there): (usize, Rect)) -> Option<Shift> {
        let ((a, valid_a), (b, valid_b)) = (self.reduced(from, window)?, self.reduced(to, there)?);
        let common: Vec<bool> = valid_a.iter().zip(&valid_b).map(|(a, b)| *a && *b).collect();
        let share = common.iter().filter(|&&both| both).count() as f64 / common.len() as f64;
        if share < LEAST_VALID {
            return None;
        }
        let (dx, dy) = self.correlator.shift(&a, &b, &common)?;
        let middle = |start: usize| start as f64 + (self.side as f64 - 1.0) / 2.0;
        let moved = |here: usize, there: usize, by: f64| there as f64 - here as f64 + self.reduction as f64 * by;
        Some(Shift {
            x: middle(window.x),
            y: middle(window.y),
            dx: moved(window.x, there.x, dx),
            dy: moved(window.y, there.y, dy),
        })
    }

    /// Luma and validity of a window of slice `n`, at the resolution of the comparison; none if it cannot be read.
    fn reduced(&self, n: usize, window: Rect) -> Option<(Vec<f32>, Vec<bool>)> {
        let (luma, valid) = (self.read)(n, window)?;
        let square = |plane: (usize, usize)| plane == (self.side, self.side);
        if !square((luma.width, luma.height)) || [luma.data.len(), valid.data.len()] != [self.side * self.side; 2] {
            return None;
        }
        let valid: Vec<bool> = valid.data.iter().map(|&valid| valid != 0).collect();
        if self.reduction == 1 {
            return Some((luma.data, valid));
        }
        Some(self.averaged(&luma, &valid))
    }

    /// The means of squares of pixels; a square is valid if all its pixels are.
    fn averaged(&self, luma: &Plane<f32>, valid: &[bool]) -> (Vec<f32>, Vec<bool>) {
        let (by, side) = (self.reduction, self.side / self.reduction);
        let (mut means, mut all_valid) = (vec![0.0; side * side], vec![true; side * side]);
        for y in 0..side * by {
            for x in 0..side * by {
                let (at, reduced) = (y * self.side + x, y / by * side + x / by);
                means[reduced] += luma.data[at] / (by * by) as f32;
                all_valid[reduced] &= valid[at];
            }
        }
        (means, all_valid)
    }
}
