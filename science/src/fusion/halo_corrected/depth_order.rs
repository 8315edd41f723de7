//! The depth order of a stack from its outlines: which of two slices is focused nearer to the camera.
//!
//! At the outline of a near part, the slice of the near part shows a sharp step. The slice of what lies behind shows
//! the same step blurred. Texture on both sides hides that in a single row of pixels. So brightness is averaged along
//! the outline: texture averages out, and the step remains. Let `p_a` and `p_b` be the mean brightness of two slices
//! over the distance from the border between their pixels in the map of the sharpest slices, and `q_a`, `q_b` the same
//! for the slices blurred by the disc of the blur radius between them. If slice *a* is the near one, `q_a` agrees with
//! `p_b`, and `q_b` does not agree with `p_a`, because it is blurred twice where `p_a` is sharp.

use rayon::prelude::*;

use super::{defocus_model::DefocusModel, warped_slices::WarpedSlices};
use crate::{
    fusion::UNCOVERED,
    imaging::{Plane, Rect, Sample, filter::disc::Disc},
    types::Interrupted,
};

/// Number of depth steps that vote on the direction, at most.
const MAX_VOTERS: usize = 400;
/// Pixels around the border over which brightness is averaged.
const AROUND: usize = 9;
/// Blur radii between the two slices, px: smaller ones show no difference, larger ones reach other parts.
const RADII: std::ops::RangeInclusive<f32> = 2.0..=9.0;
/// Share of the pixels around the border that must belong to each of the two sides.
const SIDE_SHARE: f64 = 0.25;
/// A vote counts if one misfit is larger than the other by this factor.
const CLEAR: f64 = 4.0;
/// Smallest misfit, mean square in squared grey levels, that a step of brightness gives; noise gives less.
const SMALLEST_MISFIT: f64 = 5.0;

/// How many votes are needed, and by which majority.
pub(super) struct MajorityRule {
    votes: usize,
    majority: f64,
}

/// Decides where the profile does not give the direction. In thickets and behind nets a smaller majority may be wrong;
/// then nothing is corrected, which costs less than a correction in the wrong direction.
pub(super) const DECISIVE: MajorityRule = MajorityRule { votes: 30, majority: 0.8 };
/// Contradicts the profile.
pub(super) const CONTRADICTING: MajorityRule = MajorityRule { votes: 50, majority: 0.9 };

/// Votes of depth steps on the direction.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Votes {
    /// For positions that increase away from the camera.
    increasing: usize,
    all: usize,
}

impl Votes {
    /// The direction, if there are enough votes and the majority is large enough.
    pub(super) fn decision(self, rule: &MajorityRule) -> Option<bool> {
        let share = self.increasing as f64 / self.all.max(1) as f64;
        match self.all >= rule.votes {
            true if share >= rule.majority => Some(true),
            true if share <= 1.0 - rule.majority => Some(false),
            _ => None,
        }
    }
}

/// Lets depth steps vote. `map` is the sharpest slice per pixel, `textured` is where its focus energy is more than
/// noise.
pub(super) fn votes<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &Plane<u16>,
    textured: &Plane<bool>,
    model: &DefocusModel,
) -> Result<Votes, Interrupted> {
    let steps = steps(map, textured, model);
    let stride = steps.len().div_ceil(MAX_VOTERS).max(1);
    let votes: Vec<Option<bool>> =
        steps.par_iter().step_by(stride).map(|step| vote(slices, map, model, step)).collect::<Result<_, _>>()?;
    let votes: Vec<bool> = votes.into_iter().flatten().collect();
    Ok(Votes { increasing: votes.iter().filter(|&&increasing| increasing).count(), all: votes.len() })
}

/// A border between two slices in the map of the sharpest slices.
#[derive(Clone)]
struct DepthStep {
    x: usize,
    y: usize,
    /// The slices left and right of it.
    slices: [usize; 2],
}

fn steps(map: &Plane<u16>, textured: &Plane<bool>, model: &DefocusModel) -> Vec<DepthStep> {
    let of_row = |y: usize| -> Vec<DepthStep> {
        let (row, textured) = (map.row(y), textured.row(y));
        let step = |x: usize| {
            let slices = [usize::from(row[x - 1]), usize::from(row[x])];
            let is_step = textured[x - 1]
                && textured[x]
                && slices[0] != slices[1]
                && RADII.contains(&model.radius(slices[0], slices[1]));
            is_step.then_some(DepthStep { x, y, slices })
        };
        (1..row.len()).filter_map(step).collect()
    };
    (0..map.height).into_par_iter().map(of_row).collect::<Vec<_>>().concat()
}

