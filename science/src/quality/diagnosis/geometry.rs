//! Findings on alignment: `profile_misfit`, `alignment_not_measured`, `slice_misaligned`, `picture_jumps`.

use super::{
    Diagnoser,
    displacement::{Displacement, Pair, displacements},
    note, warning,
};
use crate::{
    quality::alignment::OwnShift,
    types::{
        WarningCode,
        metrics::{Finding, ResidualSimilarity},
    },
};

/// A corner drift from the first slice to the last below this is accepted, px ...
const MISFIT_PX: f64 = 1.0;
/// ... and a profile is reported only if the drift is also this many standard deviations above zero.
const MISFIT_SIGMAS: f64 = 4.0;
/// A slice is misaligned if it is off by more than this, px, and by more than this many standard deviations.
const MISALIGNED_PX: f64 = 0.75;
const MISALIGNED_SIGMAS: f64 = 4.0;
/// A slice that is shifted by more than this, px, shows other texture at most pixels: steps of focus beside it mean
/// nothing.
const OTHER_TEXTURE_PX: f64 = 3.0;
/// A shift of more than this share of the shorter side of the canvas, which is a quarter of a cell of the focus curves,
/// explains curves out of order ...
const OTHER_PART: f64 = 1.0 / 80.0;
/// ... if the windows agree on it so well, in standard deviations. Slices that were exchanged were also warped by
/// homographies of another scale, and their windows differ.
const OTHER_PART_SIGMAS: f64 = 20.0;

/// Whether a residual similarity is large and certain enough to be a fault.
pub fn is_misfit(residual: &ResidualSimilarity) -> bool {
    residual.corner_drift_px > MISFIT_PX.max(MISFIT_SIGMAS * residual.corner_drift_sigma_px)
}

impl Diagnoser<'_> {
    pub(super) fn profile_misfit(&self) -> Option<Finding> {
        let residual = self.quality.alignment.similarity.as_ref().filter(|residual| is_misfit(residual))?;
        let steps = self.quality.slices.len().saturating_sub(1) as f64;
        let detail = format!(
            "the profile does not fit this stack: from the first slice to the last the corners of the image drift by {:.1} px \
             (+/- {:.1} px; scale {:+.3} %, rotation {:+.3} degrees, shift {:.1}, {:.1} px); calibrate again. Likely causes: \
             the lens, its aperture or focus ring, or the rail was touched after the calibration, or the stack is from \
             another rig or lens",
            residual.corner_drift_px,
            2.0 * residual.corner_drift_sigma_px,
            100.0 * (residual.scale.powf(steps) - 1.0),
            residual.rotation_deg * steps,
            residual.shift_px[0] * steps,
            residual.shift_px[1] * steps,
        );
        Some(warning(WarningCode::ProfileMisfit, Vec::new(), detail))
    }

    /// Nothing shows whether the profile fits. A stack with too little texture has its own finding.
    pub(super) fn alignment_not_measured(&self) -> Option<Finding> {
        let is_measured = self.quality.alignment.similarity.is_some() || self.quality.slices.len() < 2;
        (!is_measured && !self.has_little_texture()).then(|| {
            let detail = "whether the profile fits this stack could not be measured: too few parts of the image are \
                          near focus in two neighbouring slices. No finding on alignment does not mean that the slices \
                          are aligned; look at the fused image for double edges, take more slices with a smaller step, \
                          or calibrate this rig and lens if that was never done"
                .to_owned();
            note(WarningCode::AlignmentNotMeasured, Vec::new(), detail)
        })
    }

    /// Slices that are off although their neighbours are not, and positions from which all slices are off: one finding
    /// per cause.
    pub(super) fn shifted_slices(&self) -> Vec<Finding> {
        let pairs: Vec<Pair> = self.evidence.own.iter().enumerate().map(|(pair, own)| self.pair(pair, *own)).collect();
        displacements(&pairs).into_iter().map(|displacement| self.displaced(displacement)).collect()
    }

    /// What the shift of the pair of neighbours that begins with slice `pair` says.
    fn pair(&self, pair: usize, own: Option<OwnShift>) -> Pair {
        let Some(own) = own else { return Pair::Unknown };
        let certain = own.length() > MISALIGNED_PX.max(MISALIGNED_SIGMAS * own.sigma);
        if certain && !self.pair_is_duplicated(pair) { Pair::Off(own.shift) } else { Pair::NotDisplaced }
    }

    /// Whether the image is displaced in the pair of neighbours that begins with slice `first`.
    pub(super) fn pair_is_off(&self, first: usize) -> bool {
        matches!(self.pair(first, self.evidence.own.get(first).copied().flatten()), Pair::Off(_))
    }

    /// Whether the image jumps so far in the pair of neighbours that begins with slice `first` that focus cannot be
    /// compared across it.
    pub(super) fn pair_shows_other_texture(&self, first: usize) -> bool {
        let own = self.evidence.own.get(first).copied().flatten();
        own.is_some_and(|own| own.length() > OTHER_TEXTURE_PX.max(MISALIGNED_SIGMAS * own.sigma))
    }

    /// Whether a slice is displaced so far that it shows other parts of the object at the same places.
    pub(super) fn shows_other_parts(&self) -> bool {
        let (width, height) = self.evidence.canvas;
        let far = OTHER_PART * width.min(height) as f64;
        let own = self.evidence.own.iter().enumerate().filter_map(|(pair, own)| Some((pair, (*own)?)));
        own.filter(|(_, own)| own.length() > far.max(OTHER_PART_SIGMAS * own.sigma))
            .any(|(pair, _)| !self.pair_is_duplicated(pair))
    }

    fn displaced(&self, displacement: Displacement) -> Finding {
        let by = |shift: (f64, f64)| format!("{:.1} px ({:+.1}, {:+.1})", shift.0.hypot(shift.1), shift.0, shift.1);
        match displacement {
            Displacement::Slices { slices, shift } => {
                let (verb, most, whose) =
                    if slices.len() == 1 { ("is", "", "its") } else { ("are", "up to ", "their") };
                let detail = format!(
                    "{} {verb} shifted by {most}{} against {whose} neighbours: the rig vibrated or was knocked; take the \
                     stack again, or calibrate again if every stack shows it",
                    self.named(&slices),
                    by(shift)
                );
                warning(WarningCode::SliceMisaligned, slices, detail)
            }
            Displacement::OneOfThree { shift } => {
                let slices = vec![0, 1, 2];
                let detail = format!(
                    "one of the {} is shifted by about {:.1} px against the others, and a stack of three slices does \
                     not tell which: the rig vibrated or was knocked; take the stack again, or calibrate again if \
                     every stack shows it",
                    self.named(&slices),
                    shift.0.hypot(shift.1)
                );
                warning(WarningCode::SliceMisaligned, slices, detail)
            }
            Displacement::Jump { from, to, shift } => {
                let moving = if to == from + 1 {
                    String::new()
                } else {
                    format!(", and it moves until slice {}", self.name(to))
                };
                let detail = format!(
                    "from slice {} on the image is shifted by {}{moving}: the rig or the object was knocked while the \
                     stack was taken; take the stack again",
                    self.name(from + 1),
                    by(shift)
                );
                warning(WarningCode::PictureJumps, (from..=to).collect(), detail)
            }
        }
    }
}
