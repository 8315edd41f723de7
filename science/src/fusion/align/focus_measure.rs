//! The focus measure of the first pass: how sharp a slice is at each pixel.

use std::ops::Range;

use super::coarse_focus::CoarseFocus;
use crate::{
    imaging::filter::{
        focus::{self, FocusEnergy},
        saliency::{self, Saliency},
    },
    types::fusion_options::GuidedParams,
};

/// A focus measure.
pub(in crate::fusion) enum FocusMeasure {
    /// Saliency of Li, Kang & Hu (2013): `S = G * |L * I|` with the luma `I` in grey levels, the 4-neighbour Laplacian
    /// `L` and a Gaussian `G`.
    Saliency(Saliency),
    /// Focus energy: `E = G * (L * g * I)^2` with a smaller Gaussian `g` before the Laplacian; and its means over wide
    /// windows.
    Energy(FocusEnergy, CoarseFocus),
}

/// Buffers for rows of either measure.
#[derive(Default)]
pub(super) struct RowBuffers {
    saliency: saliency::Rows,
    energy: focus::Rows,
    root: Vec<f32>,
}

impl FocusMeasure {
    /// The saliency of guided filtering.
    pub(in crate::fusion) fn saliency(params: &GuidedParams) -> Self {
        Self::Saliency(Saliency::new(params.r_g as usize, params.sigma_g))
    }

    /// The focus energy, with the coarse focus of `slices` slices of `width` x `height` px.
    pub(in crate::fusion) fn energy(width: usize, height: usize, slices: usize) -> Self {
        Self::Energy(FocusEnergy::for_decision_map(), CoarseFocus::new(width, height, slices))
    }

    /// Radius of the window that the measure depends on, px.
    pub(super) fn reach(&self) -> usize {
        match self {
            Self::Saliency(saliency) => saliency.reach(),
            Self::Energy(energy, _) => energy.reach(),
        }
    }

    /// Measures `rows` of a slice of `size`; `luma` writes a row of its luma, and is called once for each row within
    /// reach, from the first to the last.
    ///
    /// `emit(y, values, grey_levels)` gets each row: `values` compare slices; `grey_levels` are the same in grey
    /// levels, for the metrics. The latter are valid only with `in_grey_levels`.
    pub(super) fn rows(
        &self,
        size: (usize, usize),
        rows: Range<usize>,
        buffers: &mut RowBuffers,
        in_grey_levels: bool,
        luma: impl FnMut(usize, &mut [f32]),
        mut emit: impl FnMut(usize, &[f32], &[f32]),
    ) {
        match self {
            Self::Saliency(saliency) => {
                saliency.rows(size, rows, &mut buffers.saliency, luma, |y, _, values| emit(y, values, values));
            }
            Self::Energy(energy, _) => {
                let root = &mut buffers.root;
                root.resize(size.0, 0.0);
                energy.rows(size, rows, &mut buffers.energy, luma, |y, values| {
                    if in_grey_levels {
                        root.iter_mut().zip(values).for_each(|(root, value)| *root = value.sqrt());
                    }
                    emit(y, values, root);
                });
            }
        }
    }

    /// Number of cells of the coarse focus in `rows` rows of pixels; none for the saliency.
    pub(super) fn cells_in_rows(&self, rows: usize) -> usize {
        match self {
            Self::Saliency(_) => 0,
            Self::Energy(_, coarse) => coarse.cells_in_rows(rows),
        }
    }

    /// Adds the columns `columns` of a row of values to its cells; `row` counts from the first row of `cells`.
    pub(super) fn add_to_cells(&self, cells: &mut [f32], row: usize, values: &[f32], columns: Range<usize>) {
        match self {
            Self::Saliency(_) => {}
            Self::Energy(_, coarse) => coarse.add(cells, row, values, columns),
        }
    }

    /// Enters the complete cells of a slice into the coarse focus.
    pub(super) fn enter_cells(&self, slice: usize, cells: Vec<f32>) {
        match self {
            Self::Saliency(_) => {}
            Self::Energy(_, coarse) => coarse.enter(slice, cells),
        }
    }
}
