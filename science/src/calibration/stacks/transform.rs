//! Transforms between slices, in units: matrices, and derivatives by the place.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::transform_models::{Frame, Parameters, jacobian, map_point};
use crate::types::Homography;

/// Derivatives of [`map_point`] with respect to the point, one row per coordinate.
pub(super) fn derivatives(p: &Parameters, at: [f64; 2]) -> [[f64; 2]; 2] {
    let w = p[6] * at[0] + p[7] * at[1] + 1.0;
    let [u, v] = map_point(p, at);
    [[(1.0 + p[0] - u * p[6]) / w, (p[1] - u * p[7]) / w], [(p[3] - v * p[6]) / w, (1.0 + p[4] - v * p[7]) / w]]
}

/// How a place in the second slice moves with the parameters of the first slice, with the opposite sign.
pub(super) fn through(to: &Parameters, from: &Parameters, base: [f64; 2]) -> [Parameters; 2] {
    let (d, f) = (derivatives(to, base), derivatives(from, base));
    let determinant = f[0][0] * f[1][1] - f[0][1] * f[1][0];
    let inverse = [[f[1][1] / determinant, -f[0][1] / determinant], [-f[1][0] / determinant, f[0][0] / determinant]];
    let product = [0, 1].map(|r| [0, 1].map(|c| d[r][0] * inverse[0][c] + d[r][1] * inverse[1][c]));
    let rows = jacobian(from, base);
    [0, 1].map(|r| std::array::from_fn(|k| product[r][0] * rows[0][k] + product[r][1] * rows[1][k]))
}

/// A transform as a matrix, units.
pub(super) fn matrix(p: &Parameters) -> Matrix3<f64> {
    Matrix3::new(1.0 + p[0], p[1], p[2], p[3], 1.0 + p[4], p[5], p[6], p[7], 1.0)
}

/// The image of a place under a matrix.
pub(super) fn projected(matrix: &Matrix3<f64>, at: [f64; 2]) -> [f64; 2] {
    let v = matrix * Vector3::new(at[0], at[1], 1.0);
    [v[0] / v[2], v[1] / v[2]]
}

/// The parameters of the map reference slice -> slice whose inverse is this homography, px; `None` if it is singular.
pub(super) fn of_homography(homography: &Homography, frame: &Frame) -> Option<Parameters> {
    let [x, y] = frame.centre;
    let to_pixel = Matrix3::new(frame.half, 0.0, x, 0.0, frame.half, y, 0.0, 0.0, 1.0);
    Some(parameters(&(to_pixel.try_inverse()? * homography.matrix().try_inverse()? * to_pixel)))
}

/// The parameters of a matrix.
pub(super) fn parameters(m: &Matrix3<f64>) -> Parameters {
    let m = m / m[(2, 2)];
    [m[(0, 0)] - 1.0, m[(0, 1)], m[(0, 2)], m[(1, 0)], m[(1, 1)] - 1.0, m[(1, 2)], m[(2, 0)], m[(2, 1)]]
}
