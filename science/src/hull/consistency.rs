//! Views whose mask contradicts the others: a wrong mask or a wrong pose, which would carve away part of the object.
//!
//! A coarse hull is made that [`TOLERATED`] views may contradict at each point. A good view then sees little of its
//! surface outside of its mask; a bad one sees a large share of it there (silhouette coherence: Hernandez, Schmitt and
//! Cipolla 2007).

use super::{
    bounds::bounds,
    octree::{Grid, Octree},
    silhouette::Silhouette,
    surface::surface,
};
use crate::types::Error;

/// Views that may contradict a point of the coarse hull.
const TOLERATED: usize = 2;
/// Cells along the longest side of the coarse hull.
const CELLS: f64 = 64.0;
/// Distance from the outline up to which a vertex is not outside, px, beside a cell.
const MARGIN_PX: f64 = 2.0;
/// Share of the vertices outside of a mask from which the view is bad.
const LARGE_SHARE: f64 = 0.02;
/// Fewest views with which they are compared.
const LEAST_VIEWS: usize = 8;
/// Most bad views, as a share of all: more of them are no exception but poses that do not fit.
const MOST_BAD: f64 = 0.25;

/// Which silhouettes are bad; none if there are too few views to tell, or too many bad ones.
///
/// # Errors
/// Those of [`bounds`].
pub(super) fn bad_views(silhouettes: &[Silhouette]) -> Result<Vec<bool>, Error> {
    let none = vec![false; silhouettes.len()];
    if silhouettes.len() < LEAST_VIEWS {
        return Ok(none);
    }
    let (middle, longest) = bounds(silhouettes, TOLERATED)?;
    let cell = longest / CELLS;
    let octree = Octree { silhouettes, grid: Grid::around(middle, longest + 4.0 * cell, cell) };
    let vertices = surface(&octree, &octree.parts(TOLERATED)).positions;
    let share = |silhouette: &Silhouette| {
        let camera = &silhouette.camera;
        let is_outside = |point: &&[f32; 3]| match camera.project(point.map(f64::from)) {
            Some((px, depth)) => f64::from(silhouette.signed(px)) < -(MARGIN_PX + cell * camera.focal_px[0] / depth),
            None => true,
        };
        vertices.iter().filter(is_outside).count() as f64 / vertices.len().max(1) as f64
    };
    let bad: Vec<bool> = silhouettes.iter().map(|silhouette| share(silhouette) > LARGE_SHARE).collect();
    let count = bad.iter().filter(|bad| **bad).count();
    Ok(if count as f64 > MOST_BAD * silhouettes.len() as f64 { none } else { bad })
}
