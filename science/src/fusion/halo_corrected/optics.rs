//! How blurred what is sharp in one slice is in another, and which of two slices is in focus nearer to the camera.

use rayon::prelude::*;

use super::pictures::Pictures;
use crate::{
    imaging::{
        Plane, Rect, Sample,
        filter::{
            disc::Disc,
            focus::{FocusEnergy, Rows},
        },
    },
    types::Interrupted,
};

/// Blur radius, px, from which two slices are so far apart in focus that one can veil the other.
const APART: f32 = 1.8;

/// Larger blur radii than this are taken for this, px: surroundings of a tile must end somewhere.
pub(super) const WIDEST: f32 = 64.0;

/// Sides of the blocks in which blur is measured, px: smaller ones where there are too few of the larger, because in a
/// thicket no part is large. How many of them are looked at, and how many numbers they must give.
const SIDES: [usize; 3] = [64, 32, 20];
const BLOCKS: usize = 24;
const FEWEST: usize = 4;

/// Radii that are tried, px: from `FIRST`, each larger than the one before by `GROWTH`.
const FIRST: f32 = 0.7;
const GROWTH: f32 = 1.35;
const RADII: usize = 12;

/// Places of steps in depth that are asked which side is nearer; how many must answer, and how clearly.
const STEPS: usize = 200;
const FEWEST_STEPS: usize = 30;
const CLEARLY: f64 = 0.65;

/// What is known of the blur of a stack.
#[derive(Debug, Clone)]
pub(crate) struct Optics {
    /// Where each slice is in focus; neighbours are 1 apart on the mean.
    places: Vec<f32>,
    /// Blur radius of what is 1 out of focus, px; 0 where it could not be measured.
    blur: f32,
    /// Whether places count away from the camera; unknown where nothing tells.
    rising: Option<bool>,
}

impl Optics {
    /// Blur radius, px, in slice `b` of what is sharp in slice `a`.
    pub(super) fn radius(&self, a: usize, b: usize) -> f32 {
        (self.blur * (self.places[a] - self.places[b]).abs()).min(WIDEST)
    }

    /// Whether the blur could be measured.
    pub(super) fn is_known(&self) -> bool {
        self.blur > 0.0
    }

    /// Whether what is sharp in one is clearly blurred in the other.
    pub(super) fn apart(&self, a: usize, b: usize) -> bool {
        self.radius(a, b) >= APART
    }

    /// Whether what is sharp in slice `a` can veil what is sharp in slice `b`.
    pub(super) fn veils(&self, a: usize, b: usize) -> bool {
        self.rising.is_some_and(|rising| (self.places[a] < self.places[b]) == rising) && self.apart(a, b)
    }

    /// Whether slice `a` is in focus farther from the camera than slice `b`.
    pub(super) fn is_behind(&self, a: usize, b: usize) -> bool {
        self.rising.is_some_and(|rising| (self.places[a] > self.places[b]) == rising)
    }

    /// Whether anything can veil anything.
    pub(super) fn can_veil(&self) -> bool {
        let last = self.places.len() - 1;
        self.rising.is_some() && self.apart(0, last)
    }

    /// Measures the blur where texture is dense, and asks steps in depth which side is nearer if `near_first` does not
    /// say. `labels` is the sharpest slice per pixel, `sure` says where there is more than noise.
    pub(super) fn measure<S: Sample, const C: usize>(
        pictures: &Pictures<'_, S, C>,
        labels: &Plane<u16>,
        sure: &Plane<bool>,
        rail: Option<&[f64]>,
        near_first: Option<bool>,
    ) -> Result<Self, Interrupted> {
        let places = places(pictures.count(), rail);
        let blur = blur(pictures, labels, sure, &places)?;
        let falling = places.first() > places.last();
        let mut optics = Self { places, blur, rising: near_first.map(|near_first| near_first != falling) };
        if optics.rising.is_none() && optics.blur > 0.0 {
            optics.rising = optics.ask_steps(pictures, labels, sure)?;
        }
        Ok(optics)
    }

