//! Drift: how far the rig moved since the previous revision.

use super::{
    chart::{Chart, Line, Mark, MarkStyle, Scale},
    html::{escape, number, sentence},
};
use pinstack_science::{
    calibration::{NO_MOVEMENT_PX, SMALL_MOVEMENT_PX},
    types::report::{CalibrationReport, Drift},
};

/// The section on drift.
pub(super) fn section(report: &CalibrationReport, drift: Option<&Drift>) -> String {
    let head = "<section>\n<h2>Drift since the previous revision</h2>\n";
    let Some(drift) = drift else {
        return format!("{head}<p>There are no two revisions of this rig and lens to compare.</p>\n</section>\n");
    };
    let detail = escape(&sentence(&drift.detail));
    if drift.worst_px.is_none() {
        return format!("{head}<p>{detail}</p>\n</section>\n");
    }
    let mut corners = chart(report, drift, "How far the corners moved", "px", &drift.corner_px, 3, " px");
    corners.hint =
        "the largest of the four: up to 0.3 px the rig has not moved; above 1 px stacks may be affected".to_owned();
    corners.style = MarkStyle::Bars;
    corners.scale = Scale::Linear(0.2);
    let limit = |value: f64, label: &str| Line {
        points: (0..corners.count).map(|i| (i, value)).collect(),
        limit: true,
        label: Some(label.to_owned()),
    };
    let mut limits = vec![limit(NO_MOVEMENT_PX, "0.3 px")];
    if drift.worst_px.is_some_and(|worst| worst > SMALL_MOVEMENT_PX) {
        limits.push(limit(SMALL_MOVEMENT_PX, "1 px"));
    }
    corners.lines = limits;
    let mut gains = chart(report, drift, "Gain over the previous gain", "times", &drift.gain_ratio, 3, "");
    gains.hint = "1: brightness relative to the reference slice has not changed".to_owned();
    let (from, to) = (drift.from_revision, drift.to_revision);
    format!(
        "{head}<p>{detail}</p>\n<p class=\"hint\">Revision {to} compared with revision {from}. A movement that all slices share with \
         the reference slice does not show, and does not affect stacks.</p>\n\
         <div class=\"charts\">\n{}{}</div>\n</section>\n",
        corners.figure(),
        gains.figure()
    )
}

fn chart<'a>(
    report: &CalibrationReport,
    drift: &Drift,
    title: &'a str,
    unit: &'a str,
    values: &[Option<f64>],
    decimals: usize,
    after: &str,
) -> Chart<'a> {
    let is_predicted = |slice: usize| report.slices.get(slice).is_some_and(|slice| slice.interpolated);
    let mark = |(slice, value): (usize, &Option<f64>)| {
        let value = (*value)?;
        let title = format!("slice {slice}: {}{after} since revision {}", number(value, decimals), drift.from_revision);
        Some(Mark { slice, value, measured: !is_predicted(slice), sigma: None, second: false, title })
    };
    Chart {
        title,
        hint: String::new(),
        unit,
        count: values.len(),
        reference: report.reference_index as usize,
        bands: (0..values.len()).filter(|&slice| is_predicted(slice)).collect(),
        marks: values.iter().enumerate().filter_map(mark).collect(),
        lines: Vec::new(),
        style: MarkStyle::Points,
        scale: Scale::Linear(0.02),
        empty: "Not known.",
    }
}
