//! Measures the defocus model of a stack in the stack itself: neither the aperture nor the pixel pitch is given.
//!
//! In: the sharpest slice per pixel, where there is texture, and what the profile knows of the rail and the direction.
//! Out: a [`DefocusModel`]. Its blur radius per step is the median over blocks of dense texture, and its direction that
//! of the outlines ([`depth_order`]).

use rayon::prelude::*;

use super::{
    defocus_model::{DefocusModel, positions},
    depth_order,
    warped_slices::WarpedSlices,
};
use crate::{
    imaging::{Plane, Rect, Sample, filter::disc::Disc},
    types::Interrupted,
};

/// Sides of the blocks in which blur is measured, px. Smaller blocks are used where the larger ones give too few
/// estimates: in a thicket no part is large.
const BLOCK_SIDES: [usize; 3] = [64, 32, 20];
/// Number of blocks that are measured, at most.
const MAX_BLOCKS: usize = 24;
/// Number of estimates that are needed.
const MIN_ESTIMATES: usize = 4;
/// Share of the pixels of a block that must have texture and be sharpest in one slice, give or take one: 9 / 10.
const BLOCK_MAJORITY: (usize, usize) = (9, 10);

/// Radii that are tried, px: `SMALLEST * RATIO^k` for `k` below `RADII`.
const SMALLEST: f32 = 0.7;
const RATIO: f32 = 1.35;
const RADII: usize = 12;

/// Measures the blur in dense texture and the direction at depth steps. The direction of the profile, `near_first`,
/// is followed.
///
/// `map` is the sharpest slice per pixel, `textured` is where its focus energy is more than noise, `rail` are the
/// positions of the slices in any unit.
pub(super) fn measure<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &Plane<u16>,
    textured: &Plane<bool>,
    rail: Option<&[f64]>,
    near_first: Option<bool>,
) -> Result<DefocusModel, Interrupted> {
    let positions = positions(slices.count(), rail);
    let radius_per_step = radius_per_step(slices, map, textured, &positions)?;
    let decreasing = positions.first() > positions.last();
    let by_profile = near_first.map(|near_first| near_first != decreasing);
    let mut model =
        DefocusModel { positions, radius_per_step, increasing_depth: by_profile, contradicts_profile: false };
    if radius_per_step <= 0.0 {
        return Ok(model);
    }
    let votes = depth_order::votes(slices, map, textured, &model)?;
    match by_profile {
        None => model.increasing_depth = votes.decision(&depth_order::DECISIVE),
        Some(given) => model.contradicts_profile = votes.decision(&depth_order::CONTRADICTING) == Some(!given),
    }
    Ok(model)
}

/// Blur radius per step, px: the median over blocks of dense texture. 0 when too few blocks give an estimate.
fn radius_per_step<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &Plane<u16>,
    textured: &Plane<bool>,
    positions: &[f32],
) -> Result<f32, Interrupted> {
    for side in BLOCK_SIDES {
        let mut estimates = estimates(slices, &blocks(map, textured, side, positions.len()), positions)?;
        estimates.sort_by(f32::total_cmp);
        if estimates.len() >= MIN_ESTIMATES {
            return Ok(estimates[estimates.len() / 2]);
        }
    }
    Ok(0.0)
}

/// Estimates of the blur radius per step: from each block, one per slice near in focus.
fn estimates<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    blocks: &[(Rect, usize)],
    positions: &[f32],
) -> Result<Vec<f32>, Interrupted> {
    let stride = blocks.len().div_ceil(MAX_BLOCKS).max(1);
    let neighbours: &[isize] = if positions.len() < 6 { &[-2, -1, 1, 2] } else { &[-3, -2, 2, 3] };
    let estimates: Vec<Vec<f32>> = blocks
        .par_iter()
        .step_by(stride)
        .map(|&(block, slice)| -> Result<Vec<f32>, Interrupted> {
            let mut estimates = Vec::new();
            for other in neighbours.iter().filter_map(|&step| slice.checked_add_signed(step)) {
                let steps = positions.get(other).map_or(0.0, |position| (position - positions[slice]).abs());
                if steps > 0.0
                    && let Some(radius) = radius_between(slices, block, slice, other)?
                {
                    estimates.push(radius / steps);
                }
            }
            Ok(estimates)
        })
        .collect::<Result<_, Interrupted>>()?;
    Ok(estimates.concat())
}

