//! The report as a table: as text, and as LaTeX in the form of table I of Li and Nguyen (2019).

use super::{LengthUnit, PoseReport, ScaleSource, StepReport, SurfaceKind};

/// A row: a quantity and its value.
struct Row {
    name: String,
    value: String,
    /// Mean and standard deviation, where the value is such a pair.
    pair: Option<[String; 2]>,
}

impl PoseReport {
    /// The quantities of table I with their values, for people.
    pub fn quantities(&self) -> Vec<(String, String)> {
        self.rows().into_iter().map(|row| (row.name, row.value)).collect()
    }

    /// The report as a table to read, with the findings and the views that fit worst.
    pub fn text(&self) -> String {
        let rows = self.rows();
        let width = rows.iter().map(|row| row.name.len()).max().unwrap_or(0);
        let mut out = String::new();
        for Row { name, value, .. } in &rows {
            out.push_str(&format!("{name:width$}  {value}\n"));
        }
        if !self.findings.is_empty() {
            out.push('\n');
        }
        for finding in &self.findings {
            out.push_str(&format!("{}: {}\n", finding.code, finding.detail));
        }
        out.push_str("\nview                              radial  tangential     pan deg    tilt deg\n");
        let unit = self.length_factor();
        let number = |value: Option<f64>, factor: f64| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{:.4}", value * factor))
        };
        for view in &self.views {
            out.push_str(&format!(
                "{:30}  {:>8}  {:>10}  {:>10}  {:>10}{}\n",
                view.name,
                number(view.radial_residual, unit),
                number(view.tangential_residual, unit),
                number(view.pan_residual_deg, 1.0),
                number(view.tilt_residual_deg, 1.0),
                if view.is_outlier { "  outlier" } else { "" }
            ));
        }
        out.push_str(&format!("\nlengths in {}; angles are residuals\n", self.length_name()));
        if let Some(not_checked) = &self.not_checked {
            out.push_str(&format!("{not_checked}\n"));
        }
        out
    }

    /// The report as a LaTeX table, for a paper.
    pub fn latex(&self) -> String {
        let mut out = String::from("\\begin{tabular}{lrr}\n\\hline\n & Mean & STD \\\\\n\\hline\n");
        for Row { name, value, pair } in self.rows() {
            let name = name.replace('%', "\\%");
            match pair {
                Some([mean, std]) => out.push_str(&format!("{name} & {mean} & {std} \\\\\n")),
                None => {
                    out.push_str(&format!("{name} & \\multicolumn{{2}}{{r}}{{{}}} \\\\\n", value.replace('%', "\\%")))
                }
            }
        }
        out.push_str("\\hline\n\\end{tabular}\n");
        if let Some(not_checked) = &self.not_checked {
            out.push_str(&format!("% {not_checked}\n"));
        }
        out
    }

    /// The quantities of table I.
    fn rows(&self) -> Vec<Row> {
        let single = |name: &str, value: String| Row { name: name.to_owned(), value, pair: None };
        let pair = |name: String, mean: String, std: String, more: String| Row {
            name,
            value: format!("{mean} +- {std}{more}"),
            pair: Some([mean, std]),
        };
        let expected = self.expected.map(|expected| format!(" of {expected}")).unwrap_or_default();
        let mut rows = vec![single("registered", format!("{}{expected}", self.registered))];
        if let Some(surface) = &self.surface {
            let kind = match surface.kind {
                SurfaceKind::Sphere => "radius of the sphere",
                SurfaceKind::Circle => "radius of the circle",
            };
            let (mean, std) = match self.scale.unit {
                LengthUnit::Mm => (format!("{:.3}", surface.mean_radius), format!("{:.3}", surface.std)),
                LengthUnit::Radius => ("1".to_owned(), format!("{:.6}", surface.std)),
            };
            let name = match self.scale.unit {
                LengthUnit::Mm => format!("{kind} (mm)"),
                LengthUnit::Radius => kind.to_owned(),
            };
            rows.push(pair(name, mean, std, String::new()));
            rows.push(single("STD of the radius (%)", format!("{:.4}", surface.std_percent)));
            rows.push(single("largest radial residual (%)", format!("{:.4}", 100.0 * surface.max / surface.radius)));
            rows.push(single("views used, rejected", format!("{}, {}", surface.used, surface.rejected)));
        }
        let mut steps = |name: &str, steps: &Option<StepReport>| {
            if let Some(StepReport { commanded_deg, mean_deg, std_deg, count }) = steps {
                let more = format!("  (commanded {commanded_deg}, {count} steps)");
                rows.push(pair(format!("{name} (deg)"), format!("{mean_deg:.4}"), format!("{std_deg:.4}"), more));
            }
        };
        steps("pan step", &self.pan_steps);
        steps("tilt step", &self.tilt_steps);
        steps("pan step of optical axes", &self.pan_steps_of_axes);
        steps("tilt step of optical axes", &self.tilt_steps_of_axes);
        let scale = match self.scale.source {
            ScaleSource::None => "none: lengths are shares of the radius",
            ScaleSource::KnownRadius => "the known radius",
            ScaleSource::ViewPair => "the known distance of two views",
        };
        rows.push(single("scale", scale.to_owned()));
        let px = |px: f64, sigma: Option<f64>| {
            format!("{px:.1} +- {}", sigma.map_or_else(|| "unknown".to_owned(), |sigma| format!("{sigma:.1}")))
        };
        if let Some(of) = &self.focal_length {
            let found = px(of.reconstruction_px, of.reconstruction_sigma_px);
            let camera = px(of.camera_px, of.camera_sigma_px);
            let value = format!("{found}, of the camera {camera} ({:+.2} %)", of.difference_percent);
            rows.push(single("focal length (px)", value));
        }
        if let Some(of) = &self.known_length {
            let value = format!(
                "{:.3}, on the object {:.3} ({:+.2} %)",
                of.reconstruction_mm, of.known_mm, of.difference_percent
            );
            rows.push(single("known length (mm)", value));
        }
        rows
    }

    /// Factor for lengths that are shown to people: in mm, or in percent of the radius.
    pub fn length_factor(&self) -> f64 {
        match self.scale.unit {
            LengthUnit::Mm => 1.0,
            LengthUnit::Radius => 100.0,
        }
    }

    /// The unit of lengths that are shown to people.
    pub fn length_name(&self) -> &'static str {
        match self.scale.unit {
            LengthUnit::Mm => "mm",
            LengthUnit::Radius => "percent of the radius",
        }
    }
}
