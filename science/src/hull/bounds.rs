//! Where the object is in space, from the masks alone.

use nalgebra::{Matrix3, Vector3};

use super::{
    octree::{Grid, Octree},
    silhouette::Silhouette,
};
use crate::types::{Error, error::ErrorKind};

/// Half of the side of the first cube, as a share of the distance to the nearest camera: no corner of it is behind a
/// camera.
const FIRST_SHARE: f64 = 0.55;
/// How often the box is made tighter, and into how many cells each way it is divided for that.
const ROUNDS: usize = 3;
const CELLS: f64 = 256.0;
/// Least angle between rays through the middles of two masks, as the smallest eigenvalue of their normal equations.
const LEAST_SPREAD: f64 = 1e-3;

/// A cube around the hull: its middle, and the longest side of the box of the hull.
///
/// # Errors
/// [`ErrorKind::InvalidPoses`] when all views look the same way, and when nothing is within the silhouettes.
pub(super) fn bounds(silhouettes: &[Silhouette], tolerated: usize) -> Result<([f64; 3], f64), Error> {
    let mut middle = nearest_to_rays(silhouettes)?;
    let distance = |silhouette: &Silhouette| (Vector3::from(silhouette.camera.centre) - Vector3::from(middle)).norm();
    let nearest = silhouettes.iter().map(distance).fold(f64::INFINITY, f64::min);
    let mut longest = 2.0 * FIRST_SHARE * nearest;
    for _ in 0..ROUNDS {
        let octree = Octree { silhouettes, grid: Grid::around(middle, longest, longest / CELLS) };
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for part in octree.parts(tolerated) {
            let [first, end] = octree.corners(&part);
            low = [0, 1, 2].map(|axis| low[axis].min(first[axis]));
            high = [0, 1, 2].map(|axis| high[axis].max(end[axis]));
        }
        let sides = [0, 1, 2].map(|axis| high[axis] - low[axis]);
        if sides[0] < 0.0 {
            return Err(nothing());
        }
        middle = [0, 1, 2].map(|axis| (low[axis] + high[axis]) / 2.0);
        longest = sides.into_iter().fold(0.0, f64::max);
    }
    Ok((middle, longest))
}

/// The error of masks and poses that contradict each other.
pub(super) fn nothing() -> Error {
    Error::new(
        ErrorKind::InvalidPoses,
        "no part of space is within all silhouettes: the poses do not belong to these masks, or a mask shows something \
         else; check the order and the names of the masks, or tolerate more views",
    )
}

/// The point nearest to the rays through the middles of the masks, by least squares.
fn nearest_to_rays(silhouettes: &[Silhouette]) -> Result<[f64; 3], Error> {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for silhouette in silhouettes {
        let direction = Vector3::from(silhouette.camera.direction(silhouette.middle)).normalize();
        let across = Matrix3::identity() - direction * direction.transpose();
        normal += across;
        right += across * Vector3::from(silhouette.camera.centre);
    }
    let normal = normal / silhouettes.len().max(1) as f64;
    let spread = normal.symmetric_eigenvalues().min();
    let solved = normal.try_inverse().filter(|_| spread > LEAST_SPREAD);
    let point = solved.map(|inverse| inverse * right / silhouettes.len() as f64);
    point.map(Into::into).ok_or_else(|| {
        Error::new(
            ErrorKind::InvalidPoses,
            "all views look the same way, so the masks say nothing about depth; add views from other directions",
        )
    })
}
