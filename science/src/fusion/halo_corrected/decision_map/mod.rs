//! The decision map: per pixel, the slice in which it is sharp.
//!
//! In: the sharpest slice per pixel (argmax of the focus energy), its energy, and the coarse focus. Out: a
//! [`DecisionMap`].
//!
//! The argmax is wrong beside strong detail: a strong edge, defocused, can have more focus energy than the smooth
//! surface over which it spreads has in any slice. That blur can be predicted. For each scale of the coarse focus, from
//! narrow to wide, let `a` be the slice that is sharpest around a pixel, `b` the pixel's own slice, `r` the blur radius
//! between them, `D` the disc of that radius, `E` the focus energy, and `E_around` that of `a` in the window of the
//! scale. A pixel takes `a` instead of `b`
//!
//! | pixel | when |
//! |---|---|
//! | without texture | `a` and `b` are separable, or nothing around the pixel has texture |
//! | textured, but `E(I_b) <= 0.045 E_around` at the narrow scale | both are separable |
//! | textured | both are separable, `E(I_b) <= max(8 / r^2, 1 / 12) E_around`, and `E(I_b - D * I_a) < 0.2 E(I_b)` |
//!
//! The second row: beside strong detail, such as a bright outline on black ground, the rim of its disc has weak energy
//! at every distance, in one slice or another. That slice would be taken for the slice of another part, and blur would
//! be removed that is not there. No prediction is exact enough to tell, so such a pixel counts as one without texture.
//!
//! The second condition of the last row saves time: blur leaves little of the energy of detail, so a pixel with more
//! than that has detail of its own, and no prediction is made for it.
//!
//! The argmax is also wrong where a thin or smooth near part lies before strong texture: [`near_detail`] finds such
//! parts. Finally, a median filter removes outliers.

mod given;
mod median_filter;
mod near_detail;

use std::{collections::BTreeMap, sync::Arc};

use rayon::prelude::*;

