//! The report on camera poses as a page: the table, the sphere, and the residuals of the views. It loads nothing.

use super::html::{at, escape, maybe, number, sentence, table};
use pinstack_science::photogrammetry::poses::{PoseReport, ViewPose};

pub use super::calibration_report::STYLE;

/// Most views of the table on the page. JSON has all.
const MAX_ROWS: usize = 1000;
/// Size of the drawing of the sphere, and its radius, px.
const SPHERE: f64 = 420.0;
const RADIUS: f64 = 150.0;
/// Elevation from which the sphere is seen, degrees.
const ELEVATION_DEG: f64 = 35.0;
/// Length of the largest residual in the drawings, px.
const LARGEST: f64 = 36.0;
/// Size of the chart of radial residuals, px.
const CHART: [f64; 2] = [420.0, 420.0];

/// The whole page.
pub fn page(report: &PoseReport) -> String {
    let title = format!("{} camera poses", report.registered);
    let mut out = String::with_capacity(1 << 16);
    out.push_str("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    out.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n");
    out.push_str(&format!(
        "<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n"
    ));
    if !report.findings.is_empty() {
        out.push_str("<ul class=\"findings\">\n");
        for finding in &report.findings {
            let (detail, code) = (escape(&sentence(&finding.detail)), escape(finding.code.as_str()));
            out.push_str(&format!("<li>{detail} <code>{code}</code></li>\n"));
        }
        out.push_str("</ul>\n");
    }
    out.push_str("<dl class=\"facts\">\n");
    for (name, value) in report.quantities() {
        let value = escape(&value.replace("+-", "±"));
        out.push_str(&format!("<dt>{}</dt><dd>{value}</dd>\n", escape(&sentence(&name))));
    }
    let not_checked = report.not_checked.as_deref().map(|text| format!("<p>{}</p>\n", escape(&sentence(text))));
    out.push_str(&format!("</dl>\n{}<div class=\"charts\">\n", not_checked.unwrap_or_default()));
    out.push_str(&sphere(report));
    out.push_str(&radial(report));
    out.push_str("</div>\n<h2>Views</h2>\n");
    out.push_str(&views(report));
    out.push_str("</main>\n</body>\n</html>\n");
    out
}

/// Factor that draws the largest value of the views that fit with [`LARGEST`] px.
fn exaggeration(views: &[ViewPose], value: impl Fn(&ViewPose) -> Option<f64>) -> f64 {
    let most = views.iter().filter(|view| !view.is_outlier).filter_map(value).fold(0.0, |a: f64, b| a.max(b.abs()));
    if most > 0.0 { LARGEST / most } else { 0.0 }
}

/// The cameras on the sphere, seen from above at an angle, with their radial residuals exaggerated.
fn sphere(report: &PoseReport) -> String {
    let Some(surface) = report.surface.as_ref().filter(|_| report.views.iter().any(|view| view.pan_deg.is_some()))
    else {
        return String::new();
    };
    let factor = exaggeration(&report.views, |view| view.radial_residual);
    let (sin_e, cos_e) = ELEVATION_DEG.to_radians().sin_cos();
    let middle = SPHERE / 2.0;
    // pan 0 points at the reader and grows counterclockwise, seen from above, unless the table turns the other way
    let sense = if report.pan_is_clockwise == Some(true) { -1.0 } else { 1.0 };
    let project = |pan: f64, tilt: f64, radius: f64| {
        let ([sin_p, cos_p], [sin_t, cos_t]) = ([pan.sin(), pan.cos()], [tilt.sin(), tilt.cos()]);
        let (x, y, z) = (radius * cos_t * sin_p, radius * cos_t * cos_p, radius * sin_t);
        (middle + x, middle + y * sin_e - z * cos_e)
    };
    let mut marks = String::new();
    for view in &report.views {
        let Some(pan) = view.pan_deg.map(|pan| sense * pan.to_radians()) else { continue };
        let tilt = view.tilt_deg.unwrap_or(0.0).to_radians();
        let residual = (view.radial_residual.unwrap_or(0.0) * factor).clamp(-2.0 * LARGEST, 2.0 * LARGEST);
        let (x, y) = project(pan, tilt, RADIUS);
        let (to_x, to_y) = project(pan, tilt, RADIUS + residual);
        let (line, dot) = if view.is_outlier { ("o", "w") } else { ("a", "p") };
        marks.push_str(&format!(
            "<path class=\"{line}\" d=\"M{} {}L{} {}\"/><circle class=\"{dot}\" cx=\"{}\" cy=\"{}\" r=\"2\"><title>{}</title></circle>\n",
            at(x), at(y), at(to_x), at(to_y), at(x), at(y), escape(&view.name)
        ));
    }
    let times = if factor > 0.0 { factor * surface.radius / RADIUS } else { 1.0 };
    format!(
        "<figure><figcaption>Cameras on the fitted surface<small>Lines: radial residuals, {} times as long as they \
         are; orange: views that do not fit</small></figcaption>\n\
         <svg viewBox=\"0 0 {SPHERE} {SPHERE}\" role=\"img\" aria-label=\"Camera positions around the object\">\n\
         <circle class=\"g\" cx=\"{middle}\" cy=\"{middle}\" r=\"{RADIUS}\"/>\
         <ellipse class=\"r\" fill=\"none\" cx=\"{middle}\" cy=\"{middle}\" rx=\"{RADIUS}\" ry=\"{}\"/>\n\
         <path class=\"k\" d=\"M{middle} {}V{}\"/><text class=\"m\" x=\"{middle}\" y=\"{}\">axis</text>\n{marks}</svg></figure>\n",
        number(times, 0),
        at(RADIUS * sin_e),
        at(middle),
        at(middle - (RADIUS + 24.0) * cos_e),
        at(middle - (RADIUS + 32.0) * cos_e),
    )
}

