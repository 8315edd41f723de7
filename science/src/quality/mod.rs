//! What a fused stack is worth, in numbers: pure functions over planes, no plane kept per slice.
//! Definitions and how to read them: `docs/METRICS.md`.
//!
//! The parts are called where the data passes by: [`slice::SliceMeter`] once per warped slice,
//! [`alignment::measure`] on a few windows of the warped slices, [`score::Scorer`] once per block of the fused
//! picture, and [`finish`] at the end. Where they look, [`sampling`] says: at a part of a large canvas, spread evenly.

pub mod alignment;
mod deterministic_sum;
mod diagnosis;
mod flicker;
mod focus;
mod focus_order;
pub mod full_reference;
pub mod piella;
pub mod sampling;
pub mod score;
pub mod slice;
mod statistics;
pub mod two_source;
pub mod xydeas;

use crate::{
    imaging::Plane,
    types::metrics::{AlignmentMetrics, Finding, FocusMetrics, FusionMetrics, SliceMetrics},
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
    /// What a technician should know, the worst first.
    pub findings: Vec<Finding>,
}

/// How the numbers are computed. Whoever changes one so that its value changes gives it another version.
pub const VERSIONS: [&str; 6] = [
    "q_g:yl2019-top1",
    "q_w:piella2003-8x8-top1",
    "sampling:blocks-1",
    "focus:3",
    "alignment:similarity-1",
    "exposure:cells-2",
];

/// Luma from which a pixel is at full scale, and under which it is at zero (0..255).
const FULL: f32 = 254.0;
const ZERO: f32 = 0.5;

/// Which slice each pixel comes from.
#[derive(Debug, Clone, Copy)]
pub struct DecisionMap<'a> {
    /// Index of the slice; `u16::MAX` where no slice covers the pixel.
    pub index: &'a Plane<u16>,
    /// Whether doubtful choices were settled from their surroundings; else each is the slice of the highest saliency.
    pub settled: bool,
}

/// Puts the parts together.
///
/// `seen` holds one entry per slice, in any order; `choice` is the slice that won each pixel; `names` are what the user calls the slices.
pub fn finish(
    observer: &slice::SliceMeter<'_>,
    seen: Vec<slice::SliceMeasurements>,
    sums: &score::ScoreSums,
    alignment: alignment::Alignment,
    decision_map: &DecisionMap<'_>,
    names: Vec<String>,
) -> StackQuality {
    let mut seen = seen;
    seen.sort_by_key(|seen| seen.index);
    let coverage = focus::coverage(&seen, observer.points(), decision_map, observer.masked());
    let reference = seen.iter().find(|seen| seen.index == seen.reference);
    let exposures: Vec<Option<f64>> = seen
        .iter()
        .map(|slice| reference.and_then(|reference| slice.brightness.exposure_ratio(&reference.brightness)))
        .collect();
    // as bright as fusion sees them: what the gains even out is no flicker
    let evened = seen.iter().zip(&exposures).map(|(slice, ratio)| {
        let of_reference = reference.map_or(1.0, |reference| reference.gain);
        ratio.map(|ratio| ratio * slice.gain / of_reference)
    });
    let evened: Vec<Option<f64>> = evened.collect();
    let flicker = flicker::ratios(&evened);
    let mut names = names;
    names.resize(seen.len(), String::new());
    let slices: Vec<SliceMetrics> = seen
        .iter()
        .zip(names)
        .enumerate()
        .map(|(n, (slice, name))| SliceMetrics {
            index: slice.index as u32,
            name,
            contribution: coverage.contribution.get(n).copied().flatten(),
            sharpness: slice.tenengrad,
            exposure_ratio: exposures[n],
            balance_ratio: reference.and_then(|reference| slice.brightness.balance_ratio(&reference.brightness)),
            flicker_ratio: flicker[n],
            duplicate_of: seen[..n]
                .iter()
                .position(|other| other.fingerprint.same(&slice.fingerprint))
                .map(|n| n as u32),
            clipped_fraction: slice.clipped,
            valid_fraction: slice.covered,
            residual_px: alignment.per_slice.get(slice.index).copied().flatten(),
        })
        .collect();
    let mut quality = StackQuality {
        fusion: sums.metrics(),
        focus: coverage.metrics,
        alignment: alignment.metrics,
        slices,
        findings: Vec::new(),
    };
    quality.findings = diagnosis::diagnose(
        &quality,
        &diagnosis::Evidence {
            own: &alignment.own,
            steps: &coverage.steps,
            evened: &evened,
            reversed: alignment.reversed,
        },
    );
    quality
}
