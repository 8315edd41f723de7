//! The height map: per pixel, the height of the surface with a precision finer than the step between slices.
//!
//! In: the warped slices of the first pass and the index of the second. Out: a [`HeightMap`]. The steps, in order of
//! execution:
//!
//! 1. [`coarse_statistics`] samples the stack: focus energy of noise, and how many slices a focus curve is wide.
//! 2. [`estimate`] fits the focus curve of each pixel ([`curve`]) around the slice of the index, tile by tile.
//! 3. [`regularise`] averages estimates of the same surface, weighted by their confidence, and fills gaps from
//!    reliable neighbours.
//! 4. [`map`] converts positions to heights ([`axis`]) and encodes them.
//!
//! Positions are counted in mean steps of the rail, or in slices if the rail positions are unknown: the blur radius is
//! linear in both.

pub mod axis;
mod coarse_statistics;
mod curve;
mod energy;
mod estimate;
mod estimates;
mod map;
mod regularise;
pub mod relief;

#[cfg(test)]
mod tests;

pub use map::{HeightMap, INVALID};

use super::{align::Aligned, plan::Plan, run::Run};
use crate::{imaging::Sample, types::Interrupted};

/// Bytes per pixel of the canvas that [`measure`] holds: two planes of floats, the map, and the best estimate of each
/// cell of 4 x 4 px.
pub(super) const BYTES_PER_PIXEL: u64 = 4 + 4 + 4 + 1;

/// Measures the height map of an aligned stack; `None` if the plan does not ask for it.
///
/// Outside the silhouette of the request no height is valid.
pub(super) fn measure<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &Aligned,
) -> Result<Option<HeightMap>, Interrupted> {
    let Some(axis) = &run.plan.height_map else { return Ok(None) };
    let positions = positions(run.plan);
    let statistics = coarse_statistics::measure::<S, C>(run, aligned)?;
    let raw = estimate::estimate::<S, C>(run, aligned, &positions, &statistics)?;
    let refined = run.plan.method.refines_the_index();
    let regular = regularise::Regularisation::new(&raw, &aligned.index, refined, &positions);
    Ok(Some(map::HeightMap::of(run, axis, &positions, &regular)?))
}

/// Position of each slice in mean steps, increasing, 0 in the first slice.
fn positions(plan: &Plan) -> Vec<f64> {
    let count = plan.slices.len();
    let by_rail = plan.rail_mm().filter(|rail| count > 1 && axis::monotone(rail)).map(|rail| {
        let step = (rail[count - 1] - rail[0]) / (count - 1) as f64;
        rail.iter().map(|z| (z - rail[0]) / step).collect()
    });
    by_rail.unwrap_or_else(|| (0..count).map(|i| i as f64).collect())
}
