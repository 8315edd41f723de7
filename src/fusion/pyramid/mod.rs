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

mod filter;
mod reach;

use std::mem;

use super::{
    Run, UNCOVERED,
    align::Aligned,
    blend::{Blended, in_tiles},
};
use crate::{
    imaging::{Plane, Rect, Sample},
    model::{Control, Stop},
};
use filter::{Filters, Patch, Pixel};
use reach::{Reach, Sizes};

/// How often the canvas is halved. The base is what is coarser than some 30 px: blur of that size is not chosen
/// among slices any more.
const LEVELS: usize = 4;

/// Parts of the channels in an energy: those of luma.
const LUMA: [f32; 3] = [0.299, 0.587, 0.114];

/// What every energy is raised by (of squared grey levels of 255), so that weights never sum up to 0.
const FLOOR: f32 = 1e-3;

/// Weight of a slice that does not cover all that its detail was computed from: below that of all others.
const UNSURE: f32 = 1e-18;

/// A slice covers all that was looked at when this share of it is there (the rest is rounding).
const ALL: f32 = 0.999;

/// Weight of a slice with detail of this energy.
fn weight(energy: f32) -> f32 {
    let square = (energy + FLOOR) * (energy + FLOOR);
    square * square
}

/// Runs the second pass.
pub(super) fn blend<S: Sample, const C: usize>(run: &Run<'_>, aligned: &Aligned) -> Result<Blended<S>, Stop> {
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
        let mut filters = Filters::default();
        let mut along = |length: usize| {
            let line = |length: usize| Rect { x: 0, y: 0, width: length, height: 1 };
            let mut level = Patch { rect: line(length), data: vec![[0.0, 0.0, 0.0, 1.0]; length] };
            let mut weights = vec![vec![1.0; length]];
            for _ in 1..sizes.0.len() {
                let mut next = Patch::default();
                filters.reduce(&level, line(level.rect.width.div_ceil(2)), &mut next);
                // one row alone keeps the middle of the kernel only
                next.data.iter_mut().for_each(|pixel| pixel[3] /= filter::MIDDLE);
                weights.push(next.data.iter().map(|pixel| pixel[3]).collect());
                level = next;
            }
            weights
        };
        let weights = along(width).into_iter().zip(along(height)).map(|(across, down)| [across, down]).collect();
        Self { sizes, weights }
    }
}

