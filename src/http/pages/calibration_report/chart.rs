//! A chart of values per slice as an SVG figure: points or bars, with lines for the rail law and for limits.

use super::{
    axes::{Axis, round_down},
    html::{at, escape},
};

const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 200.0;
const LEFT: f64 = 48.0;
const RIGHT: f64 = 10.0;
/// Right margin of a chart whose lines have labels.
const RIGHT_WITH_LABELS: f64 = 44.0;
const TOP: f64 = 22.0;
const BOTTOM: f64 = 34.0;
/// Most slices whose marks have a `<title>` each; with more, the page would grow too large.
const MAX_TITLED: usize = 200;

/// A value of one slice.
pub(in crate::http::pages) struct Mark {
    /// Index of the slice.
    pub slice: usize,
    /// The value.
    pub value: f64,
    /// Drawn filled when measured, hollow when predicted.
    pub measured: bool,
    /// Standard deviation; drawn as a line of twice this length to both sides.
    pub sigma: Option<f64>,
    /// True for the second of two series: squares instead of circles.
    pub second: bool,
    /// Text for pointers and screen readers.
    pub title: String,
}

/// How marks are drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::http::pages) enum MarkStyle {
    /// Circles and squares.
    Points,
    /// Bars from zero.
    Bars,
}

/// Scale of the value axis.
#[derive(Clone, Copy, PartialEq)]
pub(in crate::http::pages) enum Scale {
    /// Linear; the axis spans at least this much.
    Linear(f64),
    /// Logarithmic.
    Logarithmic,
}

/// A line through values of slices.
pub(in crate::http::pages) struct Line {
    /// Slice and value, in the order of the slices.
    pub points: Vec<(usize, f64)>,
    /// True for a limit (dashed), false for the rail law (solid).
    pub limit: bool,
    /// Label at its right end.
    pub label: Option<String>,
}

/// A chart.
pub(in crate::http::pages) struct Chart<'a> {
    /// Heading.
    pub title: &'a str,
    /// One line of explanation below the heading.
    pub hint: String,
    /// Unit of the values, above the axis.
    pub unit: &'a str,
    /// Number of slices.
    pub count: usize,
    /// Index of the reference slice.
    pub reference: usize,
    /// Slices with a band behind them: the predicted ones.
    pub bands: Vec<usize>,
    /// The values.
    pub marks: Vec<Mark>,
    /// Rail law and limits.
    pub lines: Vec<Line>,
    /// How the marks are drawn.
    pub style: MarkStyle,
    /// Scale of the value axis.
    pub scale: Scale,
    /// Text shown instead of the chart when there are no values.
    pub empty: &'a str,
}

