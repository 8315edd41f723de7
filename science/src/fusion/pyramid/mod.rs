//! Second pass of [`Method::Pyramid`](crate::types::fusion_options::Method): Laplacian pyramid fusion (Burt & Adelson
//! 1983; for stacks: Burt & Kolczynski 1993, Wang & Chang 2011).
//!
//! In: the warped slices. Out: the fused image. With `I_n,l` slice `n` at level `l`, `b` the binomial kernel of 5 taps
//! and `lambda_c` the luma weights of the channels:
//!
//! ```text
//! I_n,l+1 = (b * I_n,l) at every second pixel
//! D_n,l   = I_n,l - expand(I_n,l+1)               detail
//! E_n,l   = b * b * sum_c lambda_c D_n,l,c^2      energy of the detail, one for all channels
//! W_n,l   = (E_n,l + 1e-3)^4                      weight
//! D_l     = sum_n W_n,l D_n,l / sum_n W_n,l       fused detail
//! ```
//!
//! The base is fused by the same rule, with the energy of its deviation from its surroundings. The fused levels are
//! expanded and added. The reasons:
//!
//! - One weight for all channels: a colour is never composed of different slices.
//! - The fourth power instead of the maximum: where one slice stands out it gives the same, and where all slices show
//!   only noise it averages them instead of choosing the strongest noise.
//! - Where a slice does not cover all pixels that `I_n,l` depends on, its weight is below that of all others.
//! - A fused sample is clamped to the range of the slices in the 3 x 3 px around it, which removes overshoot.
//!
//! Each tile computes its levels from all pixels that it depends on ([`reach`]), so tiles do not affect the result.
//! Memory does not depend on the number of slices.

mod filter;
mod finest;
mod finish;
mod level_fusion;
mod reach;

use super::{
    align::{
        Aligned,
        relevance::{Relevance, Use},
    },
    run::Run,
    tiles::{Blended, in_tiles},
};
use crate::{
    imaging::{
        Coverage, LUMA, Rect, Sample,
        simd::{self, Avx2},
    },
    types::{Control, Interrupted},
};
use filter::{Filters, Level, Patch, WEIGHT};
use finest::{FinestLevel, SampleRange};
use level_fusion::{LevelFuser, LevelGeometry, SliceLevel};
use reach::{Reach, Sizes};

/// Number of halvings. The base has only what is coarser than about 30 px.
const LEVELS: usize = 4;

/// Runs the second pass. With `relevance`, level 0 is fused only from the slices that matter. Every pixel within
/// `margin` px of a shown pixel is fused.
pub(super) fn blend<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &Aligned,
    relevance: Option<&Relevance>,
    margin: usize,
) -> Result<Blended<S>, Interrupted> {
    let canvas = Canvas::new(run.plan.width, run.plan.height);
    in_tiles::<S, C, _>((run, aligned, margin), "fusing", Pyramid::default, |pyramid, rect, out| {
        pyramid.tile::<C>(&canvas, rect, (aligned, relevance), run.control, out)
    })
}

/// What all tiles share.
struct Canvas {
    sizes: Sizes,
    /// Per level, along x and along y: the fraction of the kernel of each pixel that lies on the canvas.
    weights: Vec<[Vec<f32>; 2]>,
}

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        let sizes = Sizes::of(width, height, LEVELS);
        let (widths, heights): (Vec<_>, Vec<_>) = sizes.0.iter().copied().unzip();
        let weights = filter::weights_along(&widths).into_iter().zip(filter::weights_along(&heights));
        Self { weights: weights.map(|(across, down)| [across, down]).collect(), sizes }
    }

    fn geometry(&self, level: usize) -> LevelGeometry<'_> {
        let size = self.sizes.0[level];
        let coarser = self.sizes.0.get(level + 1).copied().unwrap_or(size);
        let [across, down] = &self.weights[level];
        LevelGeometry { size, coarser, across, down }
    }
}

/// The buffers of one thread, reused from tile to tile.
#[derive(Default)]
struct Pyramid<S: Sample> {
    filters: Filters,
    fuser: LevelFuser,
    finest: FinestLevel<S>,
    /// The levels of a slice: values times covered fraction. Level 0 is used only if it is the only level.
    levels: Vec<Level>,
    /// One level of the slice: values.
    values: Level,
    /// Per level, summed over the slices: detail (or base) times weight, and weight.
    sums: Vec<Level>,
    /// Level 1, summed over the slices that enter level 0 with equal weights.
    equal: Level,
    /// The smallest and largest samples of all slices.
    range: SampleRange<S>,
}

