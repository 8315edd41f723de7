//! The least-squares line of `D` coordinates over a position, with at most one step.

use nalgebra::{DMatrix, DVector};

/// A slice, its position, and its coordinates there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point<const D: usize> {
    /// Index of the slice, which tells the side of the step.
    pub slice: usize,
    /// Position.
    pub z: f64,
    /// Coordinates.
    pub at: [f64; D],
}

/// The line.
pub(super) struct Line<const D: usize> {
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Per coordinate: value at position 0, slope, and step.
    numbers: [DVector<f64>; D],
    /// The first slice after the step, and its size.
    pub step: Option<(usize, [f64; D])>,
    /// Sum of the squared residuals.
    pub left: f64,
    /// Standard deviation of the residuals per coordinate.
    pub scatter: f64,
    /// Residuals that are free.
    pub freedom: f64,
}

fn row(slice: usize, z: f64, cut: Option<usize>) -> Vec<f64> {
    let step = cut.map(|cut| f64::from(u8::from(slice >= cut)));
    [1.0, z].into_iter().chain(step).collect()
}

impl<const D: usize> Line<D> {
    /// The line with a step at slice `cut`. `None` when the points do not determine it and its scatter.
    pub(super) fn fit(points: &[Point<D>], cut: Option<usize>) -> Option<Self> {
        let unknowns = 2 + usize::from(cut.is_some());
        let freedom = (D * points.len()).checked_sub(D * unknowns).filter(|free| *free > 0)? as f64;
        let values = points.iter().flat_map(|p| row(p.slice, p.z, cut));
        let rows = DMatrix::from_row_iterator(points.len(), unknowns, values);
        let inverse = (rows.transpose() * &rows).try_inverse()?;
        let mut left = 0.0;
        let numbers: [DVector<f64>; D] = std::array::from_fn(|a| {
            let values = DVector::from_iterator(points.len(), points.iter().map(|p| p.at[a]));
            let numbers = &inverse * rows.transpose() * &values;
            left += (&values - &rows * &numbers).norm_squared();
            numbers
        });
        let step = cut.map(|cut| (cut, std::array::from_fn(|a| numbers[a][2])));
        Some(Self { inverse, numbers, step, left, scatter: (left / freedom).sqrt(), freedom })
    }

    /// Where a slice at position `z` should be, and the standard deviation there, per coordinate.
    pub(super) fn predict(&self, slice: usize, z: f64) -> ([f64; D], f64) {
        let row = DVector::from_vec(row(slice, z, self.step.map(|step| step.0)));
        let leverage = (row.transpose() * &self.inverse * &row)[(0, 0)];
        (std::array::from_fn(|a| self.numbers[a].dot(&row)), self.scatter * (1.0 + leverage).sqrt())
    }
}
