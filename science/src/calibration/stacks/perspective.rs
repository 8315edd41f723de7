//! Whether near and far parts of the object grow alike from slice to slice.
//!
//! With a fixed lens the sensor moves, and the image of every point grows about the same centre by the same factor.
//! With a camera on a rail the entrance pupil moves towards the object, and what is near grows more than what is far. A
//! window in focus `d` slices beyond the middle of a pair grows from slice to slice by `g - p g^2 d`, with the growth
//! `g` of what is in focus: `p` is 0 with a fixed lens, 1 with a moving lens, and between them with a lens that moves
//! alone.

use super::matched::{Pair, WindowMatch};
use super::picture::Cells;
use crate::types::profile::CaptureMode;

/// Expected bend of the growth along the rail, and its standard deviation, in squares of the growth.
///
/// A sensor on a rail sees the image grow in proportion to its distance from the exit pupil: there is no bend. A camera
/// on a rail sees what is in focus at the same size in each slice, so from slice to slice the transform has the same
/// factor, `exp(g z)`: the bend is `g^2 / 2`. A lens that moves alone is between them. Positions on a rail are not
/// exactly even, so all of these have a standard deviation.
pub(super) fn bend(mode: Option<CaptureMode>) -> [f64; 2] {
    match mode {
        Some(CaptureMode::FixedLens) => [0.0, 0.25],
        Some(CaptureMode::MovingLens) => [0.5, 0.25],
        Some(CaptureMode::LensAlone) | None => [0.25, 0.5],
    }
}

/// What is expected of a change of transforms that have the bend already.
pub(super) const NO_BEND: [f64; 2] = [0.0, 0.25];

/// Times the least detail of a cell that its largest must be for the cell to tell where it is in focus.
const SHOWS_FOCUS: f32 = 3.0;

/// Per cell the slice in which it is in focus, with a fraction; `None` where the detail of the slices does not show it.
pub(super) fn focus(cells: &[Cells]) -> Vec<Option<f64>> {
    let count = cells.first().map_or(0, |cells| cells.detail.len());
    let of_cell = |cell: usize| {
        let detail: Vec<f32> = cells.iter().map(|slice| slice.detail[cell]).collect();
        let best = (0..detail.len()).max_by(|a, b| detail[*a].total_cmp(&detail[*b]))?;
        let least = detail.iter().copied().fold(f32::INFINITY, f32::min);
        if detail[best] < SHOWS_FOCUS * least || best == 0 || best + 1 == detail.len() {
            return None;
        }
        // the vertex of a parabola through the logarithms
        let [a, b, c] = [best - 1, best, best + 1].map(|k| f64::from(detail[k].max(1e-12)).ln());
        let by = (0.5 * (a - c) / (a - 2.0 * b + c).min(-1e-9)).clamp(-0.5, 0.5);
        Some(best as f64 + by)
    };
    (0..count).map(of_cell).collect()
}

/// Beyond the two slices of a pair, slices from their focus at which a window has half its weight: where it is far out
/// of focus, the blur of nearer and farther parts spreads over it differently in both slices.
const NEAR: f64 = 2.0;
/// The same for a window of which the focus is not known.
const UNKNOWN: f64 = 4.0;

/// Weighs the windows by how near to focus the two slices of their pair show them, and returns per pair and window how
/// far on the rail its focus is beyond the middle of the two slices, or beyond the reference slice if `is_fixed`: if
/// the transforms are those of the plane that is in focus there. 0 where it is unknown. `focus`: per view and cell, in
/// slices. `offsets`: rail position per slice relative to the reference slice.
pub(super) fn weigh(pairs: &mut [Pair], focus: &[Vec<Option<f64>>], offsets: &[f64], is_fixed: bool) -> Vec<Vec<f64>> {
    let on_rail = |z: f64| {
        let slice = (z.max(0.0) as usize).min(offsets.len().saturating_sub(2));
        offsets[slice] + (z - slice as f64) * (offsets[slice + 1] - offsets[slice])
    };
    let of_pair = |pair: &mut Pair| {
        let middle = pair.slices.iter().sum::<usize>() as f64 / 2.0;
        let base = if is_fixed { 0.0 } else { pair.slices.map(|slice| offsets[slice]).iter().sum::<f64>() / 2.0 };
        let reach = (pair.slices[1] - pair.slices[0]) as f64 / 2.0;
        let of_window = |window: &mut WindowMatch| {
            let known = focus[pair.view].get(window.cell as usize).copied().flatten();
            let excess = known.map_or(UNKNOWN, |z| ((z - middle).abs() - reach).max(0.0));
            window.information *= (1.0 + (excess / NEAR).powi(2)).powi(-4);
            known.map_or(0.0, |z| on_rail(z) - base)
        };
        pair.windows.iter_mut().map(of_window).collect()
    };
    pairs.iter_mut().map(of_pair).collect()
}
