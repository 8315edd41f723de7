//! One tile of the second pass: weights by guided filters, two layers, blended.

use std::ops::Range;

use super::{
    UNCOVERED,
    align::Aligned,
    presence::{Presence, Present},
};
use crate::{
    imaging::{
        Plane, Rect, Sample,
        filter::{
            guided::{Guide, GuidedFilter},
            mean::MeanFilter,
        },
        grey,
    },
    model::{Control, Stop, options::GuidedParams},
};

/// What the weight of the winning slice is raised by, so that weights never sum up to 0 (Kang's GFF.m).
const FLOOR: f32 = 1e-12;

/// The filters and buffers of one thread, used for tile after tile.
pub(super) struct Blender<S> {
    for_base: GuidedFilter,
    for_detail: GuidedFilter,
    mean: MeanFilter,
    region: Region<S>,
    weights: [Vec<f32>; 2],
    means: Vec<f32>,
    base: Layer,
    detail: Layer,
}

/// A slice's pixels in and around a tile.
struct Region<S> {
    samples: Vec<S>,
    bytes: Vec<u8>,
    grey: Plane<u16>,
    map: Plane<bool>,
    valid: Vec<Range<usize>>,
}

/// Weighted sum of one layer over the slices.
#[derive(Default)]
struct Layer {
    sums: Vec<f32>,
    weights: Vec<f32>,
}

impl Layer {
    fn clear(&mut self, pixels: usize, channels: usize) {
        self.sums.clear();
        self.sums.resize(pixels * channels, 0.0);
        self.weights.clear();
        self.weights.resize(pixels, 0.0);
    }
}

impl<S: Sample> Blender<S> {
    pub fn new(params: &GuidedParams) -> Self {
        let empty = || Plane { width: 0, height: 0, data: Vec::new() };
        Self {
            for_base: GuidedFilter::new(params.r1 as usize, params.eps1),
            for_detail: GuidedFilter::new(params.r2 as usize, params.eps2),
            mean: MeanFilter::new(params.average as usize),
            region: Region {
                samples: Vec::new(),
                bytes: Vec::new(),
                grey: empty(),
                map: Plane { width: 0, height: 0, data: Vec::new() },
                valid: Vec::new(),
            },
            weights: [Vec::new(), Vec::new()],
            means: Vec::new(),
            base: Layer::default(),
            detail: Layer::default(),
        }
    }

    /// Fuses the pixels of `rect` into `out` (interleaved, `C` channels) and says in how many of them a
    /// sample had to be clamped.
    pub fn tile<const C: usize>(
        &mut self,
        rect: Rect,
        aligned: &Aligned,
        presence: &Presence,
        control: &dyn Control,
        out: &mut Vec<S>,
    ) -> Result<usize, Stop> {
        let (width, height) = (aligned.index.width, aligned.index.height);
        let in_base = presence.within(rect.grown(self.for_base.reach(), width, height));
        let in_detail = presence.within(rect.grown(self.for_detail.reach(), width, height));
        let present = if self.for_base.reach() > self.for_detail.reach() { &in_base } else { &in_detail };
        if let Present { slices, uncovered: false } = present
            && let [alone] = slices[..]
        {
            // Both weights are exactly 1, and base and detail add up to the slice.
            aligned.scratch.read(alone, rect, out, &mut self.region.bytes)?;
            return Ok(0);
        }

        let pixels = rect.width * rect.height;
        self.base.clear(pixels, C);
        self.detail.clear(pixels, C);
        for &slice in &present.slices {
            control.check()?;
            if aligned.coverages[slice].misses(rect) {
                continue;
            }
            let layers = [in_base.slices.contains(&slice), in_detail.slices.contains(&slice)];
            self.add::<C>(slice, rect, aligned, layers)?;
        }
        Ok(self.finish::<C>(rect, &aligned.index, out))
    }

