//! How far the rig moved since the revision before.

use super::{
    chart::{Chart, Form, Line, Mark, Spread},
    html::{escape, number, sentence},
};
use crate::types::report::{CalibrationReport, Drift};

/// The section on drift.
pub(super) fn moved(report: &CalibrationReport, drift: Option<&Drift>) -> String {
    let head = "<section>\n<h2>Since the revision before</h2>\n";
    let Some(drift) = drift else {
        return format!(
            "{head}<p>There is no earlier revision of this rig and lens to compare with.</p>\n</section>\n"
        );
    };
    let detail = escape(&sentence(&drift.detail));
    if drift.worst_px.is_none() {
        return format!("{head}<p>{detail}</p>\n</section>\n");
    }
    let mut corners = chart(report, drift, "How far the corners moved", "px", &drift.corner_px, 3, " px");
    corners.hint = "the farthest of the four: up to 0.3 px is nothing, from 1 px on stacks may be affected".to_owned();
    corners.form = Form::Bars;
    corners.spread = Spread::Even(0.2);
    let limit = |value: f64, label: &str| Line {
        points: (0..corners.count).map(|i| (i, value)).collect(),
        limit: true,
        label: Some(label.to_owned()),
    };
    let mut limits = vec![limit(super::super::drift::STILL, "0.3 px")];
    if drift.worst_px.is_some_and(|worst| worst > super::super::drift::LITTLE) {
        limits.push(limit(super::super::drift::LITTLE, "1 px"));
    }
    corners.lines = limits;
    let mut gains = chart(report, drift, "Gain over the gain it had", "times", &drift.gain_ratio, 3, "");
    gains.hint = "1: the light has not changed against the reference slice".to_owned();
    let (from, to) = (drift.from_revision, drift.to_revision);
    format!(
        "{head}<p>{detail}</p>\n<p class=\"hint\">Revision {to} against revision {from}. A movement that all slices share with the \
         reference slice does not show: it does not harm the stacks either.</p>\n\
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
    let is_guess = |slice: usize| report.slices.get(slice).is_some_and(|slice| slice.interpolated);
    let mark = |(slice, value): (usize, &Option<f64>)| {
        let value = (*value)?;
        let title = format!("slice {slice}: {}{after} since revision {}", number(value, decimals), drift.from_revision);
        Some(Mark { slice, value, measured: !is_guess(slice), second: false, title })
    };
    Chart {
        title,
        hint: String::new(),
        unit,
        count: values.len(),
        reference: report.reference_index as usize,
        bands: (0..values.len()).filter(|&slice| is_guess(slice)).collect(),
        marks: values.iter().enumerate().filter_map(mark).collect(),
        lines: Vec::new(),
        form: Form::Points,
        spread: Spread::Even(0.02),
        empty: "Not known.",
    }
}
