//! Residual maps: one small map per slice with an arrow per dot for its residual, drawn in the reference slice.

use std::collections::BTreeSet;

use super::{
    axes::{decimals, round_down},
    html::{at, escape, maybe, number},
};
use pinstack_science::types::report::{CalibrationReport, DotReport, SliceReport};

/// Width of a map, SVG units.
const WIDTH: f64 = 300.0;
/// Largest height of a map, SVG units.
const MAX_HEIGHT: f64 = 420.0;
/// Height below the map for its scale bar, SVG units.
const FOOT: f64 = 24.0;
/// Most dots drawn per map, outliers not counted.
const MAX_DOTS: usize = 300;
/// Most outliers drawn per map.
const MAX_OUTLIERS: usize = 75;
/// Most maps. Of a longer stack an even selection is drawn, and the worst slices.
const MAX_MAPS: usize = 60;
/// Length of the arrow for the 95th percentile of the residuals, SVG units.
const ARROW: f64 = 15.0;
/// Longest arrow, SVG units; longer ones are cut off and have no head.
const MAX_ARROW: f64 = 42.0;

/// The section with the maps; nothing for a calibration without a target.
pub(super) fn residual_maps(report: &CalibrationReport) -> String {
    let slices = &report.slices;
    if report.target.is_none() || slices.is_empty() || report.width < 2 || report.height < 2 {
        return String::new();
    }
    let frame = Frame::of(report);
    let shown = chosen(slices, report.reference_index as usize);
    let figures: String = shown.iter().filter_map(|&i| Some(frame.figure(i, slices.get(i)?, report))).collect();
    let fewer = match shown.len() < slices.len() {
        true => format!(" {} of {} slices are drawn, among them the worst.", shown.len(), slices.len()),
        false => String::new(),
    };
    format!(
        "<section>\n<h2>Residuals of the dots</h2>\n\
         <p>Each map is the frame of the reference slice. An arrow points from a dot in the reference slice to where the \
         homography maps the same dot of this slice, <strong>enlarged {} times</strong>, equally in all maps. Random arrows are \
         noise; arrows that turn, grow or point the same way mean that the homography does not fit. A pattern that is the same \
         in all maps comes from the dots of the reference slice, which were measured only once.{fewer}</p>\n{KEY}\
         <div class=\"maps\">\n{figures}</div>\n</section>\n",
        number(frame.enlarged, decimals(frame.enlarged)),
    )
}

const KEY: &str = "<p class=\"key\">\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><path class=\"d\" d=\"M4 11h0\"/><path class=\"a\" d=\"M4 11L20 5m-4.3 -.2L20 5l-2.8 3.3\"/></svg>inlier</span>\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><path class=\"o\" d=\"M3 4l8 8m0 -8l-8 8\"/><path class=\"oa\" d=\"M7 8H25\"/></svg>outlier, not used in the fit</span>\
    <span><svg viewBox=\"0 0 26 16\" aria-hidden=\"true\"><path class=\"u\" d=\"M13 8h0\"/></svg>found but not used</span></p>\n";

/// All slices of a short stack; else the reference, the worst ones and an even selection.
fn chosen(slices: &[SliceReport], reference: usize) -> Vec<usize> {
    if slices.len() <= MAX_MAPS {
        return (0..slices.len()).collect();
    }
    let mut worst: Vec<usize> = (0..slices.len()).collect();
    let rms = |i: usize| slices.get(i).and_then(|slice| slice.rms_px).unwrap_or(0.0);
    worst.sort_by(|&a, &b| rms(b).total_cmp(&rms(a)));
    let even = MAX_MAPS - MAX_MAPS / 6 - 1;
    let mut out: Vec<usize> = (0..even).map(|k| k * (slices.len() - 1) / (even - 1)).collect();
    out.extend(worst.into_iter().take(MAX_MAPS / 6));
    out.push(reference.min(slices.len() - 1));
    out.sort_unstable();
    out.dedup();
    out
}

fn length(residual: [f64; 2]) -> f64 {
    residual[0].hypot(residual[1])
}