impl<S: Sample> Pyramid<S> {
    /// Fuses the pixels of `rect` into `out`, interleaved. Returns the number of pixels with a sample that was clamped
    /// by more than one grey level of 255.
    fn tile<const C: usize>(
        &mut self,
        canvas: &Canvas,
        rect: Rect,
        (aligned, relevance): (&Aligned, Option<&Relevance>),
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
        let mut has_equal = false;
        if let Some(relevance) = relevance.filter(|_| levels > 1) {
            relevance.parts(0, rect, Use::Equally, |_| has_equal = true);
            self.equal.iter_mut().for_each(|plane| plane.reset(reach.result[1], 0.0));
        }

        for (slice, coverage) in aligned.coverages.iter().enumerate() {
            control.check()?;
            if coverage.misses(reach.source[0]) {
                continue;
            }
            self.finest.read::<C>(&aligned.scratch, slice, reach.source[0])?;
            self.range.add::<C>(&self.finest, coverage);
            match levels {
                1 => self.single_level::<C>(coverage, reach.source[0]),
                _ => self.finest.reduce::<C>(simd, coverage, reach.source[1], &mut self.levels[1]),
            }
            for level in 2..levels {
                let (finer, coarser) = self.levels.split_at_mut(level);
                for c in channels::<C>() {
                    let (from, to) = (&finer[level - 1][c], &mut coarser[0][c]);
                    self.filters.reduce(simd, from, reach.source[level], to);
                }
            }
            for level in 0..levels - 1 {
                normalised::<C>(simd, &self.levels[level + 1], &mut self.values);
                let source = match level {
                    0 => SliceLevel::Finest(&self.finest, coverage),
                    _ => SliceLevel::Coarser(&self.levels[level]),
                };
                let (geometry, sums) = (canvas.geometry(level), &mut self.sums[level]);
                let (fuser, values) = (&mut self.fuser, &self.values);
                match relevance.filter(|_| level == 0) {
                    None => fuser.add_detail::<S, C>(simd, &source, values, geometry, sums[WEIGHT].rect, sums),
                    Some(relevance) => {
                        let mut add = |part| fuser.add_detail::<S, C>(simd, &source, values, geometry, part, sums);
                        relevance.parts(slice, rect, Use::ByEnergy, &mut add);
                        if has_equal {
                            add_samples::<S, C>(simd, &self.finest, (relevance, slice, rect), sums);
                            add_level::<C>(simd, values, &mut self.equal);
                        }
                    }
                }
            }
            self.add_base::<C>(simd, canvas.geometry(levels - 1), reach.detail[levels - 1]);
        }
        if let Some(relevance) = relevance.filter(|_| has_equal) {
            self.subtract_coarse::<C>(canvas, relevance, rect, aligned.coverages.len());
        }
        Ok(self.finish::<C>(canvas, rect, &aligned.index, out))
    }

    /// Completes the sums of level 0 where all `slices` slices have equal weights: the sum of their details is the sum
    /// of their samples minus that of their expanded coarser levels.
    fn subtract_coarse<const C: usize>(&mut self, canvas: &Canvas, relevance: &Relevance, rect: Rect, slices: usize) {
        let Self { filters, equal, sums, .. } = self;
        let (simd, mut expanded, sums) = (Avx2::detect(), Vec::new(), &mut sums[0]);
        relevance.parts(0, rect, Use::Equally, |part| {
            let columns = part.x..part.x + part.width;
            for y in part.y..part.y + part.height {
                for (sum, equal) in sums[..C].iter_mut().zip(&*equal) {
                    let coarse = filters.expand(simd, equal, canvas.sizes.0[1], (y, &columns), &mut expanded);
                    let sum = sum.part_mut(part.x, y, part.width);
                    sum.iter_mut().zip(coarse).for_each(|(sum, coarse)| *sum -= *coarse);
                }
                sums[WEIGHT].part_mut(part.x, y, part.width).fill(slices as f32);
            }
        });
    }

