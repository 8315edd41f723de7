//! Near parts whose detail is weaker than that of what lies behind them.
//!
//! A thin near part is transparent where it is blurred. So in the slice of strong texture behind it, the texture can
//! have more focus energy than the near part has in its own slice, and the argmax takes the far slice. But in the slice
//! of the near part, the texture shows only its own blur, which can be predicted. Detail beyond the prediction belongs
//! to the near part, even where the texture has ten times as much energy. Let `b` be the slice of a pixel, `a` a nearer
//! slice from which it is separable, `D` the disc of blur between them, `E` the focus energy at fine scale, and `E_0`
//! the energy of noise. The pixel shows detail of a near part if
//!
//! - `U = E(I_a - D * I_b)` is at least `0.5 E(I_a)`, and
//! - both `U` and `E(I_a)` are at least `0.1 E(I_b)` and `32 E_0`.
//!
//! Only slices `a` are tried whose energy in the cell of the pixel is a peak: it is a local maximum over the slices,
//! more than `4 E_0`, at least a tenth of the largest, and at least 1.7 times the smallest between it and the largest.
//! If several slices `a` fulfil all conditions, the one with the largest `U` counts.
//!
//! The energy of detail extends about [`RIM`] px beyond it. So a pixel keeps its slice if a pixel within that distance
//! is taken from a slice over which `a` can spread blur.

use std::{collections::BTreeMap, mem};

use rayon::prelude::*;

use super::{
    super::pixel_groups::in_blocks,
    refinement::{Refinement, TEXTURED, Tile},
};
use crate::{
    fusion::{
        align::{
            cell_energies::{STEPS, code_of},
            coarse_focus::CELL,
        },
        halo_corrected::{defocus_model::DefocusModel, pixel_groups::PixelGroups},
        plan::UNCOVERED,
    },
    imaging::{
        Plane, Rect, Sample,
        filter::{
            disc::Disc,
            focus::{FocusEnergy, Rows},
        },
    },
    types::Interrupted,
};

/// How far the energy of detail extends beyond it, px.
pub(super) const RIM: usize = 2;

/// Energy that blur must leave unexplained, in multiples of that of the near slice.
const OF_NEAR: f32 = 0.5;
/// Least energy of the detail of a near part, in multiples of that of the far slice, ...
const OF_FAR: f32 = 0.1;
/// ... and of that of noise. At fine scale noise has about eight times as much energy as at the scale of the decision
/// map, for which it is known.
const OF_NOISE: f32 = 8.0 * TEXTURED;

/// A peak has at least a tenth of the largest energy in its cell: the factor 10, in steps of the code of an energy.
const BELOW_LARGEST: u8 = (STEPS * 10 / 3) as u8;
/// A peak has at least 1.7 times the smallest energy between it and the largest: that factor, in the same steps.
const ABOVE_VALLEY: u8 = (STEPS * 3 / 4) as u8;

/// A pixel of a far slice that shows detail of a near part.
pub(super) struct NearDetail {
    /// Index of the pixel on the canvas, row by row.
    at: usize,
    /// The slice of the near part.
    near: u16,
    /// Its energy that blur of the far part does not explain.
    unexplained: f32,
}

