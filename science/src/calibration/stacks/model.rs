//! How the transforms of the slices of a stack depend on the rail and on each other.

use crate::calibration::transform_models::Parameters;
use crate::types::profile::HomographyModel;

/// How the transforms of the slices depend on the rail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NetworkModel {
    /// No change of the transforms to begin with: those of the revision that is refined.
    Unchanged,
    /// Growth, rotation and shift follow the rail.
    Rail,
    /// Growth (with a bend) and rotation follow the rail; each slice has a shift of its own.
    FreeShifts,
    /// Each slice has scale, rotation and shift of its own.
    FreeSimilarities,
}

/// The models of a refinement, simplest first.
pub(super) const REFINING: [NetworkModel; 4] =
    [NetworkModel::Unchanged, NetworkModel::Rail, NetworkModel::FreeShifts, NetworkModel::FreeSimilarities];

/// All models of a calibration, simplest first.
pub(super) const MODELS: [NetworkModel; 3] =
    [NetworkModel::Rail, NetworkModel::FreeShifts, NetworkModel::FreeSimilarities];

impl NetworkModel {
    /// As named in a profile and its report.
    pub(super) fn name(self) -> HomographyModel {
        match self {
            Self::Unchanged => HomographyModel::Given,
            Self::Rail => HomographyModel::RailLinear,
            Self::FreeShifts => HomographyModel::RailShifts,
            Self::FreeSimilarities => HomographyModel::Similarity,
        }
    }

    /// As a phrase for sentences.
    pub(super) fn phrase(self) -> &'static str {
        match self {
            Self::Unchanged => "no change",
            Self::Rail => "growth, rotation and shift by the rail",
            Self::FreeShifts => "growth and rotation by the rail, and a shift per slice",
            Self::FreeSimilarities => "scale, rotation and shift per slice",
        }
    }

    /// Unknowns of the whole stack.
    pub(super) fn shared(self) -> usize {
        match self {
            Self::Rail => 4,
            Self::FreeShifts => 3,
            Self::Unchanged | Self::FreeSimilarities => 0,
        }
    }

    /// Which unknown of the whole stack is the bend of the growth; the one before it is the growth.
    pub(super) fn bend(self) -> Option<usize> {
        match self {
            Self::FreeShifts => Some(1),
            Self::Unchanged | Self::Rail | Self::FreeSimilarities => None,
        }
    }

    /// Unknowns of each slice but the reference.
    pub(super) fn own(self) -> usize {
        match self {
            Self::Unchanged | Self::Rail => 0,
            Self::FreeShifts => 2,
            Self::FreeSimilarities => 4,
        }
    }

    /// The eight parameters of a slice at `z` on the rail as the products of these rows with the unknowns, those of
    /// the whole stack first.
    pub(super) fn rows(self, z: f64) -> Vec<Parameters> {
        let scale = |by: f64| [by, 0.0, 0.0, 0.0, by, 0.0, 0.0, 0.0];
        let turn = |by: f64| [0.0, -by, 0.0, by, 0.0, 0.0, 0.0, 0.0];
        let across = |by: f64| [0.0, 0.0, by, 0.0, 0.0, 0.0, 0.0, 0.0];
        let down = |by: f64| [0.0, 0.0, 0.0, 0.0, 0.0, by, 0.0, 0.0];
        match self {
            Self::Unchanged => Vec::new(),
            Self::Rail => vec![scale(z), turn(z), across(z), down(z)],
            Self::FreeShifts => vec![scale(z), scale(z * z), turn(z), across(1.0), down(1.0)],
            Self::FreeSimilarities => vec![scale(1.0), turn(1.0), across(1.0), down(1.0)],
        }
    }
}