/// The buffers of one thread, used for tile after tile.
#[derive(Default)]
struct Pyramid<S> {
    filters: Filters,
    samples: Vec<S>,
    bytes: Vec<u8>,
    /// Levels of a slice, multiplied by their weights, which are the last channel.
    levels: Vec<Patch<Pixel>>,
    /// One level of it, not multiplied.
    plain: Patch<Pixel>,
    detail: Patch<Pixel>,
    energy: Patch<f32>,
    smoothed: Patch<f32>,
    /// Per level: detail (or base) times weight, and the weights, summed up over slices.
    sums: Vec<Patch<Pixel>>,
    /// Least and largest samples of all slices.
    range: [Patch<Pixel>; 2],
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
    ) -> Result<usize, Stop> {
        let reach = Reach::of(rect, &canvas.sizes);
        let levels = canvas.sizes.0.len();
        self.levels.resize(levels, Patch::default());
        self.sums.resize(levels, Patch::default());
        for (sums, &rect) in self.sums.iter_mut().zip(&reach.result) {
            sums.reset(rect, [0.0; 4]);
        }
        let (width, height) = canvas.sizes.0[0];
        let [least, largest] = &mut self.range;
        least.reset(rect.grown(1, width, height), [f32::INFINITY; 4]);
        largest.reset(rect.grown(1, width, height), [f32::NEG_INFINITY; 4]);

        for (slice, coverage) in aligned.coverages.iter().enumerate() {
            control.check()?;
            if coverage.misses(reach.source[0]) {
                continue;
            }
            self.load::<C>(slice, aligned, reach.source[0])?;
            for level in 1..levels {
                let (finer, coarser) = self.levels.split_at_mut(level);
                self.filters.reduce(&finer[level - 1], reach.source[level], &mut coarser[0]);
            }
            for level in 0..levels {
                if level + 1 < levels {
                    self.detail(level, canvas.sizes.0[level + 1], reach.detail[level]);
                    self.filters.smooth(&self.energy, reach.result[level], &mut self.smoothed);
                } else {
                    self.base(level, reach.detail[level], canvas.sizes.0[level], reach.result[level]);
                }
                self.enter(level, &canvas.weights[level]);
            }
        }
        Ok(self.finish::<C>(canvas, rect, &aligned.index, out))
    }

    /// The finest level of a slice: what it covers, in grey levels of 255.
    fn load<const C: usize>(&mut self, slice: usize, aligned: &Aligned, rect: Rect) -> Result<(), Stop> {
        aligned.scratch.read(slice, rect, &mut self.samples, &mut self.bytes)?;
        let scale = 255.0 / S::DEPTH.max();
        let finest = &mut self.levels[0];
        finest.reset(rect, [0.0; 4]);
        for (y, span) in (rect.y..).zip(aligned.coverages[slice].spans_in(rect)) {
            let row = &self.samples[(y - rect.y) * rect.width * C..][..rect.width * C];
            let pixels = row.chunks_exact(C).zip(finest.row_mut(y));
            for (samples, pixel) in pixels.take(span.end).skip(span.start) {
                for (value, sample) in pixel.iter_mut().zip(samples) {
                    *value = sample.value() * scale;
                }
                pixel[3] = 1.0;
            }
        }
        let [least, largest] = &mut self.range;
        let inner = least.rect;
        for y in inner.y..inner.y + inner.height {
            let pixels = finest.row(y)[inner.x - rect.x..].iter();
            for ((pixel, least), largest) in pixels.zip(least.row_mut(y)).zip(largest.row_mut(y)) {
                if pixel[3] > 0.0 {
                    for c in 0..3 {
                        least[c] = least[c].min(pixel[c]);
                        largest[c] = largest[c].max(pixel[c]);
                    }
                }
            }
        }
        Ok(())
    }

    /// Detail of `level` in `rect`, and its energy.
    fn detail(&mut self, level: usize, coarser_size: (usize, usize), rect: Rect) {
        divided(&self.levels[level + 1], &mut self.plain);
        self.detail.reset(rect, [0.0; 4]);
        self.energy.reset(rect, 0.0);
        let (finer, detail, energy) = (&self.levels[level], &mut self.detail, &mut self.energy);
        self.filters.expand(&self.plain, coarser_size, rect, |y, expanded| {
            let pixels = finer.row(y)[rect.x - finer.rect.x..].iter().zip(expanded);
            for ((pixel, coarse), (detail, energy)) in pixels.zip(detail.row_mut(y).iter_mut().zip(energy.row_mut(y))) {
                if pixel[3] > 0.0 {
                    *detail = std::array::from_fn(|c| pixel[c] / pixel[3] - coarse[c]);
                    *energy = (0..3).map(|c| LUMA[c] * detail[c] * detail[c]).sum();
                }
                detail[3] = pixel[3];
            }
        });
    }

    /// The base in `rect`, and how much it deviates from its surroundings in `inner`.
    fn base(&mut self, level: usize, rect: Rect, size: (usize, usize), inner: Rect) {
        let coarsest = &self.levels[level];
        divided(coarsest, &mut self.plain);
        let near = inner.grown(reach::BASE_SMOOTHING / 2, size.0, size.1);
        let mut deviation = Patch::default();
        deviation.reset(near, 0.0);
        self.detail.reset(rect, [0.0; 4]);
        for y in rect.y..rect.y + rect.height {
            let from = &self.plain.row(y)[rect.x - self.plain.rect.x..][..rect.width];
            self.detail.row_mut(y).copy_from_slice(from);
        }
        // weighted mean of the surroundings, one channel after the other
        let (mut channel, mut mean, mut total) = (Patch::default(), Patch::default(), Patch::default());
        let mut smoothed = |c: usize, out: &mut Patch<f32>| {
            channel.reset(rect, 0.0);
            for y in rect.y..rect.y + rect.height {
                let from = coarsest.row(y)[rect.x - coarsest.rect.x..].iter();
                channel.row_mut(y).iter_mut().zip(from).for_each(|(to, pixel)| *to = pixel[c]);
            }
            self.filters.smooth_less(&channel, near, out);
        };
        smoothed(3, &mut total);
        for (c, part) in LUMA.iter().enumerate() {
            smoothed(c, &mut mean);
            for y in near.y..near.y + near.height {
                let own = self.plain.row(y)[near.x - self.plain.rect.x..].iter();
                let around = mean.row(y).iter().zip(total.row(y));
                for ((pixel, (mean, total)), deviation) in own.zip(around).zip(deviation.row_mut(y)) {
                    if pixel[3] > 0.0 {
                        let away = pixel[c] - mean / total;
                        *deviation += part * away * away;
                    }
                }
            }
        }
        self.filters.smooth_less(&deviation, inner, &mut self.smoothed);
    }

    /// Adds what was computed of one slice to the sums of `level`.
    fn enter(&mut self, level: usize, [across, down]: &[Vec<f32>; 2]) {
        let sums = &mut self.sums[level];
        let rect = sums.rect;
        for (y, &down) in down.iter().enumerate().skip(rect.y).take(rect.height) {
            let details = self.detail.row(y)[rect.x - self.detail.rect.x..].iter();
            let energies = self.smoothed.row(y).iter().zip(&across[rect.x..]);
            for ((sum, detail), (&energy, &across)) in sums.row_mut(y).iter_mut().zip(details).zip(energies) {
                let covered = detail[3] / (across * down);
                let weight = if covered >= ALL { weight(energy) } else { UNSURE * covered };
                for c in 0..3 {
                    sum[c] += weight * detail[c];
                }
                sum[3] += weight;
            }
        }
    }

    /// Puts the levels together, clamped and rounded; the number of pixels with a sample that had left the range
    /// of its depth by more than one grey level of 255.
    fn finish<const C: usize>(&mut self, canvas: &Canvas, rect: Rect, index: &Plane<u16>, out: &mut Vec<S>) -> usize {
        let levels = self.sums.len();
        let mut result = mem::take(&mut self.plain);
        divided(&self.sums[levels - 1], &mut result);
        for level in (0..levels - 1).rev() {
            let sums = &mut self.sums[level];
            self.filters.expand(&result, canvas.sizes.0[level + 1], sums.rect, |y, expanded| {
                for (sum, coarse) in sums.row_mut(y).iter_mut().zip(expanded) {
                    if sum[3] > 0.0 {
                        *sum = [
                            sum[0] / sum[3] + coarse[0],
                            sum[1] / sum[3] + coarse[1],
                            sum[2] / sum[3] + coarse[2],
                            1.0,
                        ];
                    }
                }
            });
            mem::swap(&mut result, sums);
        }

        out.clear();
        out.resize(rect.width * rect.height * C, S::default());
        let (scale, mut clamped) = (S::DEPTH.max() / 255.0, 0);
        for y in rect.y..rect.y + rect.height {
            let pixels = result.row(y).iter().zip(out[(y - rect.y) * rect.width * C..].chunks_exact_mut(C));
            let winners = &index.row(y)[rect.x..rect.x + rect.width];
            for ((x, (pixel, out)), &winner) in (rect.x..).zip(pixels).zip(winners) {
                if winner == UNCOVERED {
                    continue;
                }
                let mut outside = false;
                let [low, high] = self.range_around(x, y);
                for (c, out) in out.iter_mut().enumerate() {
                    outside |= pixel[c] < -1.0 || pixel[c] > 256.0;
                    *out = S::rounded(pixel[c].max(low[c]).min(high[c]) * scale);
                }
                clamped += usize::from(outside);
            }
        }
        self.plain = result;
        clamped
    }

    /// Least and largest samples of any slice in a pixel and those that touch it.
    fn range_around(&self, x: usize, y: usize) -> [Pixel; 2] {
        let [least, largest] = &self.range;
        let (left, right) = (x.saturating_sub(1).max(least.rect.x), (x + 2).min(least.rect.x + least.rect.width));
        let (top, bottom) = (y.saturating_sub(1).max(least.rect.y), (y + 2).min(least.rect.y + least.rect.height));
        let mut range = [[f32::INFINITY; 4], [f32::NEG_INFINITY; 4]];
        for y in top..bottom {
            let columns = left - least.rect.x..right - least.rect.x;
            for (low, high) in least.row(y)[columns.clone()].iter().zip(&largest.row(y)[columns]) {
                for c in 0..3 {
                    range[0][c] = range[0][c].min(low[c]);
                    range[1][c] = range[1][c].max(high[c]);
                }
            }
        }
        range
    }
}

/// Pixels divided by their weights, which stay; nothing where there is no weight.
fn divided(from: &Patch<Pixel>, to: &mut Patch<Pixel>) {
    to.rect = from.rect;
    to.data.clear();
    to.data.extend(from.data.iter().map(|&[r, g, b, weight]| match weight > 0.0 {
        true => [r / weight, g / weight, b / weight, weight],
        false => [0.0; 4],
    }));
}
