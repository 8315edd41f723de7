//! Alignment: residual shifts between neighbouring warped slices, which show whether the calibration profile fits the
//! stack.
//!
//! 1. Up to 5 x 5 windows are spread over the canvas, or over the object.
//! 2. Each window is compared in the pairs of slices nearest to its focus ([`in_focus_pairs`]), by phase correlation
//!    ([`phase_correlation`]).
//! 3. One similarity per step is fitted to all shifts ([`similarity`]). A single window may move through defocus; a
//!    common similarity is the fault of the profile.
//! 4. Pairs that too few windows show near focus are compared at half the resolution ([`unfocused_pairs`]), only to
//!    tell whether one slice is displaced against the other.
//! 5. [`foreign`] finds slices that have too little in common with both neighbours, which have much in common.
//! 6. [`reversal`] compares the common similarities with those that the profile leaves in a stack of the opposite
//!    order.

mod comparison;
mod foreign;
mod in_focus_pairs;
mod phase_correlation;
mod reversal;
mod shift;
mod similarity;
mod unfocused_pairs;

use rayon::prelude::*;

use super::{
    sampling::{self, Extent},
    slice::SliceMeasurements,
};
use crate::{
    imaging::{Plane, Rect, statistics},
    types::{
        Homography,
        metrics::{AlignmentMetrics, ResidualSimilarity},
    },
};
use comparison::Comparison;
use phase_correlation::STRICT;
pub use shift::ReadWindow;
use shift::{LEAST_SHIFTS, LEAST_SIDE, Shift};
use similarity::Similarity;
use unfocused_pairs::UnfocusedPairs;

/// Windows in each direction.
const GRID: usize = 5;
/// Side of a window by the shorter side of the canvas, px: residual shifts are larger on a large canvas.
const SIDES: [(usize, usize); 2] = [(2000, 256), (0, 128)];
/// Least share of object pixels in a window, with a mask.
const LEAST_OBJECT: f64 = 0.1;
/// Result of [`measure`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Alignment {
    /// Statistics over all pairs of neighbours.
    pub metrics: AlignmentMetrics,
    /// Per slice: median length of the residual shifts relative to the previous slice, px; none for the first.
    pub per_slice: Vec<Option<f64>>,
    /// Whether the residual is that of a stack in the opposite order; see [`Alignment::detect_reversal`].
    pub reversed: bool,
    /// Per pair of neighbours: the shift that the common similarity does not explain.
    pub(super) own: Vec<Option<OwnShift>>,
    /// Slices of another view or object; see [`Alignment::detect_foreign`].
    pub(super) foreign: Vec<u32>,
}

impl Alignment {
    /// Finds slices that show another view or another object than the others. `measurements` has one entry per slice,
    /// in order; the rest is as for [`measure`].
    pub fn detect_foreign(
        &mut self,
        measurements: &[SliceMeasurements],
        read: &ReadWindow<'_>,
        size: (usize, usize),
        object: Option<&Plane<u8>>,
    ) {
        self.foreign = foreign::slices(measurements, read, &windows(size.0, size.1, object), size);
    }

    /// Sets [`Alignment::reversed`]: compares the residual similarity with that which the profile (`homographies`, for
    /// a canvas of `size` (width, height)) leaves in a stack whose slices come in the opposite order.
    pub fn detect_reversal(&mut self, homographies: &[Homography], size: (usize, usize)) {
        let residual = self.metrics.similarity.as_ref();
        self.reversed = residual.is_some_and(|residual| reversal::fits_reversed_stack(residual, homographies, size));
    }
}

/// The shift of one slice relative to the previous one beyond the common similarity, and its standard deviation, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OwnShift {
    pub(super) shift: (f64, f64),
    pub(super) sigma: f64,
}

impl OwnShift {
    /// Length of the shift, px.
    pub(super) fn length(&self) -> f64 {
        self.shift.0.hypot(self.shift.1)
    }
}

/// Measures the residual shifts between each of `slices` warped slices and the previous one, in windows spread over the
/// `width` x `height` canvas, or over the bounding box of `object` (255 inside, 0 outside).
///
/// A window counts in the pairs of slices that are both near its focus. A window without common texture gives no shift.
/// Numbers that need shifts are `None` with fewer than three. `read` is called from several threads; the result does
/// not depend on their number.
pub fn measure(
    slices: usize,
    read: &ReadWindow<'_>,
    width: usize,
    height: usize,
    object: Option<&Plane<u8>>,
) -> Alignment {
    let windows = windows(width, height, object);
    let mut of_pair = vec![Vec::new(); slices.saturating_sub(1)];
    let focus = in_focus_pairs::WindowTexture::of(slices, read, &windows);
    for (index, window) in windows.iter().enumerate() {
        focus.pairs(index).into_iter().for_each(|pair| of_pair[pair].push(*window));
    }
    let comparison = windows.first().map(|window| Comparison::new(read, window.width, 1, STRICT));
    let pair = |(first, windows): (usize, &Vec<Rect>)| match &comparison {
        Some(comparison) => comparison.shifts(first, first + 1, windows),
        None => Vec::new(),
    };
    let pairs: Vec<Vec<Shift>> = of_pair.par_iter().enumerate().map(pair).collect();
    let mut per_slice = vec![None; slices.min(1)];
    per_slice.extend(pairs.iter().map(|shifts| length_quantile(shifts.iter(), 0.5)));
    let all: Vec<Shift> = pairs.iter().flatten().copied().collect();
    let rough = roughly(&pairs, read, &focus, &windows, (width, height));
    let common = Similarity::robust(&pairs, &rough);
    let steps = slices.saturating_sub(1) as f64;
    let metrics = AlignmentMetrics {
        residual_p50_px: length_quantile(all.iter(), 0.5),
        residual_p95_px: length_quantile(all.iter(), 0.95),
        residual_scale: common.map(|common| common.scale()),
        similarity: common.map(|common| residual(&common, (width, height), steps, all.len())),
        common_fraction: None,
    };
    let own = pairs.iter().zip(&rough).map(|(shifts, rough)| {
        let (shift, sigma) = similarity::own_shift(rough, common.as_ref(), LEAST_SHIFTS)?;
        let blur = if shifts.len() < LEAST_SHIFTS { unfocused_pairs::SIGMA } else { 0.0 };
        Some(OwnShift { shift, sigma: sigma.hypot(blur) })
    });
    Alignment { metrics, per_slice, reversed: false, own: own.collect(), foreign: Vec::new() }
}

