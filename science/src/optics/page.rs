//! A printable dot target: positions and sizes of the dots on a page, as SVG or PDF at true scale.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::{pdf, refused, require, svg};
use crate::{
    target::{CODE_VERSION, dot_size},
    types::Error,
};

pub use super::sheet::{PageDot, TargetPage};

/// Largest number of dots of a page.
const MOST_DOTS: u64 = 65_536;
/// Margin of a page of paper, mm: printers do not reach farther.
const MARGIN_MM: f64 = 10.0;
/// Height of the caption of a page of paper, mm.
const CAPTION_MM: f64 = 12.0;
/// Margin of a page that fits the target, pitches.
const FIT_MARGIN: f64 = 2.0;
/// Smallest and largest pitch, mm.
pub(super) const PITCH_MM: [f64; 2] = [0.01, 100.0];
/// Smallest and largest side of a page that PDF readers show, mm: 3 and 14,400 points of 1/72 inch.
const PDF_SIDE_MM: [f64; 2] = [3.0 / 72.0 * 25.4, 14_400.0 / 72.0 * 25.4];
/// Lengths of the check line, mm: the longest that fits is drawn.
const CHECK_LINES_MM: [f64; 4] = [200.0, 100.0, 50.0, 20.0];

/// What is printed: the query parameters of `GET /v1/targets/dots`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct TargetInput {
    /// Distance of neighbouring dots, mm, 0.01 to 100.
    #[param(example = 2.0)]
    pub pitch_mm: f64,
    /// Number of columns, 2 to 1000.
    #[param(example = 14)]
    pub columns: u32,
    /// Number of rows, 2 to 1000; at most 65,536 dots in all.
    #[param(example = 10)]
    pub rows: u32,
    /// Dots of two sizes, which make every dot unique; default false.
    #[serde(default)]
    #[param(required = false)]
    pub coded: bool,
    /// Diameter of a dot over the pitch, 0.2 to 0.8; of a coded target the nominal diameter, 0.2 to 0.7. Default 0.5.
    #[serde(default = "half")]
    #[param(required = false)]
    pub dot_ratio: f64,
    /// White dots on black; default false.
    #[serde(default)]
    #[param(required = false)]
    pub inverted: bool,
    /// Size of the page; default `a4`.
    #[serde(default)]
    #[param(required = false, inline)]
    pub paper: Paper,
    /// File format; default `pdf`.
    #[serde(default)]
    #[param(required = false, inline)]
    pub format: PageFormat,
}

fn half() -> f64 {
    0.5
}

/// Size of a page.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Paper {
    /// 210 x 297 mm, upright or on its side, with a caption and a line of known length.
    #[default]
    A4,
    /// 8.5 x 11 inches, upright or on its side, with a caption and a line of known length.
    Letter,
    /// The size of the target with a margin of two pitches, without a caption: for photo services.
    Fit,
}

/// File format of a target.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PageFormat {
    /// PDF 1.7 with vector circles.
    #[default]
    Pdf,
    /// SVG in millimetres.
    Svg,
}

impl TargetPage {
    /// Lays out a target.
    ///
    /// # Errors
    /// [`crate::types::ErrorKind::InvalidParameter`] with the parameter: a number outside its range, more than 65,536
    /// dots, dots that would touch, a grid that does not fit on the paper (with the number of dots that do), or a PDF
    /// page that is too small or too large for PDF readers.
    ///
    /// # Example
    /// ```
    /// use pinstack_science::optics::page::{TargetInput, TargetPage};
    ///
    /// let input = r#"{ "pitch_mm": 2, "columns": 14, "rows": 10, "coded": true }"#;
    /// let input: TargetInput = serde_json::from_str(input)?;
    /// let page = TargetPage::new(&input)?;
    /// assert_eq!((page.dots.len(), page.width), (140, 210.0));
    /// assert!(page.pdf().starts_with(b"%PDF-"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn new(input: &TargetInput) -> Result<Self, Error> {
        let [finest, coarsest] = PITCH_MM;
        require("pitch_mm", input.pitch_mm, finest, coarsest)?;
        require("columns", f64::from(input.columns), 2.0, 1000.0)?;
        require("rows", f64::from(input.rows), 2.0, 1000.0)?;
        // two large dots of a code beside each other leave a gap
        require("dot_ratio", input.dot_ratio, 0.2, if input.coded { 0.7 } else { 0.8 })?;
        let count = u64::from(input.columns) * u64::from(input.rows);
        if count > MOST_DOTS {
            return Err(refused("columns", format!("columns x rows is {count}; at most {MOST_DOTS} dots are printed")));
        }
        let grid = [input.columns, input.rows].map(|n| f64::from(n - 1) * input.pitch_mm);
        let [width, height] = page_size(input, grid)?;
        let area = match input.paper {
            Paper::Fit => height,
            Paper::A4 | Paper::Letter => height - CAPTION_MM,
        };
        let first = [(width - grid[0]) / 2.0, (area - grid[1]) / 2.0];
        let diameter = |column: u32, row: u32| {
            let code = if input.coded { dot_size(column.into(), row.into()).factor() } else { 1.0 };
            input.dot_ratio * input.pitch_mm * code
        };
        let dots = (0..input.rows).flat_map(|row| (0..input.columns).map(move |column| (column, row)));
        let dots = dots.map(|(column, row)| PageDot {
            x: first[0] + f64::from(column) * input.pitch_mm,
            y: first[1] + f64::from(row) * input.pitch_mm,
            diameter: diameter(column, row),
        });
        let title = title(input);
        let has_caption = input.paper != Paper::Fit;
        let length = CHECK_LINES_MM.into_iter().find(|length| *length <= width - 2.0 * MARGIN_MM);
        let check_line = length.filter(|_| has_caption).map(|length| [MARGIN_MM, length, height - MARGIN_MM]);
        let caption = match check_line {
            Some([_, length, _]) => {
                vec![
                    title.clone(),
                    format!("Print at 100 % (actual size). The line below is {length} mm long: measure it."),
                ]
            }
            None => Vec::new(),
        };
        Ok(Self {
            width,
            height,
            dots: dots.collect(),
            inverted: input.inverted,
            title,
            caption,
            caption_at: [MARGIN_MM, height - MARGIN_MM - CAPTION_MM + 5.0],
            check_line,
        })
    }

    /// The page as SVG, in millimetres.
    pub fn svg(&self) -> String {
        svg::write(self)
    }

    /// The page as PDF, at true scale.
    pub fn pdf(&self) -> Vec<u8> {
        pdf::write(self)
    }
}

