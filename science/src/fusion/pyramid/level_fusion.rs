//! Adds one level of a slice to the fused level: its detail, weighted by the local energy of the detail.
//!
//! Rows are processed in order, with the last rows in rings of buffers, so that data that is used several times stays
//! in the cache.

use std::ops::Range;

use super::{
    filter::{ENERGY_KERNEL, ENERGY_REACH, Filters, Level, Patch, WEIGHT, weigh},
    finest::FinestLevel,
};
use crate::imaging::{
    Coverage, LUMA, Rect, Sample,
    simd::{self, Avx2},
};

/// Added to every energy, squared grey levels of 255, so that no sum of weights is 0.
const MIN_ENERGY: f32 = 1e-3;

/// Weight of a slice where it does not cover all pixels that its level depends on: below that of all others.
const INCOMPLETE: f32 = 1e-18;

/// Covered fraction from which a slice counts as covering all pixels; the rest is rounding.
const COMPLETE: f32 = 0.999;

/// Rows of a ring: those that a smoothed energy depends on.
const RING: usize = ENERGY_KERNEL.len();

/// Pixels that are kept in registers.
const PART: usize = 16;

/// A level of a slice.
pub(super) enum SliceLevel<'a, S: Sample> {
    /// Level 0, and the area that the slice covers.
    Finest(&'a FinestLevel<S>, &'a Coverage),
    /// Another level: values times covered fraction, and covered fraction.
    Coarser(&'a Level),
}

/// The geometry of a level.
#[derive(Clone, Copy)]
pub(super) struct LevelGeometry<'a> {
    /// Width and height.
    pub size: (usize, usize),
    /// Width and height of the next coarser level.
    pub coarser: (usize, usize),
    /// Per column: the fraction of the kernel that lies on the canvas.
    pub across: &'a [f32],
    /// Per row: the same.
    pub down: &'a [f32],
}

/// Detail of a slice that is added to a part of a level.
struct Detail<'a, S: Sample> {
    simd: Option<Avx2>,
    source: &'a SliceLevel<'a, S>,
    /// The values of the next coarser level of the slice.
    coarse: &'a Level,
    geometry: LevelGeometry<'a>,
    part: Rect,
    /// The pixels that the energies of the part depend on.
    around: Rect,
}

/// Adds levels of slices to fused levels; holds the buffers of rows.
///
/// Row `y` is in slot `(y + ENERGY_REACH) % RING` of each ring.
#[derive(Default)]
pub(super) struct LevelFuser {
    filters: Filters,
    /// Per channel: a row of the coarser level, expanded.
    expanded: [Vec<f32>; 3],
    /// The energies of a row: of the part, and of [`ENERGY_REACH`] px on each side of it; 0 beyond the canvas.
    energy: Vec<f32>,
    /// Per channel: a ring with the details of the last rows.
    details: [Vec<f32>; 3],
    /// A ring with the energies of the last rows, smoothed along x.
    smoothed: Vec<f32>,
    total: Vec<f32>,
    covered: Vec<f32>,
}

impl LevelFuser {
    /// Adds the detail of `source` to the rectangle `part` of `sums`; `coarse` has the values of the next coarser level
    /// of the slice.
    pub(super) fn add_detail<S: Sample, const C: usize>(
        &mut self,
        simd: Option<Avx2>,
        source: &SliceLevel<'_, S>,
        coarse: &Level,
        geometry: LevelGeometry<'_>,
        part: Rect,
        sums: &mut Level,
    ) {
        let around = part.grown(ENERGY_REACH, geometry.size.0, geometry.size.1);
        let detail = Detail { simd, source, coarse, geometry, part, around };
        self.energy.clear();
        self.energy.resize(part.width + 2 * ENERGY_REACH, 0.0);
        self.details[..C].iter_mut().for_each(|ring| ring.resize(RING * around.width, 0.0));
        self.smoothed.resize(RING * part.width, 0.0);
        self.total.resize(part.width, 0.0);
        self.covered.resize(part.width, 0.0);
        let before = ENERGY_REACH as isize;
        for at in part.y as isize - before..(part.y + part.height) as isize + before {
            match usize::try_from(at).ok().filter(|y| (around.y..around.y + around.height).contains(y)) {
                Some(y) => self.measure_row::<S, C>(&detail, y),
                None => slot_mut(&mut self.smoothed, (at + before) as usize, part.width).fill(0.0),
            }
            if let Some(y) = usize::try_from(at - before).ok().filter(|&y| y >= part.y) {
                self.add_row::<S, C>(&detail, y, sums);
            }
        }
    }

