//! The tracked grid: the dots of all slices, with what they have in common.

use super::detected::{Detection, Target};
use super::{blur, detection::Diagnosis, identity::Labelling, lateral_colour::MeasuredColours};

/// The grid in all slices.
#[derive(Debug)]
pub(super) struct Tracked {
    /// Width of every slice, px.
    pub width: usize,
    /// Height of every slice, px.
    pub height: usize,
    /// Properties of the target.
    pub target: Target,
    /// Per slice its dots; `None` where the grid was not found.
    pub detections: Vec<Option<Detection>>,
    /// Per slice without a grid the likely reason.
    pub diagnoses: Vec<Option<Diagnosis>>,
    /// Per slice whether its labels are certain.
    pub labelling: Vec<Labelling>,
    /// Lateral colour in the slice in which the grid was found first; `None` for grey slices.
    pub colours: Option<MeasuredColours>,
}

impl Tracked {
    /// Width and height of every slice, px.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.width as u32, self.height as u32]
    }

    /// The strongest modulation of all slices.
    pub(super) fn strongest(&self) -> f64 {
        self.detections.iter().flatten().map(|s| s.modulation).fold(1e-9, f64::max)
    }

    /// Blur radius of each slice in grid steps, relative to the slice with the strongest pattern; `None` where no grid
    /// was found.
    pub(super) fn blurs(&self) -> Vec<Option<f64>> {
        let strongest = self.strongest();
        let blur = |s: &Detection| blur::radius((s.modulation / strongest).min(1.0));
        self.detections.iter().map(|s| s.as_ref().map(blur)).collect()
    }

    /// Dot diameter over the pitch, from the sharpest slice.
    pub(super) fn fill(&self) -> f64 {
        let sharpest = self.detections.iter().flatten().max_by(|a, b| a.modulation.total_cmp(&b.modulation));
        sharpest.map_or(0.5, |s| s.fill.clamp(0.2, 0.8))
    }
}
