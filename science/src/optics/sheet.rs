//! A page with a dot target: where each dot, the caption and the check line are.

/// A dot on the page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PageDot {
    /// Distance from the left edge, mm.
    pub x: f64,
    /// Distance from the upper edge, mm.
    pub y: f64,
    /// Diameter, mm.
    pub diameter: f64,
}

/// A page with a dot target.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetPage {
    /// Width, mm.
    pub width: f64,
    /// Height, mm.
    pub height: f64,
    /// The dots, row by row.
    pub dots: Vec<PageDot>,
    /// White dots on black.
    pub inverted: bool,
    /// What it is, in one line.
    pub title: String,
    /// Lines of text below the dots; empty on a page that fits the target.
    pub caption: Vec<String>,
    /// Where the first line of text begins: distances from the left and the upper edge, mm.
    pub caption_at: [f64; 2],
    /// A line of known length: left end, length and distance from the upper edge, mm.
    pub check_line: Option<[f64; 3]>,
}
