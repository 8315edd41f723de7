//! The table of all values, one row per slice.

use super::html::{self, escape, maybe, number};
use pinstack_science::types::report::{CalibrationReport, SliceReport};

const HEADS: [&str; 16] = [
    "slice",
    "file",
    "how",
    "scale",
    "scale by law",
    "shift x, px",
    "shift y, px",
    "off law, px",
    "blur, px",
    "contrast",
    "gain",
    "clipped, %",
    "dots",
    "inliers",
    "RMS, px",
    "corner σ, px",
];

/// The section with the table.
pub(super) fn slice_table(report: &CalibrationReport) -> String {
    let rows: Vec<(&str, Vec<String>)> = report
        .slices
        .iter()
        .enumerate()
        .map(|(i, slice)| row(i, slice, i == report.reference_index as usize, report.target.is_some()))
        .collect();
    format!(
        "<section>\n<h2>All values</h2>\n<div class=\"l\">{}</div>\n</section>\n",
        html::table("All values per slice", &HEADS, &rows)
    )
}

fn row(index: usize, slice: &SliceReport, is_reference: bool, has_dots: bool) -> (&'static str, Vec<String>) {
    let (class, how) = match (is_reference, slice.interpolated) {
        (true, _) => ("", "reference"),
        (false, true) => ("guess", "interpolated"),
        (false, false) => ("", "measured"),
    };
    let name = escape(&slice.name);
    let cells = vec![
        index.to_string(),
        format!("<a href=\"overlay?slice={index}\" title=\"{name}\"><bdi>{name}</bdi></a>"),
        how.to_owned(),
        number(slice.scale, 6),
        maybe(slice.law_scale, 6),
        number(slice.shift_px[0], 2),
        number(slice.shift_px[1], 2),
        maybe(slice.off_law_px, 3),
        maybe(slice.blur_radius_px, 1),
        maybe(slice.contrast, 2),
        number(slice.gain, 4),
        maybe(slice.clipped.map(|share| 100.0 * share), 1),
        maybe(has_dots.then_some(slice.dots_found.into()), 0),
        maybe(has_dots.then_some(slice.inliers.into()), 0),
        maybe(slice.rms_px, 3),
        number(slice.corner_sigma_px, 3),
    ];
    (class, cells)
}