    /// At the outline of a near part its own slice shows a sharp edge, and the slice of what lies behind does not.
    fn ask_steps<S: Sample, const C: usize>(
        &self,
        pictures: &Pictures<'_, S, C>,
        labels: &Plane<u16>,
        sure: &Plane<bool>,
    ) -> Result<Option<bool>, Interrupted> {
        const AROUND: usize = 6;
        let of_row = |y: usize| -> Vec<(usize, usize, usize, usize)> {
            let (labels, sure) = (labels.row(y), sure.row(y));
            let step = |x: usize| {
                let (left, right) = (labels[x - 1], labels[x]);
                let is_step =
                    sure[x - 1] && sure[x] && left != right && self.apart(usize::from(left), usize::from(right));
                is_step.then(|| (x, y, usize::from(left.min(right)), usize::from(left.max(right))))
            };
            (1..labels.len()).filter_map(step).collect()
        };
        let steps = (0..labels.height).into_par_iter().map(of_row).collect::<Vec<_>>().concat();
        let stride = steps.len().div_ceil(STEPS).max(1);
        let fine = FocusEnergy::fine();
        let votes: Vec<Option<bool>> = steps
            .par_iter()
            .step_by(stride)
            .map(|&(x, y, first, second)| -> Result<Option<bool>, Interrupted> {
                let at = Rect { x, y, width: 1, height: 1 };
                let window = at.grown(AROUND + fine.reach(), labels.width, labels.height);
                let core = at.grown(AROUND, labels.width, labels.height);
                if !pictures.covers(first, window) || !pictures.covers(second, window) {
                    return Ok(None);
                }
                let strongest = |slice: usize| -> Result<f32, Interrupted> {
                    let energy = fine.plane(&pictures.luma(slice, window)?, &mut Rows::default());
                    let (x, y) = (core.x - window.x, core.y - window.y);
                    let rows = (y..y + core.height).map(|y| &energy.row(y)[x..x + core.width]);
                    Ok(rows.flatten().copied().fold(0.0, f32::max))
                };
                let (one, other) = (strongest(first)?, strongest(second)?);
                Ok((one != other).then_some((one > other) == (self.places[first] < self.places[second])))
            })
            .collect::<Result<_, Interrupted>>()?;
        let votes: Vec<bool> = votes.into_iter().flatten().collect();
        let share = votes.iter().filter(|&&rising| rising).count() as f64 / votes.len().max(1) as f64;
        Ok(match votes.len() >= FEWEST_STEPS {
            true if share >= CLEARLY => Some(true),
            true if share <= 1.0 - CLEARLY => Some(false),
            _ => None,
        })
    }
}

/// Places of the slices in focus, 1 apart on the mean.
fn places(count: usize, rail: Option<&[f64]>) -> Vec<f32> {
    let even = || (0..count).map(|slice| slice as f32).collect();
    let Some(rail) = rail.filter(|rail| rail.len() == count && count > 1) else { return even() };
    let step = (rail[count - 1] - rail[0]).abs() / (count - 1) as f64;
    if !step.is_finite() || step <= 0.0 {
        return even();
    }
    rail.iter().map(|place| ((place - rail[0]) / step) as f32).collect()
}

/// Blur radius of what is one step out of focus: in blocks of dense texture on one slice, the radius that makes the
/// sharp slice look like its neighbours. 0 where too few blocks tell.
fn blur<S: Sample, const C: usize>(
    pictures: &Pictures<'_, S, C>,
    labels: &Plane<u16>,
    sure: &Plane<bool>,
    places: &[f32],
) -> Result<f32, Interrupted> {
    for side in SIDES {
        let mut found = in_blocks(pictures, &blocks(labels, sure, side, places.len()), places)?;
        found.sort_by(f32::total_cmp);
        if found.len() >= FEWEST {
            return Ok(found[found.len() / 2]);
        }
    }
    Ok(0.0)
}

/// What each of some blocks says of the blur of what is one step out of focus.
fn in_blocks<S: Sample, const C: usize>(
    pictures: &Pictures<'_, S, C>,
    blocks: &[(Rect, usize)],
    places: &[f32],
) -> Result<Vec<f32>, Interrupted> {
    let stride = blocks.len().div_ceil(BLOCKS).max(1);
    let nearest: &[isize] = if places.len() < 6 { &[-2, -1, 1, 2] } else { &[-3, -2, 2, 3] };
    let found: Vec<Vec<f32>> = blocks
        .par_iter()
        .step_by(stride)
        .map(|&(block, slice)| -> Result<Vec<f32>, Interrupted> {
            let mut found = Vec::new();
            for other in nearest.iter().filter_map(|&step| slice.checked_add_signed(step)) {
                let apart = places.get(other).map_or(0.0, |place| (place - places[slice]).abs());
                if apart > 0.0
                    && let Some(radius) = radius_between(pictures, block, slice, other)?
                {
                    found.push(radius / apart);
                }
            }
            Ok(found)
        })
        .collect::<Result<_, Interrupted>>()?;
    Ok(found.concat())
}

