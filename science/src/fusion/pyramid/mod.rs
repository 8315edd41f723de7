//! Fusing by Laplacian pyramids (Burt & Adelson 1983; for a stack: Burt & Kolczynski 1993, Wang & Chang 2011).
//!
//! Each slice is taken apart into detail of ever coarser scale and a base. In each place of each level those
//! slices count that show the most detail there, and what comes out is put together again.
//!
//! - What counts is the energy of the detail in all channels, smoothed: a colour is never put together from
//!   different slices.
//! - Not the largest energy alone counts, but each slice with a high power of its energy: where one slice stands
//!   out that is the same, and where all show noise only it is their average, so that noise does not win.
//! - The base is chosen likewise, by how much it deviates from its surroundings.
//! - A slice counts only where it covers what its detail was computed from; elsewhere it counts only where no
//!   other slice does.
//! - No sample leaves the range of the slices in the pixels around it.
//!
//! Levels are computed per tile, from all that a pixel of the tile can depend on ([`reach`]): the same bytes
//! come whatever the tiles are. Memory does not grow with the number of slices.

mod choice;
mod filter;
mod finest;
mod reach;

use std::mem;

use super::{
    UNCOVERED,
    align::Aligned,
    run::Run,
    tiles::{Blended, in_tiles},
};
use crate::{
    imaging::{
        Coverage, Plane, Rect, Sample,
        simd::{self, Avx2},
    },
    types::{Control, Interrupted},
};
use choice::{Chooser, LUMA, Place, Source};
use filter::{Filters, Level, Patch, WEIGHT};
use finest::{Extremes, Finest};
use reach::{Reach, Sizes};

/// How often the canvas is halved. The base is what is coarser than some 30 px: blur of that size is not chosen
/// among slices any more.
const LEVELS: usize = 4;

/// Runs the second pass.
pub(super) fn blend<S: Sample, const C: usize>(run: &Run<'_>, aligned: &Aligned) -> Result<Blended<S>, Interrupted> {
    let canvas = Canvas::new(run.plan.width, run.plan.height);
    in_tiles::<S, C, _>(run, "fusing", Pyramid::default, |pyramid, rect, out| {
        pyramid.tile::<C>(&canvas, rect, aligned, run.control, out)
    })
}

/// What all tiles share.
struct Canvas {
    sizes: Sizes,
    /// Per level, how much of what a pixel was computed from lies on the canvas: across and down.
    weights: Vec<[Vec<f32>; 2]>,
}

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        let sizes = Sizes::of(width, height, LEVELS);
        let (widths, heights): (Vec<_>, Vec<_>) = sizes.0.iter().copied().unzip();
        let weights = filter::weights_along(&widths).into_iter().zip(filter::weights_along(&heights));
        Self { weights: weights.map(|(across, down)| [across, down]).collect(), sizes }
    }

    fn place(&self, level: usize) -> Place<'_> {
        let size = self.sizes.0[level];
        let coarser = self.sizes.0.get(level + 1).copied().unwrap_or(size);
        let [across, down] = &self.weights[level];
        Place { size, coarser, across, down }
    }
}

/// The buffers of one thread, used for tile after tile.
#[derive(Default)]
struct Pyramid<S> {
    filters: Filters,
    chooser: Chooser,
    finest: Finest<S>,
    /// Levels of a slice, multiplied by their weights. The finest stays empty unless it is the only one.
    levels: Vec<Level>,
    /// One level of it, not multiplied.
    plain: Level,
    /// Per level: detail (or base) times weight, and the weights, summed up over slices.
    sums: Vec<Level>,
    /// Least and largest samples of all slices.
    range: Extremes<S>,
}