/// At most `most` dots, spread evenly: one dot per cell of a grid with about `most` cells.
fn thinned(dots: Vec<&DotReport>, most: usize, size: [f64; 2]) -> Vec<&DotReport> {
    if dots.len() <= most {
        return dots;
    }
    // cells are cut at two edges, so there are a few more than their area gives
    let cell = (size[0] * size[1] / (0.85 * most as f64)).sqrt().max(1.0);
    let mut taken = BTreeSet::new();
    let is_first = |dot: &&DotReport| taken.insert(dot.at.map(|v| (v / cell).floor() as i64));
    dots.into_iter().filter(is_first).take(most).collect()
}

/// Layout shared by all maps.
struct Frame {
    /// SVG units per px.
    unit: f64,
    height: f64,
    centre: [f64; 2],
    /// Factor by which residuals are enlarged against the map.
    enlarged: f64,
    /// Length of the scale bar, px of residual.
    bar: f64,
}

impl Frame {
    fn of(report: &CalibrationReport) -> Self {
        let (width, height) = (f64::from(report.width), f64::from(report.height));
        let unit = ((WIDTH - 2.0) / width).min(MAX_HEIGHT / height);
        let mut lengths: Vec<f64> = report
            .slices
            .iter()
            .flat_map(|slice| &slice.dots)
            .filter(|dot| dot.inlier)
            .filter_map(|dot| dot.residual.map(length))
            .filter(|length| length.is_finite() && *length > 0.0)
            .collect();
        lengths.sort_by(f64::total_cmp);
        let large = lengths.get(lengths.len() * 95 / 100).copied().unwrap_or(0.1).max(1e-4);
        let enlarged = round_down(ARROW / (large * unit)).max(1.0);
        let bar = round_down(60.0 / (enlarged * unit));
        Self { unit, height: height * unit, centre: [(width - 1.0) / 2.0, (height - 1.0) / 2.0], enlarged, bar }
    }

    fn figure(&self, index: usize, slice: &SliceReport, report: &CalibrationReport) -> String {
        let residuals = slice.dots.iter().filter(|dot| dot.inlier).filter_map(|dot| dot.residual.map(length));
        let worst = residuals
            .filter(|length| length.is_finite())
            .fold(None, |worst: Option<f64>, l| Some(worst.map_or(l, |worst| worst.max(l))));
        let numbers = match () {
            () if index == report.reference_index as usize => "the reference".to_owned(),
            () if slice.interpolated => "interpolated".to_owned(),
            () => {
                let out = slice.dots.iter().filter(|dot| !dot.inlier && dot.residual.is_some()).count();
                let outliers = match out {
                    0 => String::new(),
                    1 => " · 1 outlier".to_owned(),
                    n => format!(" · {n} outliers"),
                };
                format!("RMS {} · worst {} px{outliers}", maybe(slice.rms_px, 3), maybe(worst, 2))
            }
        };
        let name = escape(&slice.name);
        format!(
            "<figure>{}<figcaption><a href=\"overlay?slice={index}\">{index} · <bdi>{name}</bdi></a> <span>{numbers}</span></figcaption></figure>\n",
            self.svg(index, slice, &numbers)
        )
    }