impl<S: Sample, const C: usize> Refinement<'_, S, C> {
    /// Finds the pixels of `tile` that show detail of near parts.
    pub(super) fn near_detail(&self, tile: &Tile, rows: &mut Rows) -> Result<Vec<NearDetail>, Interrupted> {
        let mut found = Vec::new();
        if !self.model.has_spread() {
            return Ok(found);
        }
        let measure = FocusEnergy::for_edges();
        for ((near, far), pixels) in self.candidates(tile)? {
            let disc = Disc::new(self.model.radius(near.into(), far.into()));
            for (bounds, pixels) in in_blocks(&pixels, |&at| at, tile.rect, measure.reach() + disc.reach()) {
                self.compare((near, far), &disc, tile.rect, (bounds, &pixels), rows, &mut found)?;
            }
        }
        found.sort_unstable_by(|one, other| {
            one.at.cmp(&other.at).then(other.unexplained.total_cmp(&one.unexplained)).then(one.near.cmp(&other.near))
        });
        found.dedup_by_key(|detail| detail.at);
        Ok(found)
    }

    /// The pixels of `tile` to look at, by the near slice to try and the far slice to compare it with.
    fn candidates(&self, tile: &Tile) -> Result<BTreeMap<(u16, u16), Vec<usize>>, Interrupted> {
        let Rect { x, y, width, height } = tile.rect;
        let cells = Rect { x: x / CELL, y: y / CELL, width: width.div_ceil(CELL), height: height.div_ceil(CELL) };
        let peaks = self.peaks(cells)?;
        let alike = alike(self.model, self.slices.count());
        let mut groups = PixelGroups::new();
        for (near, cell) in peaks {
            let (left, top) = (cell % cells.width * CELL, cell / cells.width * CELL);
            for row in top..(top + CELL).min(height) {
                let covered = self.slices.coverage(near.into()).span(y + row);
                for column in left..(left + CELL).min(width) {
                    let at = row * width + column;
                    let own = tile.slice[at];
                    let is_behind = |far: u16| self.model.spreads_over(near.into(), far.into());
                    if own != UNCOVERED && is_behind(own) && covered.contains(&(x + column)) {
                        let far = alike[usize::from(own)];
                        groups.add((near, if is_behind(far) { far } else { own }), at);
                    }
                }
            }
        }
        Ok(groups.finish())
    }

    /// The peaks of the energy in each of `cells`: slice and index of the cell.
    fn peaks(&self, cells: Rect) -> Result<Vec<(u16, usize)>, Interrupted> {
        let count = self.slices.count();
        let (mut codes, mut bytes) = (vec![Vec::new(); count], Vec::new());
        // per cell: the largest code, and its slice
        let mut largest = vec![(0u8, 0); cells.width * cells.height];
        for (slice, codes) in codes.iter_mut().enumerate() {
            self.focus.cells.read(slice, cells, codes, &mut bytes)?;
            for (largest, &code) in largest.iter_mut().zip(&*codes).filter(|(largest, code)| largest.0 < **code) {
                *largest = (code, slice);
            }
        }
        let textured = code_of(TEXTURED * self.focus.coarse.noise);
        let mut peaks = Vec::new();
        for slice in 0..count {
            for (cell, (&code, &(most, sharpest))) in codes[slice].iter().zip(&largest).enumerate() {
                // of equal neighbours the first is the peak
                let is_peak = slice != sharpest
                    && code > textured
                    && code >= most.saturating_sub(BELOW_LARGEST)
                    && (slice == 0 || code > codes[slice - 1][cell])
                    && (slice + 1 == count || code >= codes[slice + 1][cell]);
                let between = slice.min(sharpest)..slice.max(sharpest);
                let is_low = |codes: &Vec<u8>| codes[cell].saturating_add(ABOVE_VALLEY) <= code;
                if is_peak && codes[between].iter().any(is_low) {
                    peaks.push((slice as u16, cell));
                }
            }
        }
        Ok(peaks)
    }

    /// Adds those of `pixels` to `found` where slice `near` shows detail that blur of slice `far` by `disc` does not
    /// explain. The pixels are those of the tile `tile`, and lie within `bounds`.
    fn compare(
        &self,
        (near, far): (u16, u16),
        disc: &Disc,
        tile: Rect,
        (bounds, pixels): (Rect, &[usize]),
        rows: &mut Rows,
        found: &mut Vec<NearDetail>,
    ) -> Result<(), Interrupted> {
        let (width, height) = self.slices.size();
        let measure = FocusEnergy::for_edges();
        let core = bounds.grown(measure.reach(), width, height);
        let window = disc.window(core, width, height);
        let inner = Rect { x: core.x - window.x, y: core.y - window.y, ..core };
        let of_near = self.slices.luma(near.into(), core)?;
        let of_far = self.slices.luma(far.into(), window)?;
        let mut difference = disc.blurred_in(&of_far, inner);
        difference.data.iter_mut().zip(&of_near.data).for_each(|(blurred, near)| *blurred = near - *blurred);
        let [unexplained, of_near, of_far] =
            [&difference, &of_near, &of_far.crop(inner)].map(|luma| measure.plane(luma, rows));
        let least = OF_NOISE * self.focus.coarse.noise;
        for &at in pixels {
            let (x, y) = (tile.x + at % tile.width, tile.y + at / tile.width);
            let of = |energy: &Plane<f32>| energy.at(x - core.x, y - core.y);
            let unexplained = of(&unexplained);
            let (near_energy, far_energy) = (of(&of_near), of(&of_far));
            let detail = unexplained.min(near_energy);
            if unexplained >= OF_NEAR * near_energy && detail >= OF_FAR * far_energy && detail >= least {
                found.push(NearDetail { at: y * width + x, near, unexplained });
            }
        }
        Ok(())
    }
}

/// Per slice: one that is not separable from it, the same for several neighbours, so that they can be compared in one
/// go.
fn alike(model: &DefocusModel, count: usize) -> Vec<u16> {
    let mut alike = Vec::with_capacity(count);
    while alike.len() < count {
        let first = alike.len();
        let end = (first + 1..count).find(|&slice| model.separable(first, slice)).unwrap_or(count);
        alike.resize(end, ((first + end) / 2) as u16);
    }
    alike
}

/// Gives the pixels `found` to the near slices, except those within [`RIM`] px of a pixel that is taken from a slice
/// over which the near one can spread blur.
pub(super) fn apply(
    (slices, textured): (&mut Plane<u16>, &mut Plane<bool>),
    found: Vec<NearDetail>,
    model: &DefocusModel,
) {
    let own: Vec<u16> = found.iter().map(|detail| mem::replace(&mut slices.data[detail.at], detail.near)).collect();
    let is_rim = |detail: &NearDetail| {
        let (x, y) = (detail.at % slices.width, detail.at / slices.width);
        (y.saturating_sub(RIM)..(y + RIM + 1).min(slices.height)).any(|v| {
            let columns = x.saturating_sub(RIM)..(x + RIM + 1).min(slices.width);
            columns.into_iter().any(|u| {
                let slice = slices.at(u, v);
                let is_near = u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2) <= RIM * RIM;
                is_near && slice != UNCOVERED && model.spreads_over(detail.near.into(), slice.into())
            })
        })
    };
    let rim: Vec<bool> = found.par_iter().map(is_rim).collect();
    for ((detail, own), is_rim) in found.iter().zip(own).zip(rim) {
        match is_rim {
            true => slices.data[detail.at] = own,
            false => textured.data[detail.at] = true,
        }
    }
}
