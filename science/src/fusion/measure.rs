//! How sharp a slice is at each pixel: the measure that belongs to the method.

use std::ops::Range;

use super::{Plan, halo_corrected::Survey};
use crate::{
    imaging::filter::{
        focus::{self, FocusEnergy},
        saliency::{self, Saliency},
    },
    types::fusion_options::Method,
};

/// A focus measure, and what it notes besides.
pub(super) enum Measure {
    /// The saliency of guided filtering.
    Saliency(Saliency),
    /// Focus energy, surveyed over wide surroundings too.
    Energy(FocusEnergy, Survey),
}

/// Buffers of either.
#[derive(Default)]
pub(super) struct Rows {
    saliency: saliency::Rows,
    energy: focus::Rows,
    root: Vec<f32>,
}

impl Measure {
    pub(super) fn of(plan: &Plan) -> Self {
        match plan.method {
            Method::HaloCorrected => {
                let survey = Survey::new(plan.width, plan.height, plan.homographies.len());
                Self::Energy(FocusEnergy::steady(), survey)
            }
            Method::Guided | Method::Pyramid => {
                Self::Saliency(Saliency::new(plan.params.r_g as usize, plan.params.sigma_g))
            }
        }
    }

    /// How far from a pixel it looks.
    pub(super) fn reach(&self) -> usize {
        match self {
            Self::Saliency(saliency) => saliency.reach(),
            Self::Energy(energy, _) => energy.reach(),
        }
    }

    /// The measure of `rows`, from the luma of rows; `emit(y, values, saliency)` gets what slices are compared by, and
    /// the same in grey levels, as metrics want it, if they do (`levels`).
    pub(super) fn rows(
        &self,
        size: (usize, usize),
        rows: Range<usize>,
        buffers: &mut Rows,
        levels: bool,
        luma: impl Fn(usize, &mut [f32]),
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
                    if levels {
                        root.iter_mut().zip(values).for_each(|(root, value)| *root = value.sqrt());
                    }
                    emit(y, values, root);
                });
            }
        }
    }

    /// An empty sheet for the notes of a slice.
    pub(super) fn sheet(&self) -> Vec<f32> {
        match self {
            Self::Saliency(_) => Vec::new(),
            Self::Energy(_, survey) => survey.sheet(),
        }
    }

    /// How much of a sheet belongs to `rows` rows of pixels.
    pub(super) fn cells_of(&self, rows: usize) -> usize {
        match self {
            Self::Saliency(_) => 0,
            Self::Energy(_, survey) => survey.cells_of(rows),
        }
    }

    /// Notes a row on its part of the sheet.
    pub(super) fn note(&self, cells: &mut [f32], row: usize, values: &[f32], sure: Range<usize>) {
        if let Self::Energy(_, survey) = self {
            survey.add(cells, row, values, sure);
        }
    }

    /// Takes the sheet of a slice when it is complete.
    pub(super) fn enter(&self, slice: usize, sheet: Vec<f32>) {
        if let Self::Energy(_, survey) = self {
            survey.enter(slice, sheet);
        }
    }

    /// What was noted besides.
    pub(super) fn into_survey(self) -> Option<Survey> {
        match self {
            Self::Saliency(_) => None,
            Self::Energy(_, survey) => Some(survey),
        }
    }
}
