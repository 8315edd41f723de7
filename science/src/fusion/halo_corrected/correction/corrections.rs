//! The list of pixels of a tile that are corrected, in blocks that are processed in one go.

use std::collections::BTreeMap;

use super::super::pixel_groups::PixelGroups;

/// Side of the blocks, px. A few pixels at opposite ends of a tile do not cause all of it to be blurred.
const BLOCK: usize = 128;

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

/// Near slice, far slice, and the block within the tile (row, column).
pub(super) type Key = (u16, u16, usize, usize);

/// The corrections of a tile, by slices and block.
pub(super) struct Corrections {
    width: usize,
    groups: PixelGroups<Key, Correction>,
}

impl Corrections {
    /// None yet; `width` is that of the tile.
    pub(super) fn new(width: usize) -> Self {
        Self { width, groups: PixelGroups::new() }
    }

    pub(super) fn add(&mut self, near: u16, far: u16, correction: Correction) {
        let key = (near, far, correction.at / self.width / BLOCK, correction.at % self.width / BLOCK);
        self.groups.add(key, correction);
    }

    pub(super) fn finish(self) -> BTreeMap<Key, Vec<Correction>> {
        self.groups.finish()
    }
}