impl Chart<'_> {
    /// The chart as a figure.
    pub(in crate::http::pages) fn figure(&self) -> String {
        let caption = format!("<figcaption>{}<small>{}</small></figcaption>", escape(self.title), escape(&self.hint));
        if !self.marks.iter().any(|mark| mark.value.is_finite()) {
            return format!("<figure>{caption}<p class=\"none\">{}</p></figure>\n", escape(self.empty));
        }
        format!("<figure>{caption}\n{}</figure>\n", self.svg())
    }

    fn svg(&self) -> String {
        let axis = self.axis();
        let y = |value: f64| HEIGHT - BOTTOM - axis.position(value).clamp(-0.05, 1.05) * (HEIGHT - TOP - BOTTOM);
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{0}\"><title>{0}</title>",
            escape(&format!("{}: {}", self.title, self.hint))
        );
        self.backdrop(&mut out, &axis, &y);
        // limits are drawn in front of bars and behind points
        let (before, behind): (Vec<&Line>, Vec<&Line>) =
            self.lines.iter().partition(|line| line.limit && self.style == MarkStyle::Bars);
        for line in behind {
            self.line(&mut out, line, &axis, &y);
        }
        for mark in self.marks.iter().filter(|mark| axis.shows(mark.value)) {
            self.mark(&mut out, mark, y(mark.value), y);
        }
        for line in before {
            self.line(&mut out, line, &axis, &y);
        }
        for (label, (_, value)) in self.lines.iter().filter_map(|line| line.label.as_ref().zip(line.points.last())) {
            let (x, y) = (at(self.right() + 4.0), at(y(*value) + 4.0));
            out.push_str(&format!("<text class=\"w\" x=\"{x}\" y=\"{y}\">{}</text>", escape(label)));
        }
        out.push_str("</svg>\n");
        out
    }

    /// Centre of a slice's column.
    fn x(&self, slice: usize) -> f64 {
        LEFT + (slice as f64 + 0.5) * self.step()
    }

    /// Right edge of the last column.
    fn right(&self) -> f64 {
        WIDTH - if self.lines.iter().any(|line| line.label.is_some()) { RIGHT_WITH_LABELS } else { RIGHT }
    }

    fn step(&self) -> f64 {
        (self.right() - LEFT) / self.count.max(1) as f64
    }

    fn axis(&self) -> Axis {
        let values = self.marks.iter().map(|mark| mark.value);
        let values = values.chain(self.lines.iter().flat_map(|line| line.points.iter().map(|point| point.1)));
        let (mut low, mut high, mut least) = (f64::MAX, f64::MIN, f64::MAX);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
            if value > 0.0 {
                least = least.min(value);
            }
        }
        if self.style == MarkStyle::Bars {
            low = low.min(0.0);
        }
        match self.scale {
            Scale::Linear(span) => Axis::linear(low, high, span),
            Scale::Logarithmic => Axis::logarithmic(least.min(1e6), high),
        }
    }

    /// Bands, grid, axes and labels.
    fn backdrop(&self, out: &mut String, axis: &Axis, y: &dyn Fn(f64) -> f64) {
        let (right, bottom) = (self.right(), HEIGHT - BOTTOM);
        let step = self.step();
        for &slice in &self.bands {
            let (x, height) = (self.x(slice) - step / 2.0, bottom - TOP);
            out.push_str(&format!(
                "<rect class=\"i\" x=\"{}\" y=\"{TOP}\" width=\"{}\" height=\"{}\"/>",
                at(x),
                at(step.max(0.5)),
                at(height)
            ));
        }
        for (value, text) in &axis.ticks {
            let line = y(*value);
            out.push_str(&format!("<path class=\"g\" d=\"M{LEFT} {}H{right}\"/>", at(line)));
            out.push_str(&format!("<text class=\"e\" x=\"{}\" y=\"{}\">{text}</text>", LEFT - 6.0, at(line + 4.0)));
        }
        let reference = at(self.x(self.reference));
        out.push_str(&format!("<path class=\"r\" d=\"M{reference} {TOP}V{bottom}\"/>"));
        out.push_str(&format!("<path class=\"x\" d=\"M{LEFT} {TOP}V{bottom}H{right}\"/>"));
        // a tick per slice while there is space for it, a number at every few slices
        let numbered = (round_down(self.count as f64 / 5.0) as usize).max(1);
        let ticked = if step >= 4.0 { 1 } else { numbered };
        for slice in (0..self.count).step_by(ticked) {
            let x = at(self.x(slice));
            let is_numbered = slice % numbered == 0;
            out.push_str(&format!("<path class=\"x\" d=\"M{x} {bottom}v{}\"/>", if is_numbered { 5 } else { 3 }));
            if is_numbered {
                out.push_str(&format!("<text class=\"m\" x=\"{x}\" y=\"{}\">{slice}</text>", bottom + 17.0));
            }
        }
        out.push_str(&format!("<text class=\"e\" x=\"{right}\" y=\"{}\">slice</text>", HEIGHT - 4.0));
        out.push_str(&format!("<text x=\"2\" y=\"12\">{}</text>", escape(self.unit)));
    }

    fn line(&self, out: &mut String, line: &Line, axis: &Axis, y: &dyn Fn(f64) -> f64) {
        let mut path = String::new();
        for (k, (slice, value)) in line.points.iter().filter(|point| axis.shows(point.1)).enumerate() {
            let letter = if k == 0 { 'M' } else { 'L' };
            path.push_str(&format!("{letter}{} {}", at(self.x(*slice)), at(y(*value))));
        }
        let class = if line.limit { "lim" } else { "law" };
        out.push_str(&format!("<path class=\"{class}\" d=\"{path}\"/>"));
    }

    fn mark(&self, out: &mut String, mark: &Mark, y: f64, of: impl Fn(f64) -> f64) {
        let x = self.x(mark.slice);
        let step = self.step();
        let size = (0.35 * step).clamp(1.2, 3.4);
        if let Some(sigma) = mark.sigma.filter(|sigma| sigma.is_finite()) {
            let [top, bottom] = [2.0, -2.0].map(|times| at(of(mark.value + times * sigma)));
            out.push_str(&format!("<path class=\"x\" d=\"M{} {top}V{bottom}\"/>", at(x)));
        }
        let class = match (mark.second, mark.measured) {
            (false, true) => "p",
            (false, false) => "p h",
            (true, true) => "p b",
            (true, false) => "p b h",
        };
        let (name, shape) = match (self.style, mark.second) {
            (MarkStyle::Bars, _) => {
                let (zero, half) = (of(0.0), (0.36 * step).clamp(0.4, 12.0));
                let (top, height) = (y.min(zero), (zero - y).abs().max(0.5));
                ("rect", rectangle(x - half, top, 2.0 * half, height))
            }
            (MarkStyle::Points, true) => ("rect", rectangle(x - size, y - size, 2.0 * size, 2.0 * size)),
            (MarkStyle::Points, false) => ("circle", format!("cx=\"{}\" cy=\"{}\" r=\"{size:.1}\"", at(x), at(y))),
        };
        match self.count <= MAX_TITLED {
            true => out.push_str(&format!(
                "<{name} class=\"{class}\" {shape}><title>{}</title></{name}>",
                escape(&mark.title)
            )),
            false => out.push_str(&format!("<{name} class=\"{class}\" {shape}/>")),
        }
    }
}

fn rectangle(x: f64, y: f64, width: f64, height: f64) -> String {
    format!("x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"", at(x), at(y), at(width), at(height))
}