impl<S: Sample> Pyramid<S> {
    /// Fuses the pixels of `rect` into `out` (interleaved, `C` channels) and says in how many of them a
    /// sample had to be brought back into the range of its depth.
    fn tile<const C: usize>(
        &mut self,
        canvas: &Canvas,
        rect: Rect,
        aligned: &Aligned,
        control: &dyn Control,
        out: &mut Vec<S>,
    ) -> Result<usize, Interrupted> {
        let reach = Reach::of(rect, &canvas.sizes);
        let (levels, simd) = (canvas.sizes.0.len(), Avx2::detect());
        self.levels.resize(levels, Level::default());
        self.sums.resize(levels, Level::default());
        for (sums, &rect) in self.sums.iter_mut().zip(&reach.result) {
            sums.iter_mut().for_each(|plane| plane.reset(rect, 0.0));
        }
        let (width, height) = canvas.sizes.0[0];
        self.range.reset::<C>(rect.grown(1, width, height));

        for (slice, coverage) in aligned.coverages.iter().enumerate() {
            control.check()?;
            if coverage.misses(reach.source[0]) {
                continue;
            }
            self.finest.read::<C>(&aligned.scratch, slice, reach.source[0])?;
            self.range.enter::<C>(&self.finest, coverage);
            match levels {
                1 => self.lay_out::<C>(coverage, reach.source[0]),
                _ => self.finest.halve::<C>(simd, coverage, reach.source[1], &mut self.levels[1]),
            }
            for level in 2..levels {
                let (finer, coarser) = self.levels.split_at_mut(level);
                for c in channels::<C>() {
                    let (from, to) = (&finer[level - 1][c], &mut coarser[0][c]);
                    self.filters.reduce(simd, from, reach.source[level], to);
                }
            }
            for level in 0..levels - 1 {
                divided::<C>(simd, &self.levels[level + 1], &mut self.plain);
                let source = match level {
                    0 => Source::Samples(&self.finest, coverage),
                    _ => Source::Level(&self.levels[level]),
                };
                let (place, sums) = (canvas.place(level), &mut self.sums[level]);
                self.chooser.enter::<S, C>(simd, &source, &self.plain, place, sums);
            }
            self.base::<C>(simd, canvas.place(levels - 1), reach.detail[levels - 1]);
        }
        Ok(self.finish::<C>(canvas, rect, &aligned.index, out))
    }

    /// The finest level of a slice, for want of any other: what it covers of `rect`, in grey levels of 255.
    fn lay_out<const C: usize>(&mut self, coverage: &Coverage, rect: Rect) {
        let scale = 255.0 / S::DEPTH.max();
        let level = &mut self.levels[0];
        level.iter_mut().for_each(|plane| plane.reset(rect, 0.0));
        for y in rect.y..rect.y + rect.height {
            let span = coverage.span(y);
            let columns = span.start.max(rect.x)..span.end.min(rect.x + rect.width);
            if columns.is_empty() {
                continue;
            }
            let part = columns.start - rect.x..columns.end - rect.x;
            for (plane, samples) in level.iter_mut().zip(&self.finest.planes).take(C) {
                let values = plane.row_mut(y)[part.clone()].iter_mut();
                values.zip(&samples.row(y)[part.clone()]).for_each(|(value, sample)| *value = sample.value() * scale);
            }
            level[WEIGHT].row_mut(y)[part].fill(1.0);
        }
    }

    /// Enters the base, which is chosen by how much it deviates from its surroundings; `rect` is where these are.
    fn base<const C: usize>(&mut self, simd: Option<Avx2>, place: Place<'_>, rect: Rect) {
        let (Some(coarsest), Some(sums)) = (self.levels.last(), self.sums.last_mut()) else { return };
        let inner = sums[WEIGHT].rect;
        divided::<C>(simd, coarsest, &mut self.plain);
        let near = inner.grown(reach::BASE_SMOOTHING / 2, place.size.0, place.size.1);
        let mut deviation = Patch::default();
        deviation.reset(near, 0.0f32);
        // weighted mean of the surroundings, one channel after the other
        let (mut channel, mut mean, mut total) = (Patch::default(), Patch::default(), Patch::default());
        let mut smoothed = |c: usize, out: &mut Patch<f32>| {
            channel.reset(rect, 0.0);
            for y in rect.y..rect.y + rect.height {
                channel.row_mut(y).copy_from_slice(coarsest[c].part(rect.x, y, rect.width));
            }
            self.filters.smooth_less(simd, &channel, near, out);
        };
        smoothed(WEIGHT, &mut total);
        for (c, part) in LUMA.iter().enumerate().take(C) {
            smoothed(c, &mut mean);
            for y in near.y..near.y + near.height {
                let own = self.plain[c].part(near.x, y, near.width).iter();
                let own = own.zip(coarsest[WEIGHT].part(near.x, y, near.width));
                let around = mean.row(y).iter().zip(total.row(y));
                for (((value, &weight), (mean, total)), deviation) in own.zip(around).zip(deviation.row_mut(y)) {
                    if weight > 0.0 {
                        let away = value - mean / total;
                        *deviation += part * away * away;
                    }
                }
            }
        }
        let mut energy = Patch::default();
        self.filters.smooth_less(simd, &deviation, inner, &mut energy);
        self.chooser.enter_base::<C>(&self.plain, &coarsest[WEIGHT], &energy, place, sums);
    }