/// Blocks of a side that are nearly all on one slice, with that slice.
fn blocks(labels: &Plane<u16>, sure: &Plane<bool>, side: usize, slices: usize) -> Vec<(Rect, usize)> {
    let along = |length: usize| (0..(length + 1).saturating_sub(side)).step_by(side / 2);
    let rows: Vec<usize> = along(labels.height).collect();
    let of_row = |&y: &usize| -> Vec<(Rect, usize)> {
        let of_block = |x| {
            let block = Rect { x, y, width: side, height: side };
            Some((block, slice_of(labels, sure, block, slices)?))
        };
        along(labels.width).filter_map(of_block).collect()
    };
    rows.par_iter().map(of_row).collect::<Vec<_>>().concat()
}

/// The slice that nearly all of `block` is on, give or take one, if there is one.
fn slice_of(labels: &Plane<u16>, sure: &Plane<bool>, block: Rect, slices: usize) -> Option<usize> {
    let (rows, columns) = (block.y..block.y + block.height, block.x..block.x + block.width);
    let pixels = block.width * block.height;
    let enough = pixels * 9 / 10;
    let certain: usize =
        rows.clone().map(|y| sure.row(y)[columns.clone()].iter().map(|&sure| usize::from(sure)).sum::<usize>()).sum();
    if certain < enough {
        return None;
    }
    let mut counts = vec![0; slices];
    for &label in rows.flat_map(|y| &labels.row(y)[columns.clone()]) {
        // what no slice covers counts for none
        counts.get_mut(usize::from(label)).into_iter().for_each(|count| *count += 1);
    }
    let mut below = 0;
    let median = counts.iter().position(|count| {
        below += count;
        below > pixels / 2
    })?;
    let alike: usize = counts[median.saturating_sub(1)..(median + 2).min(slices)].iter().sum();
    (alike >= enough).then_some(median)
}

/// The blur radius that makes `sharp` look like `other` within `block`; none when no radius inside the range is best.
fn radius_between<S: Sample, const C: usize>(
    pictures: &Pictures<'_, S, C>,
    block: Rect,
    sharp: usize,
    other: usize,
) -> Result<Option<f32>, Interrupted> {
    let largest = FIRST * GROWTH.powi(RADII as i32 - 1);
    let (width, height) = pictures.size();
    let window = block.grown(largest as usize + 4, width, height);
    if !pictures.covers(sharp, window) || !pictures.covers(other, window) {
        return Ok(None);
    }
    let (sharp, other) = (pictures.luma(sharp, window)?, pictures.luma(other, window)?);
    let (x, y) = (block.x - window.x, block.y - window.y);
    let inner = Rect { x, y, ..block };
    let misfit = |step: usize| -> f64 {
        let blurred = Disc::new(FIRST * GROWTH.powi(step as i32)).blurred_in(&sharp, inner);
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        for y in y..y + block.height {
            for (a, b) in blurred.row(y - inner.y).iter().zip(&other.row(y)[x..x + block.width]) {
                let difference = f64::from(a - b);
                sum += difference;
                squares += difference * difference;
            }
        }
        // brightness may differ: that is no blur
        squares - sum * sum / (block.width * block.height) as f64
    };
    let misfits: Vec<f64> = (0..RADII).map(misfit).collect();
    let Some(best) = (1..RADII - 1).min_by(|&a, &b| misfits[a].total_cmp(&misfits[b])) else { return Ok(None) };
    let [before, here, after] = [misfits[best - 1], misfits[best], misfits[best + 1]];
    if here >= before || here >= after {
        return Ok(None);
    }
    let shift = 0.5 * (before - after) / (before - 2.0 * here + after);
    Ok(Some(FIRST * GROWTH.powf(best as f32 + shift as f32)))
}
