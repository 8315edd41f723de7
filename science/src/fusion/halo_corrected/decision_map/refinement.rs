//! What all steps of the refinement of a decision map use: the measurements, and a tile of the map.

use std::collections::BTreeMap;

use super::super::{defocus_model::DefocusModel, pixel_groups::bounding_box, warped_slices::WarpedSlices};
use crate::{
    fusion::align::{cell_energies::CellEnergies, coarse_focus::CoarseFocusMaps, focus_code::FocusCode},
    imaging::{Plane, Rect},
};

/// Focus energy, in multiples of that of noise, from which a pixel has texture.
pub(in super::super) const TEXTURED: f32 = 4.0;

/// Sides of the blocks in which predictions are made, px. The margin around a block costs more than the block, but
/// blurring all that lies between scattered pixels costs more still: the cheapest side is chosen.
const BLOCK_SIDES: [usize; 4] = [256, 64, 32, 16];

/// Fixed cost of a block, in pixels.
const BLOCK_COST: usize = 1000;

/// What the first pass measured.
#[derive(Clone, Copy)]
pub(in super::super) struct MeasuredFocus<'a> {
    /// Per pixel, the slice with the largest focus energy.
    pub sharpest: &'a Plane<u16>,
    /// Per pixel, that energy.
    pub energy: &'a Plane<FocusCode>,
    pub coarse: &'a CoarseFocusMaps,
    pub cells: &'a CellEnergies,
}

/// The part `rect` of a decision map.
pub(super) struct Tile {
    pub rect: Rect,
    pub slice: Vec<u16>,
    pub textured: Vec<bool>,
}

/// What all tiles are refined by.
pub(super) struct Refinement<'a, S, const C: usize> {
    pub slices: &'a WarpedSlices<'a, S, C>,
    pub focus: MeasuredFocus<'a>,
    pub model: &'a DefocusModel,
}

/// `pixels` of `tile` in square blocks, each with the bounding box of its pixels. The side of the blocks is the one
/// with the least cost, the margin of `reach` px around each bounding box included.
pub(super) fn in_blocks(pixels: &[usize], tile: Rect, reach: usize) -> Vec<(Rect, Vec<usize>)> {
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