    /// Puts row `y` into the rings: its detail, and the energy of that.
    fn measure_row<S: Sample, const C: usize>(&mut self, detail: &Detail<'_, S>, y: usize) {
        let &Detail { simd, source, coarse, geometry, part, around } = detail;
        let Self { filters, expanded, energy, details, smoothed, .. } = self;
        let columns = around.x..around.x + around.width;
        for (c, expanded) in expanded.iter_mut().enumerate().take(C) {
            filters.expand(simd, &coarse[c], geometry.coarser, (y, &columns), expanded);
        }
        // an expanded row begins at an even column
        let coarse = expanded.each_ref().map(|row| row.get(around.x % 2..).unwrap_or_default());
        let detail = details.each_mut().map(|ring| {
            let width = if ring.is_empty() { 0 } else { around.width };
            slot_mut(ring, y + ENERGY_REACH, width)
        });
        let own_energy = &mut energy[around.x + ENERGY_REACH - part.x..][..around.width];
        match source {
            SliceLevel::Finest(samples, coverage) => {
                let covered = coverage.span_in(y, around);
                let samples = samples.planes.each_ref().map(|plane| match plane.data.is_empty() {
                    true => &[][..],
                    false => plane.part(around.x, y, around.width),
                });
                simd::run(
                    simd,
                    #[inline(always)]
                    || of_samples::<S, C>(samples, coarse, covered, detail, own_energy),
                );
            }
            SliceLevel::Coarser(level) => {
                own_energy.fill(0.0);
                let weights = level[WEIGHT].part(around.x, y, around.width);
                for (c, detail) in detail.into_iter().enumerate().take(C) {
                    let values = level[c].part(around.x, y, around.width);
                    simd::run(
                        simd,
                        #[inline(always)]
                        || of_level(values, weights, &coarse[c][..around.width], LUMA[c], detail, own_energy),
                    );
                }
            }
        }
        let (energy, smoothed) = (&energy[..], slot_mut(smoothed, y + ENERGY_REACH, part.width));
        simd::run(
            simd,
            #[inline(always)]
            || weigh(smoothed, std::array::from_fn(|tap| &energy[tap..]), &ENERGY_KERNEL),
        );
    }

    /// Adds row `y`, when the rings have all rows that its energy depends on.
    fn add_row<S: Sample, const C: usize>(&mut self, detail: &Detail<'_, S>, y: usize, sums: &mut Level) {
        let &Detail { simd, source, geometry, part, around, .. } = detail;
        let Self { details, smoothed, total, covered, .. } = self;
        match source {
            SliceLevel::Finest(_, coverage) => {
                covered.fill(0.0);
                covered[coverage.span_in(y, part)].fill(1.0);
            }
            SliceLevel::Coarser(level) => covered.copy_from_slice(level[WEIGHT].part(part.x, y, part.width)),
        }
        // from row `y - ENERGY_REACH` to row `y + ENERGY_REACH`
        let rows = std::array::from_fn(|tap| slot(smoothed, y + tap, part.width));
        let (across, down) = (&geometry.across[part.x..part.x + part.width], geometry.down[y]);
        let [first, second, third, weights] = &mut *sums;
        let weights = weights.part_mut(part.x, y, part.width);
        simd::run(
            simd,
            #[inline(always)]
            || {
                weigh(total, rows, &ENERGY_KERNEL);
                weights_of(total, covered, across, down, weights);
            },
        );
        for (ring, sum) in details.iter().zip([first, second, third]).take(C) {
            let detail = &slot(ring, y + ENERGY_REACH, around.width)[part.x - around.x..][..part.width];
            let (sum, weights) = (sum.part_mut(part.x, y, part.width), &total[..]);
            simd::run(
                simd,
                #[inline(always)]
                || {
                    for ((sum, detail), weight) in sum.iter_mut().zip(detail).zip(weights) {
                        *sum += weight * detail;
                    }
                },
            );
        }
    }

