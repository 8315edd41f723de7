//! Lost slices: why the dots of a slice could not be measured, and what to do about it.
//!
//! Blur is the usual reason, and a target with a coarser grid the usual answer. A slice that is black, blank,
//! over-exposed or of another target needs another answer. A slice between sharp slices is not lost by blur.

use super::detection::Diagnosis;
use super::tracking::Tracked;

/// The reason why a slice was not measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Loss {
    /// Blur removes the pattern.
    Blurred,
    /// Almost no light.
    Black,
    /// No dots between sharp slices.
    Blank,
    /// A large part is at full scale.
    Clipped,
    /// Dots or other things that do not fit the grid of the other slices.
    Other,
}

/// All reasons, the most serious first.
pub(super) const ALL: [Loss; 5] = [Loss::Other, Loss::Black, Loss::Blank, Loss::Clipped, Loss::Blurred];

/// Share of the strongest modulation from which a slice counts as sharp.
const SHARP: f64 = 0.6;

impl Loss {
    /// Why slice `index` was not measured.
    pub(super) fn of(tracked: &Tracked, index: usize) -> Self {
        let strongest = tracked.detections.iter().flatten().map(|s| s.modulation).fold(1e-9, f64::max);
        let is_sharp =
            |i: usize| tracked.detections[i].as_ref().is_some_and(|s| s.modulation.abs() > SHARP * strongest);
        let mut beside = [index.checked_sub(1), Some(index + 1).filter(|i| *i < tracked.detections.len())]
            .into_iter()
            .flatten()
            .peekable();
        let is_between_sharp = beside.peek().is_some() && beside.all(is_sharp);
        if tracked.detections[index].is_some() {
            return if is_sharp(index) { Self::Other } else { Self::Blurred };
        }
        match tracked.diagnoses[index] {
            Some(Diagnosis::Black) => Self::Black,
            Some(Diagnosis::Clipped) => Self::Clipped,
            Some(Diagnosis::NoContrast | Diagnosis::Blurred) if is_between_sharp => Self::Blank,
            Some(Diagnosis::Other) if is_between_sharp => Self::Other,
            _ => Self::Blurred,
        }
    }

    /// What the slice is, as a phrase.
    pub(super) fn phrase(self) -> &'static str {
        match self {
            Self::Blurred => "too blurred to be measured",
            Self::Black => "almost black",
            Self::Blank => "without dots, although the slices beside it are sharp",
            Self::Clipped => "over-exposed",
            Self::Other => "of another target or object, or with dots too irregular to follow",
        }
    }

    /// What to do about it, as a phrase.
    pub(super) fn advice(self) -> &'static str {
        match self {
            Self::Blurred => {
                "use a target with larger, more widely spaced dots (pitch at least 2.5 times the largest blur radius)"
            }
            Self::Black => "check the lamp, the flash and the shutter, and take it again",
            Self::Blank => "check that nothing covers the target or the lens, and take it again",
            Self::Clipped => "reduce the exposure, and take it again",
            Self::Other => "check that it shows the same target, well printed and in the same place, and take it again",
        }
    }
}
