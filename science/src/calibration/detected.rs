//! What detection finds in one slice and hands on to the later stages: the measured dots, and what is known of the
//! target.

use std::collections::BTreeMap;

use super::code::{Identity, RecognisedCode};
use super::identity::{Fingerprint, MAX_BYTES, MAX_CELLS};
use super::lattice::{Label, Places};
use super::{
    banding::Ripple, coarse_registration::SimilarityMotion, detection::MAX_DOTS, dot_photometry::DotBrightness,
    flat_field::Polarity, statistics::median_point,
};

/// Most memory that is kept of a slice after its detection, bytes: the fingerprint, the measured dots and the places of
/// the known ones. Nodes of a map are two thirds full on average.
pub const SLICE_BYTES: usize =
    MAX_BYTES + (MAX_DOTS * size_of::<(Label, MeasuredDot)>() + MAX_PLACES * size_of::<(Label, [f64; 2])>()) * 3 / 2;
/// Most places of dots that are kept of a slice: those in its middle.
const MAX_PLACES: usize = MAX_CELLS;

/// A measured dot, in px of its slice.
#[derive(Debug, Clone, Copy)]
pub(super) struct MeasuredDot {
    /// Centre.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate, from noise and from the invalid part of its window.
    pub sigma: f64,
    /// Brightness around it.
    pub light: DotBrightness,
    /// The part of `sigma` that neighbouring dots share (glare, inpainting).
    pub shared_sigma: f64,
    /// Amplitude of the first harmonic over the mean level.
    pub modulation: f64,
    /// A displacement of one standard deviation that all dots of the slice have together, each its own, px.
    pub doubt: [f64; 2],
    /// Share of its window that is synthetic or at full scale: brightness is unreliable there.
    pub invalid: f64,
}

/// The dots of one slice; at most [`SLICE_BYTES`].
#[derive(Debug, Clone)]
pub(super) struct Detection {
    /// The dots that were measured.
    pub dots: BTreeMap<Label, MeasuredDot>,
    /// All known dots of the target at their measured or predicted positions, px of the slice.
    pub places: Places,
    /// Distance of neighbouring dots, px of the slice.
    pub pitch: f64,
    /// Motion of the image since the slice from which the grid was followed.
    pub motion: SimilarityMotion,
    /// Share of the pixels at full scale.
    pub clipped: f64,
    /// Amplitude of the first harmonic over the mean level; negative where blur has inverted the dots.
    pub modulation: f64,
    /// Dot diameter over the pitch as seen in this slice (too large where it is blurred).
    pub fill: f64,
    /// True when neighbouring dots merge.
    pub merged: bool,
    /// Measured dots over the dots that could have been measured. The lower it is, the less their windows overlap.
    pub density: f64,
    /// What tells which dot is which, relative to the slice in which the grid was found; `None` when only tracking
    /// does.
    pub identity: Option<Identity>,
    /// True (mirrored) or false (turned by quarter turns) when the slice does not have the orientation of the slice in
    /// which the grid was found.
    pub turned: Option<bool>,
    /// `ln` of red over green and of blue over green light; `None` for a grey or a clipped slice.
    pub tint: Option<[f64; 2]>,
    /// True when the slice was found where the motion of the other slices does not lead. It counts only if the
    /// fingerprint confirms it.
    pub is_tentative: bool,
    /// Stripes of light; `None` when too little of the target is seen.
    pub ripple: Option<Ripple>,
    /// What makes the cells of the grid differ; `None` when the grid is degenerate.
    pub fingerprint: Option<Fingerprint>,
}

impl Detection {
    /// Forgets what later stages do not need, so that a slice takes at most [`SLICE_BYTES`].
    pub(super) fn shrink(&mut self) {
        middle_places(&mut self.places);
    }

    /// Adds `shift` to all labels.
    pub(super) fn relabel(&mut self, shift: Label) {
        if shift == [0, 0] {
            return;
        }
        let moved = |l: Label| [l[0] + shift[0], l[1] + shift[1]];
        self.dots = std::mem::take(&mut self.dots).into_iter().map(|(l, d)| (moved(l), d)).collect();
        self.places = std::mem::take(&mut self.places).into_iter().map(|(l, p)| (moved(l), p)).collect();
        if let Some(print) = &mut self.fingerprint {
            print.relabel(shift);
        }
    }
}

/// Keeps the [`MAX_PLACES`] places in the middle of the grid.
fn middle_places(places: &mut Places) {
    if places.len() <= MAX_PLACES {
        return;
    }
    let middle = median_point(&places.keys().map(|l| l.map(f64::from)).collect::<Vec<_>>());
    let off = |l: &Label| (0..2).map(|a| (f64::from(l[a]) - middle[a]).abs()).fold(0.0, f64::max);
    let mut labels: Vec<Label> = places.keys().copied().collect();
    labels.sort_by(|a, b| off(a).total_cmp(&off(b)).then(a.cmp(b)));
    for label in &labels[MAX_PLACES..] {
        places.remove(label);
    }
}

/// Properties of the target that are the same in all slices.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    /// Dark or bright dots.
    pub polarity: Polarity,
    /// Pixels per sample, along each axis, of the image in which dots are measured.
    pub bin: usize,
    /// The code of a coded target, and where the labels lie in it.
    pub code: Option<RecognisedCode>,
}

/// Prediction for a slice from the slices before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    /// Expected motion.
    pub motion: SimilarityMotion,
    /// True when the motion is known from the slices before.
    pub confident: bool,
    /// True when blur may have inverted the dots.
    pub maybe_inverted: bool,
}

impl Expected {
    /// The slice from which the places are.
    pub(super) const NOTHING_MOVES: Self =
        Self { motion: SimilarityMotion::NONE, confident: true, maybe_inverted: false };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_very_large_grid_the_middle_is_kept() {
        let mut places: Places =
            (0..200).flat_map(|y| (0..150).map(move |x| ([x - 40, y], [f64::from(x), f64::from(y)]))).collect();
        middle_places(&mut places);
        assert_eq!(places.len(), MAX_PLACES);
        let (low, high) = places.keys().fold(([i32::MAX; 2], [i32::MIN; 2]), |(low, high), l| {
            ([0, 1].map(|a| low[a].min(l[a])), [0, 1].map(|a| high[a].max(l[a])))
        });
        assert!((low[0] + high[0] - 69).abs() <= 1 && (low[1] + high[1] - 199).abs() <= 1, "{low:?} {high:?}");
        let before = places.clone();
        middle_places(&mut places);
        assert_eq!(places, before);
    }
}
