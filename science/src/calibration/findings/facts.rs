//! What the findings are made from.

use crate::calibration::{
    camera::Contradiction, detected::Detection, names::listed, solve::Solution, tracked::Tracked,
};
use crate::imaging::Slices;
use crate::types::profile::ProfileSlice;
use crate::types::report::{CameraReport, CaptureReport};

/// Input of the findings.
pub(in crate::calibration) struct Facts<'a> {
    /// The slices, for their names.
    pub slices: &'a dyn Slices,
    /// The tracked grid.
    pub tracked: &'a Tracked,
    /// The solved stack.
    pub solution: &'a Solution,
    /// The slices of the profile.
    pub profile: &'a [ProfileSlice],
    /// Blur radii in grid steps.
    pub blurs: &'a [Option<f64>],
    /// The capture mode.
    pub capture: &'a CaptureReport,
    /// The camera.
    pub camera: &'a CameraReport,
    /// What contradicts it.
    pub contradictions: &'a [Contradiction],
}

impl Facts<'_> {
    /// The detection of slice `index`.
    pub(super) fn detection(&self, index: usize) -> Option<&Detection> {
        self.tracked.detections[index].as_ref()
    }

    /// The detection of the reference slice.
    pub(super) fn base(&self) -> Option<&Detection> {
        self.detection(self.solution.reference)
    }

    /// The slices for which `test` holds.
    pub(super) fn slices_where(&self, test: impl Fn(usize) -> bool) -> Vec<usize> {
        (0..self.profile.len()).filter(|&i| test(i)).collect()
    }

    /// Names of slices, at most five, as a phrase.
    pub(super) fn names(&self, indices: &[usize]) -> String {
        listed(indices, |i| self.slices.name(i).to_owned())
    }

    /// Names of the slices for which `test` holds, as a phrase; `None` when it holds for none.
    pub(super) fn names_where(&self, test: impl Fn(usize) -> bool) -> Option<String> {
        let indices = self.slices_where(test);
        (!indices.is_empty()).then(|| self.names(&indices))
    }

    /// The slices for which `size` is a number, each with a text about it, as a phrase; `None` when there are none.
    pub(super) fn listed_where<T>(
        &self,
        size: impl Fn(usize) -> Option<T>,
        text: impl Fn(&str, T) -> String,
    ) -> Option<String> {
        let indices = self.slices_where(|i| size(i).is_some());
        let item = |i: usize| size(i).map_or_else(String::new, |size| text(self.slices.name(i), size));
        (!indices.is_empty()).then(|| listed(&indices, item))
    }
}
