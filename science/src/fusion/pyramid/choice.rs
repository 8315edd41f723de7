//! What a slice has to say to one level: its detail, weighted by the energy of the detail around each pixel. Row by row, so
//! that what is looked at more than once is still at hand.

use super::{
    filter::{Filters, Level, Patch, SMOOTH, SMOOTHING, WEIGHT, weigh},
    finest::Finest,
};
use crate::imaging::{
    Coverage, Rect, Sample,
    simd::{self, Avx2},
};

/// Parts of the channels in an energy: those of luma.
pub(super) const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// What every energy is raised by (of squared grey levels of 255), so that weights never sum up to 0.
const FLOOR: f32 = 1e-3;

/// Weight of a slice that does not cover all that its detail was computed from: below that of all others.
const UNSURE: f32 = 1e-18;

/// A slice covers all that was looked at when this share of it is there (the rest is rounding).
const ALL: f32 = 0.999;

/// Rows of a ring: all that a smoothed energy looks at.
const RING: usize = SMOOTH.len();

/// A level of a slice.
pub(super) enum Source<'a, S> {
    /// The finest one, and what the slice covers.
    Samples(&'a Finest<S>, &'a Coverage),
    /// Another one, multiplied by its weights.
    Level(&'a Level),
}

/// A level, and how much of what a pixel of it is computed from lies on the canvas, across and down.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    /// Columns and rows of its plane, and of the next coarser one.
    pub size: (usize, usize),
    pub coarser: (usize, usize),
    pub across: &'a [f32],
    pub down: &'a [f32],
}

/// Buffers of rows.
#[derive(Default)]
pub(super) struct Chooser {
    filters: Filters,
    expanded: Vec<f32>,
    energy: Vec<f32>,
    /// Per channel, details of the last rows.
    details: [Vec<f32>; 3],
    /// Energies of the last rows, smoothed along x.
    smoothed: Vec<f32>,
    total: Vec<f32>,
    covered: Vec<f32>,
}