    /// Adds the base of a slice to `sums`, weighted by `energy`; `values` are its values and `weights` its covered
    /// fractions.
    pub(super) fn add_base<const C: usize>(
        &mut self,
        values: &Level,
        weights: &Patch<f32>,
        energy: &Patch<f32>,
        geometry: LevelGeometry<'_>,
        sums: &mut Level,
    ) {
        let part: Rect = sums[WEIGHT].rect;
        for y in part.y..part.y + part.height {
            self.total.clear();
            self.total.extend_from_slice(energy.part(part.x, y, part.width));
            let covered = weights.part(part.x, y, part.width);
            let (across, down) = (&geometry.across[part.x..part.x + part.width], geometry.down[y]);
            weights_of(&mut self.total, covered, across, down, sums[WEIGHT].row_mut(y));
            for c in 0..C {
                let detail = values[c].part(part.x, y, part.width);
                for ((sum, detail), weight) in sums[c].row_mut(y).iter_mut().zip(detail).zip(&self.total) {
                    *sum += weight * detail;
                }
            }
        }
    }
}

/// The row of a ring whose number is `number`, counted on from the first row; rows are `width` px long.
fn slot(ring: &[f32], number: usize, width: usize) -> &[f32] {
    &ring[number % RING * width..][..width]
}

/// The same, mutable.
fn slot_mut(ring: &mut [f32], number: usize, width: usize) -> &mut [f32] {
    &mut ring[number % RING * width..][..width]
}

/// The detail of a row of level 0, and its energy; both are 0 outside the columns `covered`.
#[inline(always)]
#[allow(clippy::needless_range_loop, reason = "one index for several arrays")]
fn of_samples<S: Sample, const C: usize>(
    samples: [&[S]; 3],
    coarse: [&[f32]; 3],
    covered: Range<usize>,
    detail: [&mut [f32]; 3],
    energy: &mut [f32],
) {
    let scale = 255.0 / S::DEPTH.max();
    energy[..covered.start].fill(0.0);
    energy[covered.end..].fill(0.0);
    let count = covered.len();
    let samples = samples.map(|row| row.get(covered.clone()).unwrap_or_default());
    let coarse = coarse.map(|row| row.get(covered.clone()).unwrap_or_default());
    let detail = detail.map(|row| {
        let end = covered.end.min(row.len());
        row[end..].fill(0.0);
        let (before, row) = row[..end].split_at_mut(covered.start.min(end));
        before.fill(0.0);
        row
    });
    let energy = &mut energy[covered];
    let mut done = 0;
    // everything is read before anything is written, so the compiler need not prove that rows do not overlap
    while done + PART <= count {
        let mut energies = [0.0f32; PART];
        for c in 0..C {
            let mut details = [0.0f32; PART];
            let (samples, coarse) = (&samples[c][done..done + PART], &coarse[c][done..done + PART]);
            for k in 0..PART {
                details[k] = samples[k].value() * scale - coarse[k];
                energies[k] += LUMA[c] * details[k] * details[k];
            }
            detail[c][done..done + PART].copy_from_slice(&details);
        }
        energy[done..done + PART].copy_from_slice(&energies);
        done += PART;
    }
    for x in done..count {
        energy[x] = 0.0;
        for c in 0..C {
            let value = samples[c][x].value() * scale - coarse[c][x];
            detail[c][x] = value;
            energy[x] += LUMA[c] * value * value;
        }
    }
}

/// The same for a channel of a coarser level; the detail is 0 where nothing is covered.
#[inline(always)]
fn of_level(values: &[f32], weights: &[f32], coarse: &[f32], part: f32, detail: &mut [f32], energy: &mut [f32]) {
    let pixels = values.iter().zip(weights).zip(coarse);
    for ((detail, energy), ((value, &weight), coarse)) in detail.iter_mut().zip(energy).zip(pixels) {
        let there = value / weight - coarse;
        *detail = if weight > 0.0 { there } else { 0.0 };
        *energy += part * *detail * *detail;
    }
}

/// Replaces energies by weights, and adds the weights to the sums.
#[inline(always)]
fn weights_of(energies: &mut [f32], covered: &[f32], across: &[f32], down: f32, sums: &mut [f32]) {
    for (((weight, covered), across), sum) in energies.iter_mut().zip(covered).zip(across).zip(sums) {
        let covered = covered / (across * down);
        let square = (*weight + MIN_ENERGY) * (*weight + MIN_ENERGY);
        let complete = square * square;
        *weight = if covered >= COMPLETE { complete } else { INCOMPLETE * covered };
        *sum += *weight;
    }
}
