//! The charts over the slices, with their key.

use super::{
    chart::{Chart, Line, Mark, MarkStyle, Scale},
    html::number,
};
use pinstack_science::types::report::{CalibrationReport, SliceReport};

/// Blur radius over dot pitch beyond which dots merge and cannot be measured.
const MAX_BLUR: f64 = 0.45;
/// What the last chart shows.
const SIGMA: &str = "standard deviation of the worst image corner";
/// Uncertainty of the worst corner of a good slice, px.
const GOOD: f64 = 0.3;

/// The charts over the slices.
pub(super) fn charts(report: &CalibrationReport) -> String {
    let slices = &report.slices;
    if slices.is_empty() {
        return String::new();
    }
    let sheet = Sheet { report };
    let has_target = report.target.is_some();
    // without a target, most of this is not measured
    let figures: String =
        [sheet.scale(), sheet.shift(), sheet.off_law(), sheet.blur(), sheet.contrast(), sheet.gain(), sheet.sigma()]
            .iter()
            .filter(|chart| has_target || !chart.marks.is_empty())
            .map(Chart::figure)
            .collect();
    let key = if has_target { KEY } else { "" };
    format!("<section>\n<h2>Charts over the slices</h2>\n{key}<div class=\"charts\">\n{figures}</div>\n</section>\n")
}

/// The key of all charts of a target. Without one, they have measured points only.
const KEY: &str = "<p class=\"key\">\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><circle class=\"p\" cx=\"13\" cy=\"8\" r=\"3.4\"/></svg>measured</span>\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><rect class=\"i\" x=\"7\" y=\"0\" width=\"12\" height=\"16\"/><circle class=\"p h\" cx=\"13\" cy=\"8\" r=\"3.4\"/></svg>interpolated: not measured, predicted from the other slices</span>\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><path class=\"law\" d=\"M1 8H25\"/></svg>rail law, smooth law of the gains</span>\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><path class=\"lim\" d=\"M1 8H25\"/></svg>limit</span>\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><path class=\"r\" d=\"M13 0V16\"/></svg>reference slice</span></p>\n";

struct Sheet<'a> {
    report: &'a CalibrationReport,
}

impl Sheet<'_> {
    fn chart<'t>(&self, title: &'t str, hint: &str, unit: &'t str, marks: Vec<Mark>, scale: Scale) -> Chart<'t> {
        let slices = &self.report.slices;
        Chart {
            title,
            hint: hint.to_owned(),
            unit,
            count: slices.len(),
            reference: self.report.reference_index as usize,
            bands: (0..slices.len()).filter(|&i| slices[i].interpolated).collect(),
            marks,
            lines: Vec::new(),
            style: MarkStyle::Points,
            scale,
            empty: "Not measured.",
        }
    }

    /// One mark per slice that has the value.
    fn marks(&self, decimals: usize, unit: &str, value: impl Fn(&SliceReport) -> Option<f64>) -> Vec<Mark> {
        let mark = |(i, slice): (usize, &SliceReport)| {
            let value = value(slice)?;
            let how = if slice.interpolated { ", interpolated" } else { "" };
            let title = format!("slice {i}, {}: {}{unit}{how}", slice.name, number(value, decimals));
            Some(Mark { slice: i, value, measured: !slice.interpolated, sigma: None, second: false, title })
        };
        self.report.slices.iter().enumerate().filter_map(mark).collect()
    }

    fn line(&self, limit: bool, label: Option<&str>, value: impl Fn(&SliceReport) -> Option<f64>) -> Line {
        let points = self.report.slices.iter().enumerate();
        let points = points.filter_map(|(i, slice)| Some((i, value(slice).filter(|v| v.is_finite())?))).collect();
        Line { points, limit, label: label.map(str::to_owned) }
    }

    fn scale(&self) -> Chart<'_> {
        let hint = "factor from the slice to the reference slice";
        let mut chart = self.chart("Scale", hint, "times", self.marks(6, "", |s| Some(s.scale)), Scale::Linear(1e-4));
        chart.lines.push(self.line(false, None, |s| s.law_scale));
        chart
    }

    fn shift(&self) -> Chart<'_> {
        let mut marks = self.marks(2, " px to the right", |s| Some(s.shift_px[0]));
        let second = self.marks(2, " px down", |s| Some(s.shift_px[1]));
        marks.extend(second.into_iter().map(|mark| Mark { second: true, ..mark }));
        let hint = "of the image centre, from the slice to the reference slice: ● to the right, ■ down";
        let mut chart = self.chart("Shift", hint, "px", marks, Scale::Linear(1.0));
        chart.lines.push(self.line(false, None, |s| s.law_shift_px.map(|shift| shift[0])));
        chart.lines.push(self.line(false, None, |s| s.law_shift_px.map(|shift| shift[1])));
        chart
    }

    fn off_law(&self) -> Chart<'_> {
        let hint = "largest distance of an image corner from its position by the rail law";
        let marks = self.marks(3, " px", |s| s.off_law_px);
        let mut chart = self.chart("Distance from the rail law", hint, "px", marks, Scale::Linear(0.1));
        chart.style = MarkStyle::Bars;
        chart.empty = "No rail law was fitted.";
        chart
    }

    fn blur(&self) -> Chart<'_> {
        let pitch = self.report.target.as_ref().map_or(0.0, |target| target.pitch_px);
        let limit = |s: &SliceReport| (s.scale > 0.0).then(|| MAX_BLUR * pitch / s.scale);
        let hint = "radius; above the limit (0.45 of the dot pitch) dots merge and cannot be measured";
        let mut chart = self.chart("Blur", hint, "px", self.marks(1, " px", |s| s.blur_radius_px), Scale::Linear(1.0));
        if pitch > 0.0 {
            chart.lines.push(self.line(true, Some("limit"), limit));
        }
        chart
    }

    fn gain(&self) -> Chart<'_> {
        let mut marks = self.marks(4, "", |s| Some(s.gain));
        for mark in &mut marks {
            let slice = &self.report.slices[mark.slice];
            mark.sigma = slice.gain_sigma.map(|sigma| sigma * slice.gain);
        }
        let hint = match marks.iter().any(|mark| mark.sigma.is_some()) {
            true => "a slice is multiplied by this to match the reference; bars: two standard deviations",
            false => "a slice is multiplied by this to match the reference",
        };
        let mut chart = self.chart("Gain", hint, "times", marks, Scale::Linear(0.02));
        chart.lines.push(self.line(false, None, |s| s.law_gain));
        chart
    }

    fn contrast(&self) -> Chart<'_> {
        let hint = "of the dots, relative to the sharpest slice; near zero blur hides them, below it inverts them";
        self.chart("Contrast", hint, "times", self.marks(2, "", |s| s.contrast), Scale::Linear(0.5))
    }

    fn sigma(&self) -> Chart<'_> {
        let sigma = |s: &SliceReport| Some(s.corner_sigma_px);
        let worst = self.report.slices.iter().filter_map(sigma).filter(|v| v.is_finite()).fold(0.0, f64::max);
        // a logarithmic axis shows the limit and the small values together
        let scale = if worst > 5.0 * GOOD { Scale::Logarithmic } else { Scale::Linear(0.1) };
        let mut chart = self.chart("Corner uncertainty", SIGMA, "px", self.marks(3, " px", sigma), scale);
        if self.report.target.is_some() {
            chart.hint.push_str("; below the limit a calibration is good");
            chart.lines.push(self.line(true, Some("0.3 px"), |_| Some(GOOD)));
        }
        chart
    }
}