/// Blocks of `side` px, half overlapping, that are textured and sharpest in one slice, with that slice.
fn blocks(map: &Plane<u16>, textured: &Plane<bool>, side: usize, slices: usize) -> Vec<(Rect, usize)> {
    let along = |length: usize| (0..(length + 1).saturating_sub(side)).step_by(side / 2);
    let rows: Vec<usize> = along(map.height).collect();
    let of_row = |&y: &usize| -> Vec<(Rect, usize)> {
        let of_block = |x| {
            let block = Rect { x, y, width: side, height: side };
            Some((block, slice_of(map, textured, block, slices)?))
        };
        along(map.width).filter_map(of_block).collect()
    };
    rows.par_iter().map(of_row).collect::<Vec<_>>().concat()
}

/// The slice in which `block` is sharpest; none when it has too little texture or spans more than three slices.
fn slice_of(map: &Plane<u16>, textured: &Plane<bool>, block: Rect, slices: usize) -> Option<usize> {
    let (rows, columns) = (block.y..block.y + block.height, block.x..block.x + block.width);
    let pixels = block.width * block.height;
    let enough = pixels * BLOCK_MAJORITY.0 / BLOCK_MAJORITY.1;
    let with_texture: usize = rows
        .clone()
        .map(|y| textured.row(y)[columns.clone()].iter().map(|&textured| usize::from(textured)).sum::<usize>())
        .sum();
    if with_texture < enough {
        return None;
    }
    let mut counts = vec![0; slices];
    for &slice in rows.flat_map(|y| &map.row(y)[columns.clone()]) {
        // uncovered pixels have no count
        counts.get_mut(usize::from(slice)).into_iter().for_each(|count| *count += 1);
    }
    let mut below = 0;
    let median = counts.iter().position(|count| {
        below += count;
        below > pixels / 2
    })?;
    let alike: usize = counts[median.saturating_sub(1)..(median + 2).min(slices)].iter().sum();
    (alike >= enough).then_some(median)
}

/// The blur radius, px, that makes slice `sharp` look most like slice `other` within `block`: the minimum of the
/// squared difference over the radii, refined by a parabola. None when the minimum is at either end of the radii.
fn radius_between<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    block: Rect,
    sharp: usize,
    other: usize,
) -> Result<Option<f32>, Interrupted> {
    let largest = SMALLEST * RATIO.powi(RADII as i32 - 1);
    let (width, height) = slices.size();
    let window = block.grown(largest as usize + 4, width, height);
    if !slices.covers(sharp, window) || !slices.covers(other, window) {
        return Ok(None);
    }
    let (sharp, other) = (slices.luma(sharp, window)?, slices.luma(other, window)?);
    let (x, y) = (block.x - window.x, block.y - window.y);
    let inner = Rect { x, y, ..block };
    let misfit = |step: usize| -> f64 {
        let blurred = Disc::new(SMALLEST * RATIO.powi(step as i32)).blurred_in(&sharp, inner);
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        for y in y..y + block.height {
            for (a, b) in blurred.row(y - inner.y).iter().zip(&other.row(y)[x..x + block.width]) {
                let difference = f64::from(a - b);
                sum += difference;
                squares += difference * difference;
            }
        }
        // a constant difference of brightness is not blur
        squares - sum * sum / (block.width * block.height) as f64
    };
    let misfits: Vec<f64> = (0..RADII).map(misfit).collect();
    let Some(best) = (1..RADII - 1).min_by(|&a, &b| misfits[a].total_cmp(&misfits[b])) else { return Ok(None) };
    let [before, here, after] = [misfits[best - 1], misfits[best], misfits[best + 1]];
    if here >= before || here >= after {
        return Ok(None);
    }
    let shift = 0.5 * (before - after) / (before - 2.0 * here + after);
    Ok(Some(SMALLEST * RATIO.powf(best as f32 + shift as f32)))
}
