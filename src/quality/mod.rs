//! What a fused stack is worth, in numbers: pure functions over planes, no plane kept per slice.
//! Definitions and how to read them: `docs/METRICS.md`.
//!
//! The parts are called where the data passes by: [`slice::Observer`] once per warped slice,
//! [`alignment::measure`] on a few windows of the warped slices, [`score::Scorer`] once per block of the fused
//! picture, and [`finish`] at the end. Where they look, [`sampling`] says: at a part of a large canvas, spread evenly.

pub mod alignment;
mod focus;
mod lanes;
pub mod piella;
pub mod sampling;
pub mod score;
pub mod slice;
mod statistics;
pub mod truth;
pub mod two_source;
pub mod xydeas;

use crate::{
    imaging::Plane,
    model::metrics::{AlignmentMetrics, FocusMetrics, FusionMetrics, SliceMetrics},
};

/// Everything measured about one light of a stack. The names of the slices are empty: whoever knows the
/// files fills them in.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StackQuality {
    /// How well the fused image keeps what the sharpest slice shows.
    pub fusion: FusionMetrics,
    /// Whether the slices cover the object in depth.
    pub focus: FocusMetrics,
    /// Whether the profile fits this stack.
    pub alignment: AlignmentMetrics,
    /// One entry per slice, in order.
    pub slices: Vec<SliceMetrics>,
}

/// Luma from which a pixel is at full scale, and under which it is at zero (0..255).
const FULL: f32 = 254.0;
const ZERO: f32 = 0.5;

/// Puts the parts together.
///
/// `seen` holds one entry per slice, in any order; `index` is the slice that won each pixel (`u16::MAX`:
/// no slice covers it); `object`, 0 or 255, restricts the numbers to the object.
pub fn finish(
    observer: &slice::Observer<'_>,
    seen: Vec<slice::Seen>,
    sums: score::Sums,
    alignment: alignment::Alignment,
    index: &Plane<u16>,
    object: Option<&Plane<u8>>,
) -> StackQuality {
    let mut seen = seen;
    seen.sort_by_key(|seen| seen.index);
    let coverage = focus::coverage(&seen, observer.points(), index, object.is_some());
    let reference = seen.iter().find(|seen| seen.index == seen.reference);
    let slices = seen
        .iter()
        .enumerate()
        .map(|(n, slice)| SliceMetrics {
            index: slice.index as u32,
            name: String::new(),
            contribution: coverage.contribution.get(n).copied().flatten(),
            sharpness: slice.tenengrad,
            exposure_ratio: reference.and_then(|reference| slice.brightness.exposure_ratio(&reference.brightness)),
            balance_ratio: reference.and_then(|reference| slice.brightness.balance_ratio(&reference.brightness)),
            clipped_fraction: slice.clipped,
            valid_fraction: slice.covered,
            residual_px: alignment.per_slice.get(slice.index).copied().flatten(),
        })
        .collect();
    StackQuality { fusion: sums.metrics(), focus: coverage.metrics, alignment: alignment.metrics, slices }
}