use super::{
    defocus_model::DefocusModel,
    pixel_groups::{PixelGroups, bounding_box},
    warped_slices::WarpedSlices,
};
use crate::{
    fusion::{
        align::{
            cell_energies::CellEnergies,
            coarse_focus::{CELL, CoarseFocusMaps},
            focus_code::FocusCode,
        },
        plan::UNCOVERED,
        run::Run,
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
pub(super) use given::given;
use median_filter::{MEDIAN_REACH, median_filter};
use near_detail::NearDetail;

/// Focus energy, in multiples of that of noise, from which a pixel has texture.
pub(super) const TEXTURED: f32 = 4.0;

/// Share of a pixel's energy that a prediction may leave unexplained.
const MAX_UNEXPLAINED: f32 = 0.2;

/// Energy of a pixel, in multiples of the mean energy around it, up to which blur by a disc of radius `r` px can
/// explain it: `REMAINING / r^2`, and at least `MIN_REMAINING`, because the rim of a large disc is sharp.
const REMAINING: f32 = 8.0;
const MIN_REMAINING: f32 = 1.0 / 12.0;

/// Energy of a textured pixel, in multiples of the mean energy around it at the narrow scale, up to which it counts as
/// one without texture: the rim of a disc of blur has as much.
const WEAK: f32 = 0.045;

/// Side of the tiles, px. Tiles consist of whole cells of the coarse focus and give two planes, so the tile driver of
/// the second pass, which cuts the canvas into equal parts and gives samples, does not serve here.
const TILE: usize = 256;

/// Sides of the blocks in which predictions are made, px. The margin around a block costs more than the block, but
/// blurring all that lies between scattered pixels costs more still: the cheapest side is chosen.
const BLOCK_SIDES: [usize; 4] = [256, 64, 32, 16];

/// Fixed cost of a block, in pixels.
const BLOCK_COST: usize = 1000;

/// Per pixel, the slice it is taken from.
pub(crate) struct DecisionMap {
    /// 0-based index of the slice; [`UNCOVERED`] where no slice covers the canvas. Shared with the result of the first
    /// pass, whose index it replaces.
    pub slice: Arc<Plane<u16>>,
    /// Whether the pixel has detail of its own in that slice.
    pub textured: Plane<bool>,
}

/// What the first pass measured.
#[derive(Clone, Copy)]
pub(super) struct MeasuredFocus<'a> {
    /// Per pixel, the slice with the largest focus energy.
    pub sharpest: &'a Plane<u16>,
    /// Per pixel, that energy.
    pub energy: &'a Plane<FocusCode>,
    pub coarse: &'a CoarseFocusMaps,
    pub cells: &'a CellEnergies,
}

/// Refines the argmax of the focus energy; `textured` is where that energy is more than noise. Blur is predicted within
/// `margin` px of every shown pixel; what is farther away is refined as if nothing could be predicted.
pub(super) fn refine<S: Sample, const C: usize>(
    (run, margin): (&Run<'_>, usize),
    slices: &WarpedSlices<'_, S, C>,
    focus: MeasuredFocus<'_>,
    textured: Plane<bool>,
    model: &DefocusModel,
) -> Result<DecisionMap, Interrupted> {
    let (width, height) = slices.size();
    let tiles: Vec<Rect> = (0..height)
        .step_by(TILE)
        .flat_map(|y| {
            (0..width).step_by(TILE).map(move |x| Rect {
                x,
                y,
                width: TILE.min(width - x),
                height: TILE.min(height - y),
            })
        })
        .collect();
    let refinement = Refinement { slices, focus, textured: &textured, model };
    let tiles: Vec<Tile> = tiles
        .into_par_iter()
        .with_max_len(1)
        .map_init(Rows::default, |rows, rect| {
            let matters = run.part_to_fuse(rect, margin + MEDIAN_REACH + near_detail::RIM).is_some();
            refinement.tile(rect, matters, rows)
        })
        .collect::<Result<_, Interrupted>>()?;
    let (mut slice, mut textured) = (Plane::filled(width, height, 0), textured);
    let band = (width * TILE).max(1);
    let bands = slice.data.par_chunks_mut(band).zip(textured.data.par_chunks_mut(band));
    bands.zip(tiles.par_chunks(width.div_ceil(TILE).max(1))).for_each(|((slices, textured), tiles)| {
        for Tile { rect, slice, textured: has_texture, .. } in tiles {
            for y in 0..rect.height {
                let (from, to) = (y * rect.width, y * width + rect.x);
                slices[to..to + rect.width].copy_from_slice(&slice[from..from + rect.width]);
                textured[to..to + rect.width].copy_from_slice(&has_texture[from..from + rect.width]);
            }
        }
    });
    let found = tiles.into_iter().flat_map(|tile| tile.near_detail).collect();
    near_detail::apply((&mut slice, &mut textured), found, model);
    Ok(DecisionMap { slice: Arc::new(median_filter(slices, &slice)), textured })
}

/// The part `rect` of a decision map.
struct Tile {
    rect: Rect,
    slice: Vec<u16>,
    textured: Vec<bool>,
    /// Pixels of far slices that show detail of a near part.
    near_detail: Vec<NearDetail>,
}

struct Refinement<'a, S, const C: usize> {
    slices: &'a WarpedSlices<'a, S, C>,
    focus: MeasuredFocus<'a>,
    textured: &'a Plane<bool>,
    model: &'a DefocusModel,
}

impl<S: Sample, const C: usize> Refinement<'_, S, C> {
    fn tile(&self, rect: Rect, predicts: bool, rows: &mut Rows) -> Result<Tile, Interrupted> {
        let columns = rect.x..rect.x + rect.width;
        let MeasuredFocus { sharpest, energy, coarse, .. } = self.focus;
        let (slice, textured) = (sharpest.crop(rect).data, self.textured.crop(rect).data);
        let mut tile = Tile { rect, slice, textured, near_detail: Vec::new() };
        for (number, scale) in coarse.scales.iter().enumerate() {
            let weak = if number == 0 { WEAK } else { 0.0 };
            // textured pixels, by (slice that is sharpest around them, own slice)
            let mut candidates = PixelGroups::new();
            for row in 0..rect.height {
                let y = rect.y + row;
                let line = row * rect.width..(row + 1) * rect.width;
                let (slices, textured) = (&mut tile.slice[line.clone()], &mut tile.textured[line.clone()]);
                let energies = &energy.row(y)[columns.clone()];
                let around = scale.slice.row(y / CELL).iter().zip(scale.energy.row(y / CELL));
                let around = around.zip(coarse.textureless.row(y / CELL)).skip(rect.x / CELL);
                let cells = slices.chunks_mut(CELL).zip(textured.chunks_mut(CELL)).zip(around);
                for (i, ((slices, textured), ((&around, &around_energy), &textureless))) in cells.enumerate() {
                    // cells are whole except at the border of the canvas, and whole ones are compared at once
                    let settled = match slices.first_chunk::<CELL>() {
                        Some(cell) => *cell == [around; CELL],
                        None => slices.iter().all(|&own| own == around),
                    };
                    if around == UNCOVERED || settled {
                        continue;
                    }
                    let covered = self.slices.coverage(usize::from(around)).span(y);
                    for (k, (own, textured)) in slices.iter_mut().zip(textured).enumerate() {
                        let column = i * CELL + k;
                        let (known, there) = (*own != UNCOVERED, covered.contains(&(rect.x + column)));
                        let has_texture = *textured && energies[column].value() > weak * around_energy;
                        let separable = || self.model.separable(usize::from(*own), usize::from(around));
                        if !known || !there || !((textureless && !has_texture) || separable()) {
                            continue;
                        }
                        if !has_texture {
                            (*own, *textured) = (around, false);
                        } else if predicts
                            && energies[column].value()
                                <= explicable(around_energy, self.model.radius(around.into(), (*own).into()))
                        {
                            candidates.add((around, *own), line.start + column);
                        }
                    }
                }
            }
            for ((around, own), pixels) in candidates.finish() {
                let (around, own) = (usize::from(around), usize::from(own));
                let disc = Disc::new(self.model.radius(around, own));
                let reach = FocusEnergy::for_decision_map().reach() + disc.reach();
                for (bounds, pixels) in in_blocks(&pixels, rect, reach) {
                    self.predict(&mut tile, around, own, &disc, (bounds, &pixels), rows)?;
                }
            }
        }
        if predicts {
            tile.near_detail = self.near_detail(&tile, rows)?;
        }
        Ok(tile)
    }

    /// Gives `pixels` of slice `own`, which lie within `bounds`, to slice `around` where its blur by `disc` explains
    /// them.
    fn predict(
        &self,
        tile: &mut Tile,
        around: usize,
        own: usize,
        disc: &Disc,
        (bounds, pixels): (Rect, &[usize]),
        rows: &mut Rows,
    ) -> Result<(), Interrupted> {
        let (width, height) = self.slices.size();
        let measure = FocusEnergy::for_decision_map();
        let core = bounds.grown(measure.reach(), width, height);
        let window = disc.window(core, width, height);
        let mut difference = self.slices.luma(own, core)?;
        let inner = Rect { x: core.x - window.x, y: core.y - window.y, ..core };
        let blurred = disc.blurred_in(&self.slices.luma(around, window)?, inner);
        difference.data.iter_mut().zip(&blurred.data).for_each(|(own, blurred)| *own -= blurred);
        let unexplained = measure.plane(&difference, rows);
        for &at in pixels {
            let (x, y) = (tile.rect.x + at % tile.rect.width, tile.rect.y + at / tile.rect.width);
            if unexplained.at(x - core.x, y - core.y) < MAX_UNEXPLAINED * self.focus.energy.at(x, y).value() {
                tile.slice[at] = around as u16;
                tile.textured[at] = false;
            }
        }
        Ok(())
    }
}

