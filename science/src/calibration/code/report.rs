//! The part of the code that the reference slice shows, for the report.

use crate::calibration::detection::grid_steps;
use crate::calibration::tracked::Tracked;
use crate::target::{CODE_PERIOD, CODE_VERSION};
use crate::types::report::CodeReport;

/// The part of the code that slice `reference` shows; `None` for a target without a code.
pub(in crate::calibration) fn report(tracked: &Tracked, reference: usize) -> Option<CodeReport> {
    let code = tracked.target.code?;
    let detection = tracked.detections.get(reference)?.as_ref()?;
    let range = |axis: usize| {
        let positions = || detection.dots.keys().map(|label| code.place.position(*label)[axis]);
        let (first, last) = (positions().min()?, positions().max()?);
        let from = first.rem_euclid(CODE_PERIOD as i32);
        Some([from, from + last - first].map(i32::unsigned_abs))
    };
    Some(CodeReport {
        version: CODE_VERSION,
        columns: range(0)?,
        rows: range(1)?,
        mirrored: code.place.is_mirrored(grid_steps(&detection.places)),
        certainty: code.certainty,
    })
}