    /// Puts the levels together, clamped and rounded; the number of pixels with a sample that had left the range
    /// of its depth by more than one grey level of 255.
    fn finish<const C: usize>(&mut self, canvas: &Canvas, rect: Rect, index: &Plane<u16>, out: &mut Vec<S>) -> usize {
        let (levels, simd) = (self.sums.len(), Avx2::detect());
        let (mut result, mut expanded) = (mem::take(&mut self.plain), Vec::new());
        divided::<C>(simd, &self.sums[levels - 1], &mut result);
        for level in (0..levels - 1).rev() {
            let [first, second, third, weights] = &mut self.sums[level];
            let rect = weights.rect;
            for (sums, coarse) in [first, second, third].into_iter().zip(&result).take(C) {
                for y in rect.y..rect.y + rect.height {
                    let columns = rect.x..rect.x + rect.width;
                    let size = canvas.sizes.0[level + 1];
                    let coarse = self.filters.expand(simd, coarse, size, (y, &columns), &mut expanded);
                    let (sums, weights) = (sums.row_mut(y), weights.row(y));
                    simd::run(
                        simd,
                        #[inline(always)]
                        || {
                            for ((sum, &weight), coarse) in sums.iter_mut().zip(weights).zip(coarse) {
                                let there = *sum / weight + *coarse;
                                *sum = if weight > 0.0 { there } else { *sum };
                            }
                        },
                    );
                }
            }
            mem::swap(&mut result, &mut self.sums[level]);
        }

        out.clear();
        out.resize(rect.width * rect.height * C, S::default());
        let (scale, columns, mut clamped) = (S::DEPTH.max() / 255.0, rect.x..rect.x + rect.width, 0);
        let mut outside = vec![false; rect.width];
        for y in rect.y..rect.y + rect.height {
            let out = &mut out[(y - rect.y) * rect.width * C..][..rect.width * C];
            let winners = &index.row(y)[columns.clone()];
            outside.fill(false);
            for (c, plane) in result.iter_mut().enumerate().take(C) {
                let values = plane.row_mut(y);
                for (value, outside) in values.iter_mut().zip(&mut outside) {
                    *outside |= (*value < -1.0) | (*value > 256.0);
                    *value *= scale;
                }
                self.range.clamp(c, y, &columns, values);
                for ((out, &value), &winner) in out.chunks_exact_mut(C).zip(&*values).zip(winners) {
                    out[c] = if winner == UNCOVERED { S::default() } else { S::rounded(value) };
                }
            }
            let covered = outside.iter().zip(winners).filter(|&(_, &winner)| winner != UNCOVERED);
            clamped += covered.filter(|(outside, _)| **outside).count();
        }
        self.plain = result;
        clamped
    }
}

/// The planes of a level that are in use: those of the channels and the weights.
fn channels<const C: usize>() -> impl Iterator<Item = usize> {
    (0..C).chain([WEIGHT])
}

/// The channels divided by their weights; nothing where there is no weight.
fn divided<const C: usize>(simd: Option<Avx2>, from: &Level, to: &mut Level) {
    let weights = &from[WEIGHT];
    for (from, to) in from[..C].iter().zip(to) {
        to.shape(from.rect, 0.0);
        simd::run(
            simd,
            #[inline(always)]
            || {
                for ((to, from), &weight) in to.data.iter_mut().zip(&from.data).zip(&weights.data) {
                    let value = from / weight;
                    *to = if weight > 0.0 { value } else { 0.0 };
                }
            },
        );
    }
}
