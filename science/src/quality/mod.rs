//! Quality metrics of a fused stack. Definitions and how to read them: `docs/METRICS.md`.
//!
//! The metrics are pure functions over planes and keep no plane per slice. Fusion calls each part where its data
//! passes:
//!
//! | part | called | input | output |
//! |---|---|---|---|
//! | [`slice::SliceMeter`] | once per slice | a warped slice, its focus measure | [`slice::SliceMeasurements`] |
//! | [`alignment::measure`] | once | windows of the warped slices | residual shifts |
//! | [`score::Scorer`] | once per block | the fused image and the slices in a block | [`score::ScoreSums`] |
//! | [`finish`] | once, at the end | all of these and the [`DecisionMap`] | [`StackQuality`] |
//!
//! [`sampling`] defines which pixels of a large canvas are measured. It depends on the canvas and the mask alone, so
//! that the numbers do not depend on the number of threads.
//!
//! [`full_reference`] is not part of a stack's metrics: it compares with a known truth, in tests and in the demo
//! command.

pub mod alignment;
mod clipping;
mod deterministic_sum;
mod diagnosis;
pub mod flicker;
mod focus;
mod focus_order;
pub mod full_reference;
mod piella;
pub mod sampling;
pub mod score;
pub mod slice;
mod stack_quality;
#[cfg(test)]
pub(crate) mod two_source;
mod xydeas;

use crate::types::metrics::SliceMetrics;
pub use diagnosis::is_misfit;
pub use focus::DecisionMap;
pub use focus_order::focus_prefers;
pub use stack_quality::StackQuality;

/// Version of each group of metrics. A change that alters values must change the version of its group.
pub const VERSIONS: [&str; 6] = [
    "q_g:yl2019-top1",
    "q_w:piella2003-8x8-top1",
    "sampling:blocks-2",
    "focus:5",
    "alignment:similarity-2",
    "exposure:cells-3",
];

/// Combines all measurements of a stack and derives the findings.
///
/// `measurements` holds one entry per slice, in any order. `names` are the file names, by slice; missing ones are left
/// empty.
pub fn finish(
    meter: &slice::SliceMeter<'_>,
    mut measurements: Vec<slice::SliceMeasurements>,
    sums: &score::ScoreSums,
    alignment: alignment::Alignment,
    decision_map: &DecisionMap<'_>,
    names: Vec<String>,
) -> StackQuality {
    measurements.sort_by_key(|slice| slice.index);
    let coverage = focus::measure(&measurements, meter.points(), decision_map, meter.is_masked());
    let reference = measurements.iter().find(|slice| slice.index == slice.reference);
    let exposures: Vec<Option<f64>> = measurements
        .iter()
        .map(|slice| reference.and_then(|reference| slice.brightness.exposure_ratio(&reference.brightness)))
        .collect();
    // brightness after the gains, as fusion uses it: what the gains correct is not flicker
    let equalised = measurements.iter().zip(&exposures).map(|(slice, ratio)| {
        let of_reference = reference.map_or(1.0, |reference| reference.gain);
        ratio.map(|ratio| ratio * slice.gain / of_reference)
    });
    let equalised: Vec<Option<f64>> = equalised.collect();
    let flicker = flicker::ratios(&equalised);
    let mut names = names;
    names.resize(measurements.len(), String::new());
    let slices: Vec<SliceMetrics> = measurements
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
            duplicate_of: measurements[..n]
                .iter()
                .position(|other| other.fingerprint.is_same_image(&slice.fingerprint))
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
            foreign: &alignment.foreign,
            steps: &coverage.steps,
            equalised: &equalised,
            reference: reference.map_or(0, |reference| reference.index),
            has_gains: measurements.iter().any(|slice| slice.gain != 1.0),
            masked: meter.is_masked(),
            reversed: alignment.reversed,
            canvas: meter.canvas(),
        },
    );
    quality
}