/// The largest energy of a pixel that blur by a disc of `radius` px can explain, given the mean energy around the
/// pixel.
fn explicable(around: f32, radius: f32) -> f32 {
    around * (REMAINING / (radius * radius)).max(MIN_REMAINING)
}

/// `pixels` of `tile` in square blocks, each with the bounding box of its pixels. The side of the blocks is the one
/// with the least cost, the margin of `reach` px around each bounding box included.
fn in_blocks(pixels: &[usize], tile: Rect, reach: usize) -> Vec<(Rect, Vec<usize>)> {
    let of_side = |side: usize| -> Vec<(Rect, Vec<usize>)> {
        let mut blocks: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for &at in pixels {
            blocks.entry((at / tile.width / side, at % tile.width / side)).or_default().push(at);
        }
        blocks.into_values().map(|pixels| (bounding_box(pixels.iter().copied(), tile), pixels)).collect()
    };
    let cost = |blocks: &[(Rect, Vec<usize>)]| -> usize {
        let area = |bounds: &Rect| (bounds.width + 2 * reach) * (bounds.height + 2 * reach);
        blocks.iter().map(|(bounds, _)| area(bounds) + BLOCK_COST).sum()
    };
    BLOCK_SIDES.into_iter().map(of_side).min_by_key(|blocks| cost(blocks)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weighted mean over 31 x 31 px around a place, with the weights of the narrow scale of the coarse focus.
    fn mean_around(energy: &Plane<f32>, x: usize, y: usize) -> f32 {
        let (mut sum, mut total) = (0.0, 0.0);
        for (u, v) in (0..31).flat_map(|v| (0..31).map(move |u| (u, v))) {
            let distance = (u as f32 - 15.0).powi(2) + (v as f32 - 15.0).powi(2);
            let weight = (-distance / 72.0).exp();
            sum += weight * energy.at(x + u - 15, y + v - 15);
            total += weight;
        }
        sum / total
    }

    #[test]
    fn blurred_edges_and_texture_seldom_have_more_energy_than_counts_as_explicable() {
        let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32;
        let edge = Plane::from_fn(120, 120, |x, y| if 3 * x + y < 240 { 40.0 } else { 200.0 });
        let texture = Plane::from_fn(120, 120, hash);
        let patches = Plane::from_fn(120, 120, |x, y| hash(x / 5, y / 5));
        let measure = FocusEnergy::for_decision_map();
        for (name, picture) in [("edge", edge), ("texture", texture), ("patches", patches)] {
            let sharp = measure.plane(&picture, &mut Rows::default());
            for radius in [1.8f32, 2.5, 4.0, 7.0, 11.0] {
                let left = measure.plane(&Disc::new(radius).blurred(&picture), &mut Rows::default());
                let places: Vec<(usize, usize)> =
                    (30..90).step_by(3).flat_map(|y| (30..90).step_by(3).map(move |x| (x, y))).collect();
                let more = places.iter().filter(|&&(x, y)| {
                    // a prediction succeeds only if this share of the pixel's energy is left after blurring
                    let needed = (1.0 - MAX_UNEXPLAINED.sqrt()).powi(2);
                    let explained = left.at(x, y) / needed;
                    explained > 1.0 && explained > explicable(mean_around(&sharp, x, y), radius)
                });
                let more = more.count() as f32 / places.len() as f32;
                assert!(more < 0.2, "{name}, radius {radius}: {more} of all places");
            }
        }
    }
}
