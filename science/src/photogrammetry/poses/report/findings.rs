//! What to consider about a report, as sentences with what to do.

use super::types::PoseReport;
use crate::types::{Warning, WarningCode};

/// Names that a finding lists.
const LISTED: usize = 5;

/// What to consider. `has_steps`: the axis of the turntable was found.
pub(super) fn findings_of(report: &PoseReport, has_steps: bool) -> Vec<Warning> {
    let mut findings = Vec::new();
    let mut names = |code: WarningCode, names: &[String], [one, many]: [&str; 2]| {
        if !names.is_empty() {
            let what = if names.len() == 1 { one } else { many };
            findings.push(Warning::new(code, format!("{} {what}: {}", names.len(), listed(names))));
        }
    };
    names(WarningCode::NotRegistered, &report.not_registered, ["view is not registered", "views are not registered"]);
    let unknown = ["registered view is not a view of this scan", "registered views are not views of this scan"];
    names(WarningCode::UnknownViews, &report.unknown, unknown);
    let twice = [
        "name occurs more than once; its first pose counts",
        "names occur more than once; the first pose of each counts",
    ];
    names(WarningCode::DuplicateViews, &report.duplicates, twice);
    let outliers: Vec<String> =
        report.views.iter().filter(|view| view.is_outlier).map(|view| view.name.clone()).collect();
    names(WarningCode::Outliers, &outliers, ["view does not fit the others", "views do not fit the others"]);
    let with_angles = report.views.iter().filter(|view| view.commanded_pan_deg.is_some()).count();
    if with_angles == 0 {
        findings.push(Warning::new(
            WarningCode::NoAngles,
            "the commanded angles are unknown, so steps of pan and tilt are not measured; name the views as in \
             pan020_tilt06, or give a CSV file the columns pan_deg and tilt_deg",
        ));
    } else if !has_steps {
        findings.push(Warning::new(
            WarningCode::NoAxis,
            "the axis is unknown: too few views have angles, all are on one line, or they have several tilts in one \
             plane; register more views",
        ));
    } else if report.pan_is_clockwise.is_none() {
        findings.push(Warning::new(
            WarningCode::NoSense,
            "the centres of one level ring look the same from above and from below, and the file has no rotations: which way \
             pan grows is unknown",
        ));
    }
    if report.pan_is_clockwise == Some(true) {
        findings.push(Warning::new(
            WarningCode::Clockwise,
            "pan grows clockwise, seen from above, against the convention: set pan_direction of the scan to clockwise, so \
             that bundles place the cameras as they were",
        ));
    }
    findings
}

fn listed(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(LISTED).map(String::as_str).collect();
    match names.len().checked_sub(LISTED) {
        None | Some(0) => shown.join(", "),
        Some(more) => format!("{} and {more} more", shown.join(", ")),
    }
}
