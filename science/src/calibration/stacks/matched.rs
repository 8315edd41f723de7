//! What registration hands on: windows that two slices of a view share.

use nalgebra::Matrix2;

/// A window in two slices of one view, in units (see [`super::super::transform_models`]).
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowMatch {
    /// Its middle in the first slice.
    pub first: [f64; 2],
    /// Its middle in the second slice.
    pub second: [f64; 2],
    /// Inverse of the covariance of the distance between the two.
    pub information: Matrix2<f64>,
    /// Index of the cell of the first slice around its middle.
    pub cell: u32,
}

/// Two slices of one view with the windows that they share.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    /// 0-based index of the view.
    pub view: usize,
    /// Indices of the slices; the first is the lower one.
    pub slices: [usize; 2],
    /// The windows.
    pub windows: Vec<WindowMatch>,
    /// `ln` of the brightness of the second slice over that of the first, with its standard deviation; `None` where no
    /// cell shows it.
    pub brightness: Option<[f64; 2]>,
}
