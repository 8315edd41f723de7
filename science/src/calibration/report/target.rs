//! The target in the report.

use crate::calibration::findings::{Facts, coverage};
use crate::calibration::{detection::grid_steps, flat_field::Polarity, lattice::label_range, tracked::Tracked};
use crate::target::{CODE_PERIOD, CODE_VERSION};
use crate::types::report::{CodeReport, TargetReport};

/// The target as the slices show it. `pitch_mm`: as specified.
pub(super) fn report(facts: &Facts, pitch_mm: Option<f64>, magnification: Option<f64>) -> TargetReport {
    let (tracked, reference) = (facts.tracked, facts.solution.reference);
    let base = tracked.detections[reference].as_ref();
    TargetReport {
        pitch_px: base.map_or(0.0, |s| s.pitch),
        pitch_mm,
        fill: tracked.fill(),
        bright_dots: tracked.target.polarity == Polarity::LightOnDark,
        asymmetric: base.is_some_and(|s| is_asymmetric(s.places.keys().copied())),
        dots: facts.profile.get(reference).and_then(|s| s.dots_found).unwrap_or(0),
        coverage: coverage(tracked, reference),
        magnification,
        coded: tracked.target.code.is_some(),
        code: code_part(tracked, reference),
    }
}

/// The part of the code that slice `reference` shows; `None` for a target without a code.
fn code_part(tracked: &Tracked, reference: usize) -> Option<CodeReport> {
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

/// True when the grid is the asymmetric one that some tools print: in diagonal coordinates it fills its bounding box
/// better.
fn is_asymmetric(labels: impl Iterator<Item = [i32; 2]> + Clone) -> bool {
    let area = |of: &dyn Fn([i32; 2]) -> [i32; 2]| {
        let span = |axis: usize| {
            let (low, high) = label_range(labels.clone().map(of), axis);
            f64::from(high - low + 1)
        };
        span(0) * span(1)
    };
    let upright = area(&|l| l);
    // in coordinates rotated by 45 degrees every other position is empty
    let turned = area(&|[i, j]| [i + j, i - j]) / 2.0;
    turned < 0.75 * upright
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_asymmetric_grid_is_recognised() {
        let upright = (0..8_i32).flat_map(|j| (0..11_i32).map(move |i| [i, j]));
        assert!(!is_asymmetric(upright));
        let asymmetric = (0..11_i32).flat_map(|r| {
            (0..5_i32).map(move |c| 2 * c + r % 2).map(move |x| [(x + r).div_euclid(2), (x - r).div_euclid(2)])
        });
        assert!(is_asymmetric(asymmetric));
    }
}
