//! What all steps of the refinement of a decision map use: the measurements, and a tile of the map.

use super::super::{defocus_model::DefocusModel, warped_slices::WarpedSlices};
use crate::{
    fusion::align::{cell_energies::CellEnergies, coarse_focus::CoarseFocusMaps, focus_code::FocusCode},
    imaging::{Plane, Rect},
};

/// Focus energy, in multiples of that of noise, from which a pixel has texture.
pub(in super::super) const TEXTURED: f32 = 4.0;

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