fn title(input: &TargetInput) -> String {
    let code = if input.coded { format!(", coded (version {CODE_VERSION})") } else { String::new() };
    format!(
        "pinstack dot target: {} x {} dots, pitch {} mm, dots {:.4} mm{code}",
        input.columns,
        input.rows,
        input.pitch_mm,
        input.dot_ratio * input.pitch_mm
    )
}

/// Width and height of the page, mm.
fn page_size(input: &TargetInput, grid: [f64; 2]) -> Result<[f64; 2], Error> {
    let upright = match input.paper {
        Paper::Fit => {
            let page = fit_page(input.pitch_mm, [input.columns, input.rows]);
            if input.format == PageFormat::Pdf && !suits_pdf(page) {
                let ([width, height], [least, most]) = (page, PDF_SIDE_MM);
                let detail = format!(
                    "paper=fit gives a page of {width:.2} x {height:.2} mm, and PDF readers show sides of {least:.2} \
                     to {most:.0} mm; choose format=svg, another pitch or another number of dots"
                );
                return Err(refused("paper", detail));
            }
            return Ok(page);
        }
        Paper::A4 => [210.0, 297.0],
        Paper::Letter => [215.9, 279.4],
    };
    let room = |page: [f64; 2]| [page[0] - 2.0 * MARGIN_MM, page[1] - 2.0 * MARGIN_MM - CAPTION_MM];
    let pages = [upright, [upright[1], upright[0]]];
    let fits = |page: &[f64; 2]| (0..2).all(|axis| grid[axis] + input.pitch_mm <= room(*page)[axis]);
    if let Some(page) = pages.into_iter().find(fits) {
        return Ok(page);
    }
    // of what was asked for, as much as fits on the page, upright or on its side
    let fitting = |page: [f64; 2]| {
        let [across, down] = room(page).map(|side| {
            let n = (side / input.pitch_mm).floor();
            // a division that is rounded up gives one too many
            if (n - 1.0) * input.pitch_mm + input.pitch_mm <= side { n } else { n - 1.0 }
        });
        [across.min(input.columns.into()), down.min(input.rows.into())]
    };
    let is_grid = |dots: &[f64; 2]| dots.iter().all(|n| *n >= 2.0);
    let most = pages.map(fitting).into_iter().filter(is_grid).max_by(|a, b| (a[0] * a[1]).total_cmp(&(b[0] * b[1])));
    let what = match most {
        Some([columns, rows]) => format!("{columns} x {rows} do; choose fewer dots, a smaller pitch, or paper=fit"),
        None => "no grid of this pitch fits on the page; choose a smaller pitch or paper=fit".to_owned(),
    };
    let detail = format!(
        "{} x {} dots with a pitch of {} mm do not fit on the page; {what}",
        input.columns, input.rows, input.pitch_mm
    );
    Err(refused("columns", detail))
}

/// Width and height of the page that fits a target, mm.
fn fit_page(pitch_mm: f64, dots: [u32; 2]) -> [f64; 2] {
    dots.map(|n| f64::from(n.saturating_sub(1)) * pitch_mm + 2.0 * FIT_MARGIN * pitch_mm)
}

/// Whether PDF readers show a page of this size, mm.
fn suits_pdf(page: [f64; 2]) -> bool {
    let [least, most] = PDF_SIDE_MM;
    page.iter().all(|side| (least..=most).contains(side))
}

/// The file format for a page that fits a target: PDF if readers show it.
pub(super) fn format_of_fit(pitch_mm: f64, dots: [u32; 2]) -> PageFormat {
    if suits_pdf(fit_page(pitch_mm, dots)) { PageFormat::Pdf } else { PageFormat::Svg }
}

#[cfg(test)]
mod tests;