    /// Level 0 of a slice on a canvas too small to be halved: its covered pixels in `rect`, in grey levels of 255.
    fn single_level<const C: usize>(&mut self, coverage: &Coverage, rect: Rect) {
        let scale = 255.0 / S::DEPTH.max();
        let level = &mut self.levels[0];
        level.iter_mut().for_each(|plane| plane.reset(rect, 0.0));
        for y in rect.y..rect.y + rect.height {
            let part = coverage.span_in(y, rect);
            for (plane, samples) in level.iter_mut().zip(&self.finest.planes).take(C) {
                let values = plane.row_mut(y)[part.clone()].iter_mut();
                values.zip(&samples.row(y)[part.clone()]).for_each(|(value, sample)| *value = sample.value() * scale);
            }
            level[WEIGHT].row_mut(y)[part].fill(1.0);
        }
    }

    /// Adds the base of a slice, weighted by the energy of its deviation from its surroundings in `rect`.
    fn add_base<const C: usize>(&mut self, simd: Option<Avx2>, geometry: LevelGeometry<'_>, rect: Rect) {
        let (Some(coarsest), Some(sums)) = (self.levels.last(), self.sums.last_mut()) else { return };
        let inner = sums[WEIGHT].rect;
        normalised::<C>(simd, coarsest, &mut self.values);
        let near = inner.grown(reach::BASE_REACH / 2, geometry.size.0, geometry.size.1);
        let mut deviation = Patch::default();
        deviation.reset(near, 0.0f32);
        // weighted mean of the surroundings, channel by channel
        let (mut channel, mut mean, mut total) = (Patch::default(), Patch::default(), Patch::default());
        let mut smoothed = |c: usize, out: &mut Patch<f32>| {
            channel.reset(rect, 0.0);
            for y in rect.y..rect.y + rect.height {
                channel.row_mut(y).copy_from_slice(coarsest[c].part(rect.x, y, rect.width));
            }
            self.filters.smooth(simd, &channel, near, out);
        };
        smoothed(WEIGHT, &mut total);
        for (c, part) in LUMA.iter().enumerate().take(C) {
            smoothed(c, &mut mean);
            for y in near.y..near.y + near.height {
                let own = self.values[c].part(near.x, y, near.width).iter();
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
        self.filters.smooth(simd, &deviation, inner, &mut energy);
        self.fuser.add_base::<C>(&self.values, &coarsest[WEIGHT], &energy, geometry, sums);
    }
}

/// Adds the samples of a slice, in grey levels of 255, where it enters level 0 with the same weight as all others.
fn add_samples<S: Sample, const C: usize>(
    simd: Option<Avx2>,
    finest: &FinestLevel<S>,
    (relevance, slice, rect): (&Relevance, usize, Rect),
    sums: &mut Level,
) {
    let scale = 255.0 / S::DEPTH.max();
    relevance.parts(slice, rect, Use::Equally, |part| {
        for (sum, plane) in sums[..C].iter_mut().zip(&finest.planes) {
            for y in part.y..part.y + part.height {
                let (sum, samples) = (sum.part_mut(part.x, y, part.width), plane.part(part.x, y, part.width));
                simd::run(
                    simd,
                    #[inline(always)]
                    || sum.iter_mut().zip(samples).for_each(|(sum, sample)| *sum += sample.value() * scale),
                );
            }
        }
    });
}

/// Adds the values of a level to the rectangle of `sums`.
fn add_level<const C: usize>(simd: Option<Avx2>, values: &Level, sums: &mut Level) {
    for (sum, values) in sums[..C].iter_mut().zip(values) {
        let rect = sum.rect;
        for y in rect.y..rect.y + rect.height {
            let (sum, values) = (sum.row_mut(y), values.part(rect.x, y, rect.width));
            simd::run(
                simd,
                #[inline(always)]
                || sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value),
            );
        }
    }
}

/// The planes of a level that are used with `C` channels: the channels and the weights.
fn channels<const C: usize>() -> impl Iterator<Item = usize> {
    (0..C).chain([WEIGHT])
}

/// The channels divided by their weights; 0 where the weight is 0.
fn normalised<const C: usize>(simd: Option<Avx2>, from: &Level, to: &mut Level) {
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
