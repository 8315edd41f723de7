//! Pairs of neighbours that too few windows show near their focus, or that are shifted too far for these windows.
//!
//! A knock between two such slices matters, because the slices before and after them do show parts in focus. So all
//! windows are compared at half the resolution, where blur is half as wide. Blur moves such windows a little, and the
//! result is trusted less ([`SIGMA`]).
//!
//! Windows that are shifted by a large part of their side have too little in common. Then one large window at a low
//! resolution tells roughly where the image went, and the windows of the second slice are read from there.

use super::{
    comparison::Comparison,
    phase_correlation::{GUESS, STRICT},
    shift::{LEAST_SHIFTS, LEAST_SIDE, ReadWindow, Shift},
};
use crate::imaging::Rect;

/// Standard deviation that blur adds to the shift of a pair, px. With it an exact profile raises no finding, and a
/// displacement of 0.9 px does; `table_of_displacements` prints both.
pub(super) const SIGMA: f64 = 0.15;

/// Side of the large window after the reduction, px, and the largest reduction.
const LARGE: usize = 64;
const MOST_REDUCTION: usize = 16;

/// Shifts of pairs from all windows of a canvas.
pub(super) struct UnfocusedPairs<'a> {
    windows: &'a [Rect],
    halved: Comparison<'a>,
    large: Option<(Comparison<'a>, Rect)>,
    canvas: (usize, usize),
}

impl<'a> UnfocusedPairs<'a> {
    /// `windows` are those that show texture, all of one size; none if there are too few.
    pub(super) fn new(read: &'a ReadWindow<'a>, windows: &'a [Rect], canvas: (usize, usize)) -> Option<Self> {
        let side = windows.first().filter(|_| windows.len() >= LEAST_SHIFTS)?.width;
        let halved = Comparison::new(read, side, if side >= 2 * LEAST_SIDE { 2 } else { 1 }, STRICT);
        let reduction = (canvas.0.min(canvas.1) / LARGE).min(MOST_REDUCTION);
        let large = (reduction > 1).then(|| {
            let side = LARGE * reduction;
            (Comparison::new(read, side, reduction, GUESS), about_the_middle(windows, side, canvas))
        });
        Some(Self { windows, halved, large, canvas })
    }

    /// The shifts from slice `from` to slice `to`; too few for a statistic if the slices have too little in common.
    pub(super) fn shifts(&self, from: usize, to: usize) -> Vec<Shift> {
        let shifts = self.halved.shifts(from, to, self.windows);
        if shifts.len() >= LEAST_SHIFTS {
            return shifts;
        }
        let Some(rough) = self.large.as_ref().and_then(|(large, window)| large.shift((from, *window), (to, *window)))
        else {
            return shifts;
        };
        let pairs = self.windows.iter().filter_map(|window| Some((*window, moved(*window, &rough, self.canvas)?)));
        pairs.filter_map(|(window, there)| self.halved.shift((from, window), (to, there))).collect()
    }
}

/// The square of `side` px about the middle of `windows`, within the canvas.
fn about_the_middle(windows: &[Rect], side: usize, canvas: (usize, usize)) -> Rect {
    let start = |of: fn(&Rect) -> usize, window: usize, canvas: usize| {
        let (first, last) = windows.iter().map(of).fold((usize::MAX, 0), |(low, high), x| (low.min(x), high.max(x)));
        ((first + last + window) / 2).saturating_sub(side / 2).min(canvas - side)
    };
    let window = windows.first().map_or(0, |window| window.width);
    Rect {
        x: start(|window| window.x, window, canvas.0),
        y: start(|window| window.y, window, canvas.1),
        width: side,
        height: side,
    }
}

/// `window` moved by whole pixels; none if it leaves the canvas.
fn moved(window: Rect, by: &Shift, canvas: (usize, usize)) -> Option<Rect> {
    let along = |start: usize, by: f64, side: usize, canvas: usize| {
        let start = start.checked_add_signed(by.round() as isize)?;
        (start + side <= canvas).then_some(start)
    };
    Some(Rect {
        x: along(window.x, by.dx, window.width, canvas.0)?,
        y: along(window.y, by.dy, window.height, canvas.1)?,
        ..window
    })
}
