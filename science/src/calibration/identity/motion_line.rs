//! Labels that the fingerprint leaves open, confirmed by the motion of the other slices.
//!
//! The shift of the image is linear in its scale along a straight rail. Where at least four slices have certain labels,
//! the line through them predicts where the grid of another slice lies. A slice that lies there has the right labels:
//! an error by a whole step would put it elsewhere.

use super::fingerprint::Fingerprint;
use crate::calibration::detected::Detection;
use crate::calibration::line_fit::{Line, Point};

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
    let motions: Vec<Option<([f64; 2], f64)>> =
        (0..detections.len()).map(|i| print(i).and_then(|print| motion(print, base))).collect();
    let known: Vec<([f64; 2], f64)> = certain.iter().filter_map(|&i| motions[i]).collect();
    if known.len() < MIN_CERTAIN {
        return out;
    }
    let middle = known.iter().map(|k| k.1).sum::<f64>() / known.len() as f64;
    let points: Vec<Point<2>> =
        known.iter().map(|(shift, scale)| Point { slice: 0, z: scale - middle, at: *shift }).collect();
    let Some(line) = Line::fit(&points, None) else { return out };
    for i in (0..detections.len()).filter(|&i| in_doubt[i]) {
        if let Some((shift, scale)) = motions[i] {
            let (at, sigma) = line.predict(i, scale - middle);
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
