//! The defocus model of a stack: how blurred what is sharp in one slice is in another, and which slice is nearer to the
//! camera.
//!
//! In: the sharpest slice per pixel, where there is texture, and what the profile knows of the rail and the direction.
//! Out: a [`DefocusModel`]. The blur is measured in the stack itself, because neither the aperture nor the pixel pitch
//! is given.
//!
//! The blur radius between slices `a` and `b` is `r(a, b) = min(r1 |z_a - z_b|, 64 px)`, with `z` the position of a
//! slice on the rail in mean steps, and `r1` the blur radius per step.

use rayon::prelude::*;

use super::{depth_order, warped_slices::WarpedSlices};
use crate::{
    imaging::{Plane, Rect, Sample, filter::disc::Disc},
    types::Interrupted,
};

/// Blur radius, px, from which two slices are separable: far enough apart in focus to decide which one shows a pixel
/// sharp.
const SEPARABLE: f32 = 1.8;

/// Largest blur radius, px; larger ones are clamped, because the surroundings of a tile must be finite.
pub(super) const MAX_RADIUS: f32 = 64.0;

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

/// How focus changes from slice to slice.
#[derive(Debug, Clone)]
pub(crate) struct DefocusModel {
    /// Per slice: its position on the rail in mean steps.
    positions: Vec<f32>,
    /// Blur radius of what is one step out of focus, px; 0 when it could not be measured.
    radius_per_step: f32,
    /// Whether positions increase away from the camera; none when neither the profile nor the stack determines it.
    increasing_depth: Option<bool>,
    /// Whether the stack contradicts the direction of the profile.
    contradicts_profile: bool,
}

#[cfg(test)]
impl DefocusModel {
    /// The model of `slices` slices with even steps, of which the first is focused nearest.
    pub(super) fn near_first(slices: usize, radius_per_step: f32) -> Self {
        let positions = positions(slices, None);
        Self { positions, radius_per_step, increasing_depth: Some(true), contradicts_profile: false }
    }
}

impl DefocusModel {
    /// Blur radius, px, in slice `b` of what is sharp in slice `a`.
    pub(super) fn radius(&self, a: usize, b: usize) -> f32 {
        (self.radius_per_step * (self.positions[a] - self.positions[b]).abs()).min(MAX_RADIUS)
    }

    /// Whether the blur could be measured.
    pub(super) fn is_known(&self) -> bool {
        self.radius_per_step > 0.0
    }

    /// Whether slice `a` has a smaller position than slice `b`.
    pub(super) fn is_before(&self, a: usize, b: usize) -> bool {
        self.positions[a] < self.positions[b]
    }

    /// Whether what is sharp in one slice is clearly blurred in the other.
    pub(super) fn separable(&self, a: usize, b: usize) -> bool {
        self.radius(a, b) >= SEPARABLE
    }

    /// Whether the blur of what is sharp in `near` can lie over what is sharp in `far`.
    pub(super) fn spreads_over(&self, near: usize, far: usize) -> bool {
        let ordered = |increasing| (self.positions[near] < self.positions[far]) == increasing;
        self.increasing_depth.is_some_and(ordered) && self.separable(near, far)
    }

    /// Whether slice `a` is focused farther from the camera than slice `b`.
    pub(super) fn is_behind(&self, a: usize, b: usize) -> bool {
        self.increasing_depth.is_some_and(|increasing| (self.positions[a] > self.positions[b]) == increasing)
    }

    /// Whether there is any pair of slices between which blur can spread.
    pub(super) fn has_spread(&self) -> bool {
        let last = self.positions.len() - 1;
        self.increasing_depth.is_some() && self.separable(0, last)
    }

    /// Whether the stack shows the opposite of the direction that the profile gives. The profile is followed.
    pub(super) fn contradicts_profile(&self) -> bool {
        self.contradicts_profile
    }

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
    ) -> Result<Self, Interrupted> {
        let positions = positions(slices.count(), rail);
        let radius_per_step = radius_per_step(slices, map, textured, &positions)?;
        let decreasing = positions.first() > positions.last();
        let by_profile = near_first.map(|near_first| near_first != decreasing);
        let mut model = Self { positions, radius_per_step, increasing_depth: by_profile, contradicts_profile: false };
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
}

/// The position of each slice on the rail, in mean steps from the first; equal steps when the rail is not known.
fn positions(count: usize, rail: Option<&[f64]>) -> Vec<f32> {
    let even = || (0..count).map(|slice| slice as f32).collect();
    let Some(rail) = rail.filter(|rail| rail.len() == count && count > 1) else { return even() };
    let step = (rail[count - 1] - rail[0]).abs() / (count - 1) as f64;
    if !step.is_finite() || step <= 0.0 {
        return even();
    }
    rail.iter().map(|position| ((position - rail[0]) / step) as f32).collect()
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
