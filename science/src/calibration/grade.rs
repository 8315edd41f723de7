//! The grade of a calibration: the corner uncertainty, limited by the findings.
//!
//! The corner uncertainty follows from the scatter of the dots. Some errors leave no scatter: dots that were counted
//! from the wrong one, a jump of the rig, slices in the wrong order. Therefore each finding states the best grade that
//! it allows, and the grade is the worst of all.

use crate::types::{Warning, WarningCode, report::Grade};

/// Largest standard deviation of the worst corner of a good calibration, px: at three of them, 0.3 px, an error is a
/// defect.
pub(super) const GOOD: f64 = 0.1;
/// The same of a usable one.
const USABLE: f64 = 0.6;

/// A finding with its effect on the grade.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Finding {
    /// Code and sentence.
    pub warning: Warning,
    /// The best grade of a calibration with this finding.
    pub allows: Grade,
}

impl Finding {
    /// A finding that does not affect the grade: what it describes is corrected, or included in the corner uncertainty.
    pub(super) fn remark(code: WarningCode, detail: impl Into<String>) -> Self {
        Self { warning: Warning::new(code, detail), allows: Grade::Good }
    }

    /// A finding that allows at best `allows`.
    pub(super) fn limiting(allows: Grade, code: WarningCode, detail: impl Into<String>) -> Self {
        Self { warning: Warning::new(code, detail), allows }
    }
}

/// The grade by the worst corner uncertainty alone, px.
fn by_corners(worst: f64) -> Grade {
    match worst {
        w if w <= GOOD => Grade::Good,
        w if w <= USABLE => Grade::Usable,
        _ => Grade::Poor,
    }
}

/// The grade of a calibration whose worst corner has the standard deviation `worst` px, and the finding that limits it;
/// `None` when the corner uncertainty decides.
pub(super) fn grade(worst: f64, findings: &[Finding]) -> (Grade, Option<&Finding>) {
    let by_corners = by_corners(worst);
    // the first of the worst: findings are in order of importance
    let limit = findings.iter().rev().max_by_key(|finding| finding.allows).filter(|f| f.allows > by_corners);
    (limit.map_or(by_corners, |finding| finding.allows), limit)
}

/// The word for a grade at the beginning of a verdict.
pub(super) fn word(grade: Grade) -> &'static str {
    match grade {
        Grade::Good => "Good",
        Grade::Usable => "Usable",
        Grade::Poor => "Poor",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grade_is_the_worst_of_the_corner_uncertainty_and_the_findings() {
        let remark = Finding::remark(WarningCode::SliceMissing, "a");
        let first = Finding::limiting(Grade::Usable, WarningCode::RigBumped, "b");
        let second = Finding::limiting(Grade::Usable, WarningCode::ManyOutliers, "c");
        let poor = Finding::limiting(Grade::Poor, WarningCode::SliceInterpolated, "d");
        assert_eq!(grade(0.05, std::slice::from_ref(&remark)), (Grade::Good, None));
        assert_eq!(grade(0.1, &[]).0, Grade::Good);
        assert_eq!(grade(0.11, &[]).0, Grade::Usable);
        assert_eq!(grade(0.61, &[]).0, Grade::Poor);
        assert_eq!(grade(f64::NAN, &[]).0, Grade::Poor, "an unknown uncertainty is not good");
        let some = [remark, first.clone(), second, poor.clone()];
        assert_eq!(grade(0.1, &some[..3]), (Grade::Usable, Some(&first)));
        assert_eq!(grade(0.1, &some), (Grade::Poor, Some(&poor)));
        assert_eq!(grade(0.5, &some[..3]), (Grade::Usable, None), "the corners already decide");
    }
}
