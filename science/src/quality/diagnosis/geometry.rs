//! Findings on alignment: `profile_misfit`, `slice_misaligned`, `picture_jumps`.

use super::{Diagnoser, warning};
use crate::types::metrics::{Finding, ResidualSimilarity};

/// A corner drift from the first slice to the last below this is accepted, px ...
const MISFIT_PX: f64 = 1.0;
/// ... and a profile is reported only if the drift is also this many standard deviations above zero.
const MISFIT_SIGMAS: f64 = 4.0;
/// A slice is misaligned if it is off by more than this, px, and by more than this many standard deviations.
const MISALIGNED_PX: f64 = 0.75;
const MISALIGNED_SIGMAS: f64 = 4.0;
/// A slice came back when its shift and that of the next pair cancel to within this share.
const BACK: f64 = 0.5;

/// Whether a residual similarity is large and certain enough to be a fault.
pub(super) fn is_misfit(residual: &ResidualSimilarity) -> bool {
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
        Some(warning("profile_misfit", Vec::new(), detail))
    }

    /// Single slices that are off although their neighbours are not, and positions from which all slices are off.
    pub(super) fn shifted_slices(&self) -> Vec<Finding> {
        let off = |pair: usize| {
            let own = (*self.evidence.own.get(pair)?)?;
            let length = own.shift.0.hypot(own.shift.1);
            let certain = length > MISALIGNED_PX.max(MISALIGNED_SIGMAS * own.sigma) && !self.pair_is_duplicated(pair);
            certain.then_some((own.shift, length))
        };
        let pairs = self.evidence.own.len();
        let (mut findings, mut pair) = (Vec::new(), 0);
        while pair < pairs {
            let Some((shift, length)) = off(pair) else {
                pair += 1;
                continue;
            };
            let slice = pair as u32 + 1;
            // away and back: one slice is off; away only: every slice from there on
            let back =
                off(pair + 1).is_some_and(|(next, _)| (shift.0 + next.0).hypot(shift.1 + next.1) < BACK * length);
            let last = pair + 1 == pairs;
            let first = pair == 0 && !back;
            if back || last || first {
                let slice = if first && !last { 0 } else { slice };
                let detail = format!(
                    "slice {} is shifted by {length:.1} px ({:+.1}, {:+.1}) against its neighbours: the rig vibrated or was \
                     knocked; take the stack again, or calibrate again if every stack shows it",
                    self.name(slice),
                    shift.0,
                    shift.1
                );
                findings.push(warning("slice_misaligned", vec![slice], detail));
            } else {
                let detail = format!(
                    "from slice {} on the image is shifted by {length:.1} px ({:+.1}, {:+.1}): the rig or the object was \
                     knocked while the stack was taken; take the stack again",
                    self.name(slice),
                    shift.0,
                    shift.1
                );
                findings.push(warning("picture_jumps", vec![slice - 1, slice], detail));
            }
            pair += if back { 2 } else { 1 };
        }
        findings
    }
}