/// Whether positions increase away from the camera by this depth step; `None` if it does not tell.
fn vote<S: Sample, const C: usize>(
    slices: &WarpedSlices<'_, S, C>,
    map: &Plane<u16>,
    model: &DefocusModel,
    step: &DepthStep,
) -> Result<Option<bool>, Interrupted> {
    let [a, b] = step.slices;
    let radius = model.radius(a, b);
    let core = Rect { x: step.x, y: step.y, width: 1, height: 1 }.grown(AROUND, map.width, map.height);
    let Some(side) = sides(map, core, model, [a, b]) else { return Ok(None) };
    let disc = Disc::new(radius);
    let window = core.grown(disc.reach(), map.width, map.height);
    if !slices.covers(a, window) || !slices.covers(b, window) {
        return Ok(None);
    }
    let inner = Rect { x: core.x - window.x, y: core.y - window.y, ..core };
    let lumas = [slices.luma(a, window)?, slices.luma(b, window)?];
    let blurred = [0, 1].map(|n: usize| side.profile(&disc.blurred_in(&lumas[n], inner), [0, 0]));
    let sharp = [0, 1].map(|n: usize| side.profile(&lumas[n], [inner.x, inner.y]));
    // the misfit of each slice's blur to the other slice
    let a_near = misfit(&blurred[0], &sharp[1], &side.counts);
    let b_near = misfit(&blurred[1], &sharp[0], &side.counts);
    let (less, more) = (a_near.min(b_near), a_near.max(b_near));
    let clear = more > SMALLEST_MISFIT && more > CLEAR * less;
    Ok(clear.then_some((a_near < b_near) == model.is_before(a, b)))
}

/// Distances from a straight border.
struct Sides {
    width: usize,
    /// Per pixel of the core, row by row: its bin.
    bins: Vec<usize>,
    /// Pixels per bin.
    counts: Vec<f64>,
}

/// The straight line that separates the pixels of the two slices in `core` best: perpendicular to the line between
/// their centres of gravity. `None` if one side is too small, or other slices are between them.
fn sides(map: &Plane<u16>, core: Rect, model: &DefocusModel, slices: [usize; 2]) -> Option<Sides> {
    let mut sums = [[0.0_f64; 3]; 2];
    for y in 0..core.height {
        for (x, &slice) in map.row(core.y + y)[core.x..core.x + core.width].iter().enumerate() {
            let slice = usize::from(slice);
            if slice == usize::from(UNCOVERED) {
                return None;
            }
            // a part may extend over a few slices
            let of = (0..2).find(|&n| slice == slices[n] || !model.separable(slice, slices[n]))?;
            let sum = &mut sums[of];
            *sum = [sum[0] + 1.0, sum[1] + x as f64, sum[2] + y as f64];
        }
    }
    let pixels = (core.width * core.height) as f64;
    if sums.iter().any(|sum| sum[0] < SIDE_SHARE * pixels) {
        return None;
    }
    let centres = sums.map(|[count, x, y]| [x / count, y / count]);
    let normal = [centres[1][0] - centres[0][0], centres[1][1] - centres[0][1]];
    let length = normal[0].hypot(normal[1]);
    // two halves of a square are half a side apart
    if length < 0.3 * core.width as f64 {
        return None;
    }
    let middle = [(core.width as f64 - 1.0) / 2.0, (core.height as f64 - 1.0) / 2.0];
    let reach = AROUND as f64;
    let mut bins = Vec::with_capacity(core.width * core.height);
    let mut counts = vec![0.0; 2 * AROUND + 1];
    for y in 0..core.height {
        for x in 0..core.width {
            let along = ((x as f64 - middle[0]) * normal[0] + (y as f64 - middle[1]) * normal[1]) / length;
            let bin = (along.clamp(-reach, reach) + reach).round() as usize;
            bins.push(bin);
            counts[bin] += 1.0;
        }
    }
    Some(Sides { width: core.width, bins, counts })
}

impl Sides {
    /// The mean of a plane in each bin; the core begins at `at` in the plane.
    fn profile(&self, plane: &Plane<f32>, at: [usize; 2]) -> Vec<f64> {
        let mut sums = vec![0.0; self.counts.len()];
        for (row, bins) in self.bins.chunks(self.width).enumerate() {
            let values = &plane.row(at[1] + row)[at[0]..at[0] + self.width];
            for (&value, &bin) in values.iter().zip(bins) {
                sums[bin] += f64::from(value);
            }
        }
        sums.iter().zip(&self.counts).map(|(sum, count)| sum / count.max(1.0)).collect()
    }
}

/// Mean squared difference of two profiles, after their means are made equal.
fn misfit(one: &[f64], other: &[f64], counts: &[f64]) -> f64 {
    let all: f64 = counts.iter().sum();
    let differences = || one.iter().zip(other).zip(counts).map(|((a, b), count)| (a - b, count));
    let mean = differences().map(|(difference, count)| difference * count).sum::<f64>() / all;
    differences().map(|(difference, count)| (difference - mean).powi(2) * count).sum::<f64>() / all
}