    /// Adds one slice to the layers in which it can have any weight.
    fn add<const C: usize>(
        &mut self,
        slice: usize,
        rect: Rect,
        aligned: &Aligned,
        layers: [bool; 2],
    ) -> Result<(), Stop> {
        let margin = self.for_base.reach().max(self.for_detail.reach()).max(self.mean.reach());
        let whole = rect.grown(margin, aligned.index.width, aligned.index.height);
        let inner = Rect { x: rect.x - whole.x, y: rect.y - whole.y, ..rect };
        self.region.load::<C>(slice, whole, aligned)?;

        let guide = Guide { grey: &self.region.grey, valid: &self.region.valid };
        let filters = [&mut self.for_base, &mut self.for_detail];
        for ((filter, weights), wanted) in filters.into_iter().zip(&mut self.weights).zip(layers) {
            weights.clear();
            weights.resize(rect.width * rect.height, 0.0);
            if wanted {
                filter.apply(guide, &self.region.map, inner, weights);
            }
        }
        self.means.resize(rect.width * rect.height * C, 0.0);
        let Region { samples, valid, map, .. } = &self.region;
        self.mean.apply::<S, C>(samples, whole.width, valid, inner, &mut self.means);

        for y in 0..rect.height {
            let row = y * rect.width..(y + 1) * rect.width;
            let start = (inner.y + y) * whole.width + inner.x;
            let pixels = samples[start * C..(start + rect.width) * C].chunks_exact(C);
            let means = self.means[row.start * C..row.end * C].chunks_exact(C);
            let won = &map.data[start..start + rect.width];
            let weights = self.weights[0][row.clone()].iter().zip(&self.weights[1][row.clone()]);
            let base = self.base.sums[row.start * C..row.end * C].chunks_exact_mut(C);
            let detail = self.detail.sums[row.start * C..row.end * C].chunks_exact_mut(C);
            let totals = self.base.weights[row.clone()].iter_mut().zip(&mut self.detail.weights[row]);
            let sums = base.zip(detail).zip(totals);
            for ((((pixel, mean), &won), (&wb, &wd)), ((base, detail), (base_total, detail_total))) in
                pixels.zip(means).zip(won).zip(weights).zip(sums)
            {
                let floor = if won { FLOOR } else { 0.0 };
                let (wb, wd) = (wb.clamp(0.0, 1.0) + floor, wd.clamp(0.0, 1.0) + floor);
                for c in 0..C {
                    base[c] += wb * mean[c];
                    detail[c] += wd * (pixel[c].value() - mean[c]);
                }
                *base_total += wb;
                *detail_total += wd;
            }
        }
        Ok(())
    }

    /// Base plus detail, clamped and rounded; the number of pixels with a sample that had to be clamped by more
    /// than one grey level of 255.
    fn finish<const C: usize>(&self, rect: Rect, index: &Plane<u16>, out: &mut Vec<S>) -> usize {
        out.clear();
        out.resize(rect.width * rect.height * C, S::default());
        // up to one grey level of 8 bits beyond the range is no halo that anyone could see
        let level = S::DEPTH.max() / 255.0;
        let (low, high) = (-level, S::DEPTH.max() + level);
        let mut clamped = 0;
        for y in 0..rect.height {
            let winners = &index.row(rect.y + y)[rect.x..rect.x + rect.width];
            for (x, &winner) in winners.iter().enumerate() {
                if winner == UNCOVERED {
                    continue;
                }
                let at = y * rect.width + x;
                let (base_total, detail_total) = (self.base.weights[at], self.detail.weights[at]);
                let mut outside = false;
                let samples = at * C..(at + 1) * C;
                let layers = self.base.sums[samples.clone()].iter().zip(&self.detail.sums[samples.clone()]);
                for (out, (base, detail)) in out[samples].iter_mut().zip(layers) {
                    let value = base / base_total + detail / detail_total;
                    outside |= value < low || value > high;
                    *out = S::rounded(value);
                }
                clamped += usize::from(outside);
            }
        }
        clamped
    }
}

impl<S: Sample> Region<S> {
    fn load<const C: usize>(&mut self, slice: usize, rect: Rect, aligned: &Aligned) -> Result<(), Stop> {
        aligned.scratch.read(slice, rect, &mut self.samples, &mut self.bytes)?;
        self.valid.clear();
        self.valid.extend(aligned.coverages[slice].spans_in(rect));
        for (width, height) in
            [(&mut self.grey.width, &mut self.grey.height), (&mut self.map.width, &mut self.map.height)]
        {
            (*width, *height) = (rect.width, rect.height);
        }
        self.grey.data.resize(rect.width * rect.height, 0);
        grey::guide_row(&self.samples, C, &mut self.grey.data);
        self.map.data.clear();
        for y in rect.y..rect.y + rect.height {
            let winners = &aligned.index.row(y)[rect.x..rect.x + rect.width];
            self.map.data.extend(winners.iter().map(|&winner| usize::from(winner) == slice));
        }
        Ok(())
    }
}
