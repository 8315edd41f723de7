//! Windows of the slices, and their shifts.

use crate::imaging::{Plane, Rect};

/// Reads a rectangle of warped slice `n`: its luma (0..255) and validity (255 valid, 0 not); none if it cannot be read.
pub type ReadWindow<'a> = dyn Fn(usize, Rect) -> Option<(Plane<f32>, Plane<u8>)> + Sync + 'a;

/// Least side of a window, px.
pub(super) const LEAST_SIDE: usize = 32;
/// Least number of shifts for a statistic.
pub(super) const LEAST_SHIFTS: usize = 3;

/// The shift of the content of one window from a slice to the next, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shift {
    /// Centre of the window on the canvas.
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) dx: f64,
    pub(super) dy: f64,
}

impl Shift {
    pub(super) fn length(&self) -> f64 {
        self.dx.hypot(self.dy)
    }
}