    fn svg(&self, index: usize, slice: &SliceReport, numbers: &str) -> String {
        let (width, height) = (2.0 + 2.0 * self.centre[0] * self.unit + self.unit, self.height);
        let title = escape(&format!("Residuals of slice {index}, {}: {numbers}", slice.name));
        let dashes = if slice.interpolated { " stroke-dasharray=\"4 4\"" } else { "" };
        let mut out = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{title}\"><title>{title}</title>\
             <rect class=\"f\" x=\"1\" y=\"1\" width=\"{}\" height=\"{}\"{dashes}/>",
            at(height + 2.0 + FOOT),
            at(width - 2.0),
            at(height)
        );
        let (mut unused, mut dots, mut arrows) = (String::new(), String::new(), String::new());
        let (outliers, others): (Vec<&DotReport>, Vec<&DotReport>) =
            slice.dots.iter().partition(|dot| !dot.inlier && dot.residual.is_some());
        for dot in thinned(others, MAX_DOTS, self.size()) {
            let Some(place) = self.place(slice, dot) else { continue };
            let point = format!("M{} {}h0", at(place[0]), at(place[1]));
            match dot.residual {
                None => unused.push_str(&point),
                Some(residual) => {
                    dots.push_str(&point);
                    arrows.push_str(&arrow(place, self.drawn(residual)));
                }
            }
        }
        for (class, path) in [("u", unused), ("d", dots), ("a", arrows)] {
            if !path.is_empty() {
                out.push_str(&format!("<path class=\"{class}\" d=\"{path}\"/>"));
            }
        }
        for dot in thinned(outliers, MAX_OUTLIERS, self.size()) {
            self.outlier(&mut out, slice, dot);
        }
        self.scale_bar(&mut out);
        out.push_str("</svg>");
        out
    }

    /// Position of a dot in the reference slice, SVG units; `None` outside its frame. Uses the slice's scale and shift
    /// only, which is exact enough for a map of this size.
    fn place(&self, slice: &SliceReport, dot: &DotReport) -> Option<[f64; 2]> {
        let moved = [0, 1].map(|a| self.centre[a] + slice.scale * (dot.at[a] - self.centre[a]) + slice.shift_px[a]);
        let inside = |a: usize| moved[a].is_finite() && (0.0..=2.0 * self.centre[a]).contains(&moved[a]);
        (inside(0) && inside(1)).then(|| moved.map(|v| 1.0 + (v + 0.5) * self.unit))
    }

    /// Width and height of a slice, px.
    fn size(&self) -> [f64; 2] {
        self.centre.map(|half| 2.0 * half + 1.0)
    }

    fn drawn(&self, residual: [f64; 2]) -> [f64; 2] {
        residual.map(|r| r * self.enlarged * self.unit)
    }

    fn outlier(&self, out: &mut String, slice: &SliceReport, dot: &DotReport) {
        let (Some(place), Some(residual)) = (self.place(slice, dot), dot.residual) else { return };
        let [x, y] = place.map(at);
        let arrow = arrow(place, self.drawn(residual));
        let missed = number(length(residual), 2);
        out.push_str(&format!(
            "<g><title>outlier, {missed} px off</title><path class=\"oa\" d=\"{arrow}\"/><path class=\"o\" d=\"M{x} {y}m-4 -4l8 8m0 -8l-8 8\"/></g>"
        ));
    }

    fn scale_bar(&self, out: &mut String) {
        let long = self.bar * self.enlarged * self.unit;
        let y = self.height + 14.0;
        out.push_str(&format!(
            "<path class=\"k\" d=\"M4 {0}v6m0 -3h{1}m0 -3v6\"/><text x=\"{2}\" y=\"{3}\">{4} px of residual</text>",
            at(y - 3.0),
            at(long),
            at(long + 11.0),
            at(y + 4.0),
            number(self.bar, decimals(self.bar)),
        ));
    }
}

/// An arrow as SVG path data: empty when it would be shorter than its line is wide, with a head when it is long enough
/// for one.
fn arrow(from: [f64; 2], by: [f64; 2]) -> String {
    let long = length(by);
    if !(long.is_finite() && long >= 0.6) {
        return String::new();
    }
    let shown = long.min(MAX_ARROW);
    let way = [by[0] / long, by[1] / long];
    let shaft = format!("M{} {}l{} {}", at(from[0]), at(from[1]), at(way[0] * shown), at(way[1] * shown));
    if shown < 5.0 || long > MAX_ARROW {
        return shaft;
    }
    let head = 0.9 * shown.min(9.0).sqrt();
    let back = |side: f64| {
        let turned = [-way[0] - side * way[1], -way[1] + side * way[0]];
        (at(turned[0] * head), at(turned[1] * head))
    };
    let ((ax, ay), (bx, by)) = (back(0.6), back(-0.6));
    let tip = [from[0] + way[0] * shown, from[1] + way[1] * shown].map(at);
    format!("{shaft}l{ax} {ay}M{} {}l{bx} {by}", tip[0], tip[1])
}
