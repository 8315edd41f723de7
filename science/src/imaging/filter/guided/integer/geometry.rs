//! What a pass hands to the fit of coefficients: its rectangles, and the buffers of a row.

use crate::imaging::{
    Rect,
    filter::guided::{constant_regions::MapValue, window::Padding},
};

/// Coefficients of the windows centred on a row.
#[derive(Debug, Default)]
pub(super) struct Lines {
    pub(super) a: Vec<u32>,
    pub(super) b: Vec<u32>,
    pub(super) values: Vec<MapValue>,
}

/// The rectangles of a pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Geometry {
    /// Pixels of the results.
    pub(super) inner: Rect,
    /// Centres of the windows whose coefficients are averaged.
    pub(super) centres: Rect,
    /// Pixels in those windows.
    pub(super) taps: Rect,
    pub(super) fit_pad: Padding,
    pub(super) mean_pad: Padding,
    /// Whether all pixels of `taps` are valid.
    pub(super) whole: bool,
}
