//! The list of pixels of a tile that are corrected, grouped by the two slices.

use super::super::pixel_groups::PixelGroups;

/// A pixel to be corrected.
#[derive(Clone, Copy)]
pub(super) struct Correction {
    /// Index within the tile.
    pub at: usize,
    pub kind: Kind,
}

/// Why a pixel is corrected.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// It shows the far part, and the blur of near parts covers it by this share, more than 0.
    Covered(f32),
    /// The decision map gives it to the near part, but may reach too far here.
    Fattened,
}

/// The corrections of a tile, by near and far slice.
pub(super) type Corrections = PixelGroups<(u16, u16), Correction>;
