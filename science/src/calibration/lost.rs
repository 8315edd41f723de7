//! Lost slices: why the dots of a slice could not be measured, and what to do about it.
//!
//! Blur is the usual reason, and a target with a coarser grid the usual answer. A slice that is black, blank,
//! over-exposed or of another target needs another answer. A slice between sharp slices is not lost by blur.

use super::{detected::Detection, detection::Diagnosis, tracked::Tracked};

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
    /// Stripes of light.
    Striped,
    /// Dots or other things that do not fit the grid of the other slices.
    Other,
}

/// All reasons, the most serious first.
pub(super) const ALL: [Loss; 6] = [Loss::Other, Loss::Striped, Loss::Black, Loss::Blank, Loss::Clipped, Loss::Blurred];

/// Share of the strongest modulation from which a slice counts as sharp.
const SHARP: f64 = 0.6;
/// Share of the strongest modulation from which the dots of a slice can be measured.
const MEASURABLE: f64 = 0.3;

impl Loss {
    /// Why slice `index` was not measured.
    pub(super) fn of(tracked: &Tracked, index: usize) -> Self {
        let strongest = tracked.strongest();
        let share = |d: &Option<Detection>| d.as_ref().map(|d| d.modulation.abs() / strongest);
        let shares: Vec<Option<f64>> = tracked.detections.iter().map(share).collect();
        if tracked.detections[index].as_ref().and_then(|d| d.ripple?.stripes()).is_some() {
            return Self::Striped;
        }
        if let Some(share) = shares[index] {
            return if share > SHARP { Self::Other } else { Self::Blurred };
        }
        let is_between_sharp = is_between_sharp(&shares, index);
        match tracked.diagnoses[index] {
            Some(Diagnosis::Black) => Self::Black,
            Some(Diagnosis::Clipped) => Self::Clipped,
            Some(Diagnosis::Striped) => Self::Striped,
            Some(Diagnosis::NoContrast | Diagnosis::Blurred) if is_between_sharp => Self::Blank,
            Some(Diagnosis::Other | Diagnosis::TooFine) if is_between_sharp => Self::Other,
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
            Self::Striped => "crossed by stripes of light",
            Self::Other => "of another target or object, or with dots too irregular to follow",
        }
    }

    /// What to do about it, as a phrase.
    pub(super) fn advice(self) -> &'static str {
        match self {
            Self::Blurred => {
                "use a target with larger, more widely spaced dots (pitch at least 2.5 times the largest blur radius)"
            }
            Self::Black => "check the lamp, the flash and the shutter, and take the stack again",
            Self::Blank => "check that nothing covers the target or the lens, and take the stack again",
            Self::Clipped => "reduce the exposure, and take the stack again",
            Self::Striped => "use a lamp on direct current, a longer exposure, or the mechanical shutter",
            Self::Other => {
                "check that every slice shows the same target, well printed and in the same place, and take the stack again"
            }
        }
    }
}

/// Whether the nearest slices that show the grid are so sharp that blur cannot have removed it from slice `index`.
/// `shares`: the modulation of each slice as a share of the strongest; `None` where the grid was not found.
fn is_between_sharp(shares: &[Option<f64>], index: usize) -> bool {
    let shown = |i: usize| shares[i].map(|share| (i, share));
    let mut before = (0..index).rev().filter_map(shown);
    let mut after = (index + 1..shares.len()).filter_map(shown);
    let (nearest, farther) = match (before.next(), after.next()) {
        (Some((_, a)), Some((_, b))) => return a.min(b) > SHARP,
        (Some(nearest), None) => (nearest, before.next()),
        (None, Some(nearest)) => (nearest, after.next()),
        (None, None) => return false,
    };
    // beyond the last slice that shows the grid, blur grows as it did up to there
    let per_slice = farther.map_or(0.0, |(i, share)| (share - nearest.1) / i.abs_diff(nearest.0) as f64);
    let expected = nearest.1 - per_slice.max(0.0) * index.abs_diff(nearest.0) as f64;
    nearest.1 > SHARP && expected > MEASURABLE
}

#[cfg(test)]
mod tests {
    use super::is_between_sharp;

    #[test]
    fn blur_removes_the_grid_only_where_the_slices_beside_it_are_blurred_or_blur_grows_towards_it() {
        let is = |shares: &[f64], index| {
            let shares: Vec<Option<f64>> = shares.iter().map(|s| (*s > 0.0).then_some(*s)).collect();
            is_between_sharp(&shares, index)
        };
        let (between, blurred) = ([0.9, 1.0, 0.0, 0.0, 0.9], [0.5, 0.0, 1.0, 0.9, 0.8]);
        assert!(is(&between, 2) && is(&between, 3) && !is(&blurred, 1));
        let (end, start) = ([0.9, 1.0, 0.95, 0.0, 0.0], [0.0, 0.0, 0.95, 1.0, 0.9]);
        assert!(is(&end, 3) && is(&end, 4) && is(&start, 0) && is(&start, 1));
        let growing = [1.0, 0.9, 0.7, 0.0, 0.0];
        assert!(is(&growing, 3) && !is(&growing, 4));
        assert!(!is(&[0.0, 0.0], 1));
    }
}
