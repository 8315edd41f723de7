//! Fuses one tile: per slice two guided filters give the weights of its base and its detail layer, which are summed.

use std::ops::Range;

use super::{
    layers::{LayerRow, Layers},
    presence::{Presence, Present},
};
use crate::{
    fusion::align::Aligned,
    imaging::{
        Plane, Rect, Sample,
        filter::{
            guided::{GRID, Guide, GuidedFilter},
            mean::MeanFilter,
        },
        grey,
        simd::Avx2,
    },
    types::{Control, Interrupted, fusion_options::GuidedParams},
};

/// The filters and buffers of one thread, reused from tile to tile.
pub(super) struct TileBlender<S> {
    simd: Option<Avx2>,
    for_base: GuidedFilter,
    for_detail: GuidedFilter,
    mean: MeanFilter,
    region: Region<S>,
    layers: Layers,
    row: LayerRow,
}

/// The pixels of one slice in a tile and the margin of its filters.
struct Region<S> {
    samples: Vec<S>,
    bytes: Vec<u8>,
    /// The guide of the guided filters: luma, 0..65535.
    grey: Plane<u16>,
    /// Where the slice is the sharpest.
    map: Plane<bool>,
    /// Per row: the columns that the slice covers.
    valid: Vec<Range<usize>>,
}

impl<S: Sample> TileBlender<S> {
    pub(super) fn new(params: &GuidedParams) -> Self {
        let empty = || Plane { width: 0, height: 0, data: Vec::new() };
        Self {
            simd: Avx2::detect(),
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
            layers: Layers::default(),
            row: LayerRow::default(),
        }
    }

    /// Fuses the pixels of `rect` into `out`, interleaved. Returns the number of pixels with a sample that was clamped
    /// by more than one grey level of 255.
    pub(super) fn tile<const C: usize>(
        &mut self,
        rect: Rect,
        aligned: &Aligned,
        presence: &Presence,
        control: &dyn Control,
        out: &mut Vec<S>,
    ) -> Result<usize, Interrupted> {
        let (width, height) = (aligned.index.width, aligned.index.height);
        let in_base = presence.within(rect.grown(self.for_base.reach(), width, height));
        let in_detail = presence.within(rect.grown(self.for_detail.reach(), width, height));
        let present = if self.for_base.reach() > self.for_detail.reach() { &in_base } else { &in_detail };
        if let Present { slices, uncovered: false } = present
            && let [alone] = slices[..]
        {
            // both weights are exactly 1, so base plus detail is the slice itself
            aligned.scratch.read(alone, rect, out, &mut self.region.bytes)?;
            return Ok(0);
        }

        self.layers.clear(rect.width, rect.height, C);
        for &slice in &present.slices {
            control.check()?;
            if aligned.coverages[slice].misses(rect) {
                continue;
            }
            let weighted = [in_base.slices.contains(&slice), in_detail.slices.contains(&slice)];
            self.add::<C>(slice, rect, aligned, weighted)?;
        }
        Ok(self.finish::<C>(rect, out))
    }

    /// Adds one slice. `weighted` says in which layers, base and detail, its weight can be above 0.
    fn add<const C: usize>(
        &mut self,
        slice: usize,
        rect: Rect,
        aligned: &Aligned,
        weighted: [bool; 2],
    ) -> Result<(), Interrupted> {
        let margin = self.for_base.reach().max(self.for_detail.reach()).max(self.mean.reach());
        let whole = rect.grown(margin, aligned.index.width, aligned.index.height);
        let (x, y) = (whole.x / GRID * GRID, whole.y / GRID * GRID);
        let whole = Rect { x, y, width: whole.x + whole.width - x, height: whole.y + whole.height - y };
        let inner = Rect { x: rect.x - whole.x, y: rect.y - whole.y, ..rect };
        self.region.load::<C>(slice, whole, aligned)?;

        let Self { simd, for_base, for_detail, mean, region, layers, row } = self;
        let guide = Guide { grey: &region.grey, valid: &region.valid };
        // a filter whose result is 0 everywhere is not run
        let mut filtered = [
            weighted[0].then(|| for_base.rows(guide, &region.map, inner)),
            weighted[1].then(|| for_detail.rows(guide, &region.map, inner)),
        ];
        let mut means = mean.rows::<S, C>(&region.samples, whole.width, &region.valid, inner);
        for weights in &mut row.weights {
            weights.clear();
            weights.resize(rect.width, 0.0);
        }
        row.means.resize(rect.width * C, 0.0);
        for y in 0..rect.height {
            for (rows, weights) in filtered.iter_mut().zip(&mut row.weights) {
                match rows {
                    Some(rows) => rows.next(weights),
                    // `Layers::add` has added to the weights of the row before
                    None => weights.fill(0.0),
                }
            }
            means.next(&mut row.means);
            let start = (inner.y + y) * whole.width + inner.x;
            let samples = &region.samples[start * C..(start + rect.width) * C];
            let sharpest = &region.map.data[start..start + rect.width];
            layers.add::<S, C>(*simd, y, samples, sharpest, row);
        }
        Ok(())
    }

    /// Writes base plus detail, clamped and rounded. Returns the number of pixels with a sample that was clamped by
    /// more than one grey level of 255.
    fn finish<const C: usize>(&self, rect: Rect, out: &mut Vec<S>) -> usize {
        out.clear();
        out.resize(rect.width * rect.height * C, S::default());
        let rows = out.chunks_exact_mut((rect.width * C).max(1)).enumerate();
        rows.map(|(y, out)| self.layers.finish::<S, C>(self.simd, y, out)).sum()
    }
}

impl<S: Sample> Region<S> {
    /// Reads `rect` of slice `slice`.
    fn load<const C: usize>(&mut self, slice: usize, rect: Rect, aligned: &Aligned) -> Result<(), Interrupted> {
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
        self.map.data.resize(rect.width * rect.height, false);
        let slice = slice as u16;
        for (y, map) in (rect.y..).zip(self.map.data.chunks_exact_mut(rect.width.max(1))) {
            let sharpest = &aligned.index.row(y)[rect.x..rect.x + rect.width];
            map.iter_mut().zip(sharpest).for_each(|(inside, &sharpest)| *inside = sharpest == slice);
        }
        Ok(())
    }
}