/// The radial residuals in the order of the file.
fn radial(report: &PoseReport) -> String {
    let count = report.views.len();
    if report.surface.is_none() || count == 0 {
        return String::new();
    }
    let [width, height] = CHART;
    let (left, middle) = (70.0, height / 2.0);
    let factor = exaggeration(&report.views, |view| view.radial_residual) * (middle - 24.0) / LARGEST;
    let step = (width - left - 10.0) / count as f64;
    let mut bars = String::new();
    for (index, view) in report.views.iter().enumerate() {
        let Some(residual) = view.radial_residual else { continue };
        let y = (residual * factor).clamp(10.0 - middle, middle - 10.0);
        let x = left + (index as f64 + 0.5) * step;
        let class = if view.is_outlier { "o" } else { "a" };
        bars.push_str(&format!(
            "<path class=\"{class}\" d=\"M{} {}V{}\"><title>{}</title></path>\n",
            at(x),
            at(middle),
            at(middle - y),
            escape(&view.name)
        ));
    }
    let most = if factor > 0.0 { (middle - 24.0) / factor * report.length_factor() } else { 0.0 };
    let label = |value: f64, y: f64| {
        format!("<text class=\"e\" x=\"{}\" y=\"{}\">{}</text>", at(left - 6.0), at(y + 4.0), number(value, 4))
    };
    format!(
        "<figure><figcaption>Radial residuals<small>In {}, in the order of the file</small></figcaption>\n\
         <svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"Radial residual of each view\">\n\
         <path class=\"x\" d=\"M{left} {middle}H{width}\"/>{}{}{}\n{bars}</svg></figure>\n",
        report.length_name(),
        label(most, 24.0),
        label(0.0, middle),
        label(-most, height - 24.0),
    )
}

/// The table of views.
fn views(report: &PoseReport) -> String {
    let radial = format!("Radial<br>{}", report.length_name());
    let tangential = format!("Tangential<br>{}", report.length_name());
    let heads = [
        "View",
        "Pan<br>deg",
        "Tilt<br>deg",
        &radial,
        &tangential,
        "Pan residual<br>deg",
        "Tilt residual<br>deg",
        "Fits",
    ];
    let length = |value: Option<f64>| maybe(value.map(|value| value * report.length_factor()), 4);
    let row = |view: &ViewPose| {
        let cells = vec![
            escape(&view.name),
            maybe(view.commanded_pan_deg, 2),
            maybe(view.commanded_tilt_deg, 2),
            length(view.radial_residual),
            length(view.tangential_residual),
            maybe(view.pan_residual_deg, 4),
            maybe(view.tilt_residual_deg, 4),
            if view.is_outlier { "no" } else { "yes" }.to_owned(),
        ];
        ("", cells)
    };
    let rows: Vec<_> = report.views.iter().take(MAX_ROWS).map(row).collect();
    let more = match report.views.len().checked_sub(MAX_ROWS) {
        None | Some(0) => String::new(),
        Some(more) => format!("<p class=\"hint\">{more} more views are in the JSON of this report.</p>\n"),
    };
    table("Views and their residuals", &heads, &rows) + &more
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinstack_science::{
        photogrammetry::poses::{PoseOptions, read, report},
        types::view::ViewAngles,
    };

    #[test]
    fn a_clockwise_table_is_drawn_clockwise() {
        // where the view at pan 90 is drawn, from left to right
        let drawn = |sense: f64| {
            let mut text = "name,x,y,z\n".to_owned();
            for view in 0..24 {
                let angles = ViewAngles { pan_deg: f64::from(view % 12) * 30.0, tilt_deg: f64::from(view / 12) * 12.0 };
                let [x, y, z] = ViewAngles { pan_deg: sense * angles.pan_deg, ..angles }.direction();
                text.push_str(&format!("{},{x},{y},{z}\n", angles.file_stem()));
            }
            let file = read(text.as_bytes(), None).expect("poses");
            let report = report(&file, &PoseOptions::default()).expect("a report");
            assert_eq!(report.pan_is_clockwise, Some(sense < 0.0));
            let page = page(&report);
            let (before, _) = page.split_once("<title>pan090_tilt00</title>").expect("its dot");
            let (_, dot) = before.rsplit_once("cx=\"").expect("a circle");
            dot.split('"').next().and_then(|x| x.parse::<f64>().ok()).expect("a number")
        };
        assert!((drawn(1.0) - SPHERE / 2.0 - RADIUS).abs() < 0.1);
        assert!((drawn(-1.0) - SPHERE / 2.0 + RADIUS).abs() < 0.1);
    }

    #[test]
    fn the_page_shows_every_view_and_escapes_its_name() {
        let mut text = "name,x,y,z\n".to_owned();
        for view in 0..36 {
            let angles = ViewAngles { pan_deg: f64::from(view % 18) * 20.0, tilt_deg: f64::from(view / 18) * 12.0 };
            let [x, y, z] = angles.direction();
            let extra = if view == 3 { "<b>" } else { "" };
            text.push_str(&format!("{}{extra},{x},{y},{z}\n", angles.file_stem()));
        }
        let file = read(text.as_bytes(), None).expect("poses");
        let page = page(&report(&file, &PoseOptions::default()).expect("a report"));
        assert!(page.contains("pan060_tilt00&lt;b&gt;") && !page.contains("<b>"), "a name is text");
        assert_eq!(page.matches("<circle class=\"p\"").count(), 36);
        assert!(page.contains("<dt>Registered</dt><dd>36</dd>"));
        for outside in ["http:", "https:", "src=", "@import", "url("] {
            assert!(!page.contains(outside), "{outside}");
        }
    }
}