/// The shifts of all pairs: those of the windows in focus, or of all windows where they are too few.
fn roughly(
    pairs: &[Vec<Shift>],
    read: &ReadWindow<'_>,
    focus: &in_focus_pairs::WindowTexture,
    windows: &[Rect],
    canvas: (usize, usize),
) -> Vec<Vec<Shift>> {
    let textured: Vec<Rect> =
        windows.iter().enumerate().filter(|(index, _)| focus.shows_focus(*index)).map(|(_, window)| *window).collect();
    let unfocused = UnfocusedPairs::new(read, &textured, canvas);
    let of_pair = |(first, shifts): (usize, &Vec<Shift>)| match &unfocused {
        Some(unfocused) if shifts.len() < LEAST_SHIFTS => unfocused.shifts(first, first + 1),
        _ => shifts.clone(),
    };
    pairs.par_iter().enumerate().map(of_pair).collect()
}

/// The similarity per step as the contract shows it, with the drift of the corner that moves most over `steps` steps.
fn residual(common: &Similarity, (width, height): (usize, usize), steps: f64, windows: usize) -> ResidualSimilarity {
    let (right, bottom) = (width as f64 - 1.0, height as f64 - 1.0);
    let length = |corner: &(f64, f64)| common.at(*corner).0.hypot(common.at(*corner).1);
    let corners = [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)];
    let worst = corners.into_iter().max_by(|a, b| length(a).total_cmp(&length(b))).unwrap_or_default();
    let (x, y) = common.at((right / 2.0, bottom / 2.0));
    ResidualSimilarity {
        scale: common.scale(),
        rotation_deg: common.rotation_deg(),
        shift_px: [x, y],
        corner_drift_px: steps * length(&worst),
        corner_drift_sigma_px: steps * common.sigma_at(worst),
        shifts: u32::try_from(windows).unwrap_or(u32::MAX),
    }
}

fn length_quantile<'a>(shifts: impl Iterator<Item = &'a Shift>, q: f64) -> Option<f64> {
    let mut lengths: Vec<f32> = shifts.map(|shift| shift.length() as f32).collect();
    if lengths.len() < LEAST_SHIFTS {
        return None;
    }
    statistics::quantile_interpolated(&mut lengths, q).map(f64::from)
}

/// Up to `GRID` x `GRID` windows of one size, over the canvas or over the object.
fn windows(width: usize, height: usize, object: Option<&Plane<u8>>) -> Vec<Rect> {
    let object = object.filter(|object| object.width == width && object.height == height);
    let area = match object.map(Extent::of) {
        None => Rect::whole(width, height),
        Some(Some(extent)) => extent.bounds,
        Some(None) => return Vec::new(),
    };
    let shorter = width.min(height);
    let mut side = SIDES.iter().find(|(least, _)| shorter >= *least).map_or(LEAST_SIDE, |&(_, side)| side);
    // at least two windows side by side, so that a scale can be measured
    while side > LEAST_SIDE && side * 2 > shorter {
        side /= 2;
    }
    if side > shorter {
        return Vec::new();
    }
    let [columns, rows] = [(area.x, area.width, width), (area.y, area.height, height)]
        .map(|(start, length, canvas)| starts(start, length, canvas, side));
    let all = rows.iter().flat_map(|&y| columns.iter().map(move |&x| Rect { x, y, width: side, height: side }));
    all.filter(|window| object.is_none_or(|object| share_of(object, *window) >= LEAST_OBJECT)).collect()
}

/// Start positions of windows along one axis, spread over `start..start + length`.
fn starts(start: usize, length: usize, canvas: usize, side: usize) -> Vec<usize> {
    let slack = length.saturating_sub(side);
    let count = (slack / (side / 2).max(1) + 1).min(GRID);
    let first = start.min(canvas - side);
    if count == 1 {
        return vec![(start + length / 2).saturating_sub(side / 2).min(canvas - side)];
    }
    (0..count).map(|i| (first + slack * i / (count - 1)).min(canvas - side)).collect()
}

/// Share of object pixels in `window`.
fn share_of(object: &Plane<u8>, window: Rect) -> f64 {
    sampling::object_pixels(object, window) as f64 / (window.width * window.height) as f64
}

#[cfg(test)]
mod tests;
