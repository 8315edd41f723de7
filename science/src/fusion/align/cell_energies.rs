//! The focus energy of each slice in cells of 4 x 4 px, kept in a scratch file, one byte per cell.

use std::path::Path;

use super::{coarse_focus::CELL, scratch::ScratchFile};
use crate::{
    imaging::{
        Rect,
        simd::{self, Avx2},
    },
    types::Error,
};

/// Steps of a code per factor of 2 of the energy.
pub(in crate::fusion) const STEPS: u32 = 8;

/// The focus energy of all slices in cells. Slices can be written in any order.
pub(in crate::fusion) struct CellEnergies {
    file: ScratchFile,
    /// Cells across and down the canvas.
    pub columns: usize,
    pub rows: usize,
}

impl CellEnergies {
    /// For slices of `width` x `height` px; creates a file in `folder`.
    pub(super) fn create(folder: &Path, width: usize, height: usize) -> Result<Self, Error> {
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        Ok(Self { file: ScratchFile::create(folder, columns, rows, 1)?, columns, rows })
    }

    /// Keeps the `cells` of slice `slice`.
    pub(super) fn write(&self, slice: usize, cells: &[f32]) -> Result<(), Error> {
        let mut codes = vec![0u8; cells.len()];
        simd::run(
            Avx2::detect(),
            #[inline(always)]
            || codes.iter_mut().zip(cells).for_each(|(code, &energy)| *code = code_of(energy)),
        );
        self.file.write(slice, &codes)
    }

    /// Reads the energies of slice `slice` in the cells `cells` into `codes`, row by row, as [`code_of`] gives them.
    /// `bytes` is a buffer.
    pub(in crate::fusion) fn read(
        &self,
        slice: usize,
        cells: Rect,
        codes: &mut Vec<u8>,
        bytes: &mut Vec<u8>,
    ) -> Result<(), Error> {
        self.file.read(slice, cells, codes, bytes)
    }
}

/// The energy as a byte: [`STEPS`] steps per factor of 2, from 2^-12 to 2^20 squared grey levels.
#[inline(always)]
pub(in crate::fusion) fn code_of(energy: f32) -> u8 {
    /// The code of 1 without the shift: the exponent and the first three bits of the mantissa of a float.
    const ONE: i32 = (1.0f32.to_bits() >> 20) as i32;
    let code = (energy.max(0.0).to_bits() >> 20) as i32 - ONE + 12 * STEPS as i32;
    code.clamp(0, 255) as u8
}
