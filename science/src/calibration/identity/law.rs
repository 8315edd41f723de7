//! Labels that the fingerprint leaves open, confirmed by the motion of the other slices.
//!
//! The shift of the image is linear in its scale along a straight rail. Where at least four slices have certain labels,
//! the line through them predicts where the grid of another slice lies. A slice that lies there has the right labels:
//! an error by a whole step would put it elsewhere.

use nalgebra::{DMatrix, DVector};

use super::super::detection::Detection;
use super::Fingerprint;

/// Fewest slices with certain labels.
const MIN_CERTAIN: usize = 4;
/// Largest distance from the prediction, and largest uncertainty of the prediction, grid steps.
const NEAR: f64 = 0.15;
/// Standard deviations of the prediction that must be below [`NEAR`].
const SIGMAS: f64 = 3.0;

/// Per slice: true when its labels are in doubt and its place confirms them.
pub(super) fn confirmed(detections: &[Option<Detection>], in_doubt: &[bool]) -> Vec<bool> {
    let print = |i: usize| detections[i].as_ref().and_then(|d| d.fingerprint.as_ref());
    let certain: Vec<usize> = (0..detections.len()).filter(|&i| !in_doubt[i] && print(i).is_some()).collect();
    let mut out = vec![false; detections.len()];
    let Some(base) = certain.first().and_then(|&i| print(i)) else { return out };
    if certain.len() < MIN_CERTAIN {
        return out;
    }
    let motions: Vec<Option<([f64; 2], f64)>> =
        (0..detections.len()).map(|i| print(i).and_then(|print| motion(print, base))).collect();
    let known: Vec<([f64; 2], f64)> = certain.iter().filter_map(|&i| motions[i]).collect();
    let Some(line) = Line::fit(&known) else { return out };
    for i in (0..detections.len()).filter(|&i| in_doubt[i]) {
        if let Some((shift, scale)) = motions[i] {
            let (at, sigma) = line.predict(scale);
            let off = (shift[0] - at[0]).hypot(shift[1] - at[1]);
            out[i] = SIGMAS * sigma < NEAR * base.pitch && off < NEAR * base.pitch;
        }
    }
    out
}

/// Shift, px, of the middle of the grid of `base` in the slice of `print`, and the scale there.
fn motion(print: &Fingerprint, base: &Fingerprint) -> Option<([f64; 2], f64)> {
    let middle =
        [f64::from(base.origin[0]) + base.columns as f64 / 2.0, f64::from(base.origin[1]) + base.rows as f64 / 2.0];
    let (here, there) = (print.to_slice.apply(middle), base.to_slice.apply(middle));
    let scale = print.to_slice.scale_at(middle) / base.to_slice.scale_at(middle);
    scale.is_finite().then(|| ([here[0] - there[0], here[1] - there[1]], scale))
}

/// A line of the shift over the scale.
struct Line {
    /// Intercept and slope per coordinate.
    numbers: [[f64; 2]; 2],
    /// Inverse of the normal matrix.
    inverse: DMatrix<f64>,
    /// Standard deviation of a slice about the line, px.
    scatter: f64,
    middle: f64,
}

impl Line {
    fn fit(known: &[([f64; 2], f64)]) -> Option<Self> {
        if known.len() < MIN_CERTAIN {
            return None;
        }
        let middle = known.iter().map(|k| k.1).sum::<f64>() / known.len() as f64;
        let rows = DMatrix::from_fn(known.len(), 2, |k, c| if c == 0 { 1.0 } else { known[k].1 - middle });
        let inverse = (rows.transpose() * &rows).try_inverse()?;
        let (mut left, mut numbers) = (0.0, [[0.0; 2]; 2]);
        for (axis, numbers) in numbers.iter_mut().enumerate() {
            let values = DVector::from_iterator(known.len(), known.iter().map(|k| k.0[axis]));
            let solved = &inverse * rows.transpose() * &values;
            left += (&values - &rows * &solved).norm_squared();
            *numbers = [solved[0], solved[1]];
        }
        let scatter = (left / (2.0 * known.len() as f64 - 4.0)).sqrt();
        Some(Self { numbers, inverse, scatter, middle })
    }

    /// Predicted shift at a scale, px, and its standard deviation.
    fn predict(&self, scale: f64) -> ([f64; 2], f64) {
        let row = DVector::from_column_slice(&[1.0, scale - self.middle]);
        let leverage = (row.transpose() * &self.inverse * &row)[(0, 0)];
        let at = self.numbers.map(|[intercept, slope]| intercept + slope * (scale - self.middle));
        (at, self.scatter * (1.0 + leverage).sqrt())
    }
}