impl Chooser {
    /// Adds the detail of `source` to `sums`, in all of their rectangle; `coarse` is the next coarser level of the slice, not
    /// multiplied by weights.
    pub(super) fn enter<S: Sample, const C: usize>(
        &mut self,
        simd: Option<Avx2>,
        source: &Source<'_, S>,
        coarse: &Level,
        place: Place<'_>,
        sums: &mut Level,
    ) {
        let part = sums[WEIGHT].rect;
        let rect = part.grown(SMOOTHING, place.size.0, place.size.1);
        let columns = rect.x..rect.x + rect.width;
        let Self { filters, expanded, energy, details, smoothed, total, covered } = self;
        // energies from `SMOOTHING` px before the part on: beyond the canvas there is none
        energy.clear();
        energy.resize(part.width + 2 * SMOOTHING, 0.0);
        let inner = rect.x + SMOOTHING - part.x..rect.x + SMOOTHING - part.x + rect.width;
        details[..C].iter_mut().for_each(|ring| ring.resize(RING * rect.width, 0.0));
        smoothed.resize(RING * part.width, 0.0);
        total.resize(part.width, 0.0);
        covered.resize(part.width, 0.0);
        let own = part.x - rect.x..part.x - rect.x + part.width;
        let before = SMOOTHING as isize;
        for at in part.y as isize - before..(part.y + part.height) as isize + before {
            let slot = (at + before) as usize % RING;
            let ring = slot * part.width..(slot + 1) * part.width;
            match usize::try_from(at).ok().filter(|y| (rect.y..rect.y + rect.height).contains(y)) {
                None => smoothed[ring].fill(0.0),
                Some(y) => {
                    energy[inner.clone()].fill(0.0);
                    for c in 0..C {
                        let coarse = filters.expand(simd, &coarse[c], place.coarser, (y, &columns), expanded);
                        let detail = &mut details[c][slot * rect.width..(slot + 1) * rect.width];
                        let energy = &mut energy[inner.clone()];
                        match source {
                            Source::Samples(samples, coverage) => {
                                let span = coverage.span(y);
                                let (start, end) =
                                    (span.start.clamp(rect.x, columns.end), span.end.clamp(rect.x, columns.end));
                                let there = start - rect.x..end.max(start) - rect.x;
                                detail[..there.start].fill(0.0);
                                detail[there.end..].fill(0.0);
                                let samples = &samples.planes[c].part(rect.x, y, rect.width)[there.clone()];
                                let (coarse, detail, energy) =
                                    (&coarse[there.clone()], &mut detail[there.clone()], &mut energy[there]);
                                simd::run(
                                    simd,
                                    #[inline(always)]
                                    || of_samples(samples, coarse, LUMA[c], detail, energy),
                                );
                            }
                            Source::Level(level) => {
                                let values = level[c].part(rect.x, y, rect.width);
                                let weights = level[WEIGHT].part(rect.x, y, rect.width);
                                simd::run(
                                    simd,
                                    #[inline(always)]
                                    || of_level(values, weights, coarse, LUMA[c], detail, energy),
                                );
                            }
                        }
                    }
                    let (energy, smoothed) = (&energy[..], &mut smoothed[ring]);
                    simd::run(
                        simd,
                        #[inline(always)]
                        || weigh(smoothed, std::array::from_fn(|tap| &energy[tap..]), &SMOOTH),
                    );
                }
            }
            let Some(y) = usize::try_from(at - before).ok().filter(|&y| y >= part.y) else { continue };
            match source {
                Source::Samples(_, coverage) => {
                    let span = coverage.span(y);
                    let (left, right) = (part.x, part.x + part.width);
                    let (start, end) = (span.start.clamp(left, right), span.end.clamp(left, right));
                    covered.fill(0.0);
                    covered[start - left..end.max(start) - left].fill(1.0);
                }
                Source::Level(level) => covered.copy_from_slice(level[WEIGHT].part(part.x, y, part.width)),
            }
            let rows = std::array::from_fn(|tap| {
                let slot = (y + tap) % RING;
                // row `y - SMOOTHING + tap` lies in the slot that its number plus `SMOOTHING` says
                &smoothed[slot * part.width..(slot + 1) * part.width]
            });
            let (across, down) = (&place.across[part.x..part.x + part.width], place.down[y]);
            let slot = (y + SMOOTHING) % RING * rect.width;
            let [first, second, third, weights] = &mut *sums;
            let weights = weights.row_mut(y);
            let sums = [first, second, third];
            simd::run(
                simd,
                #[inline(always)]
                || {
                    weigh(total, rows, &SMOOTH);
                    weights_of(total, covered, across, down, weights);
                },
            );
            for (c, sum) in sums.into_iter().enumerate().take(C) {
                let (detail, sum) = (&details[c][slot..slot + rect.width][own.clone()], sum.row_mut(y));
                let weights = &total[..];
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
    }

    /// Adds the base of a slice, `values` (not multiplied by weights), to `sums`: it is chosen by `energy`.
    pub(super) fn enter_base<const C: usize>(
        &mut self,
        values: &Level,
        weights: &Patch<f32>,
        energy: &Patch<f32>,
        place: Place<'_>,
        sums: &mut Level,
    ) {
        let part: Rect = sums[WEIGHT].rect;
        for y in part.y..part.y + part.height {
            self.total.clear();
            self.total.extend_from_slice(energy.part(part.x, y, part.width));
            let covered = weights.part(part.x, y, part.width);
            let (across, down) = (&place.across[part.x..part.x + part.width], place.down[y]);
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

/// Detail of the finest level, and its part of the energy.
#[inline(always)]
fn of_samples<S: Sample>(samples: &[S], coarse: &[f32], part: f32, detail: &mut [f32], energy: &mut [f32]) {
    let scale = 255.0 / S::DEPTH.max();
    for (((detail, energy), &sample), coarse) in detail.iter_mut().zip(energy).zip(samples).zip(coarse) {
        *detail = sample.value() * scale - coarse;
        *energy += part * *detail * *detail;
    }
}

/// Detail of another level, and its part of the energy; none where nothing is covered.
#[inline(always)]
fn of_level(values: &[f32], weights: &[f32], coarse: &[f32], part: f32, detail: &mut [f32], energy: &mut [f32]) {
    let pixels = values.iter().zip(weights).zip(coarse);
    for ((detail, energy), ((value, &weight), coarse)) in detail.iter_mut().zip(energy).zip(pixels) {
        let there = value / weight - coarse;
        *detail = if weight > 0.0 { there } else { 0.0 };
        *energy += part * *detail * *detail;
    }
}

/// Makes energies weights, and adds them to the sums.
#[inline(always)]
fn weights_of(energies: &mut [f32], covered: &[f32], across: &[f32], down: f32, sums: &mut [f32]) {
    for (((weight, covered), across), sum) in energies.iter_mut().zip(covered).zip(across).zip(sums) {
        let covered = covered / (across * down);
        let square = (*weight + FLOOR) * (*weight + FLOOR);
        let sure = square * square;
        *weight = if covered >= ALL { sure } else { UNSURE * covered };
        *sum += *weight;
    }
}
