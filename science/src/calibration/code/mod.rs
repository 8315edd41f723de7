//! The code of a coded target: which dot of the target a dot of the image is.
//!
//! Input: the contrast of a slice and the labelled positions of its dots. Output: the position of the labels in the
//! code, with the probability that chance gives such an agreement.
//!
//! | module | what it does |
//! |---|---|
//! | `reading` | the size of each dot relative to the others, -1 to 1 |
//! | `search` | correlation with the code over all shifts and symmetries |
//! | `significance` | an upper bound of the probability of a chance agreement |
//! | `equalisation` | makes the dots of both sizes equal, so that phases are not biased |
//! | `identification` | compares the labels of a tracked slice with the code, and corrects them |

mod equalisation;
mod identification;
mod reading;
mod search;
mod significance;

pub(super) use equalisation::SizeDifferences;
pub(super) use identification::{Identification, identify, relabelled};

use super::detection::grid_steps;
use super::lattice::{Label, Places};
use super::tracking::Tracked;
use crate::imaging::Plane;
use crate::target::{CODE_PERIOD, CODE_VERSION, DotSize, dot_size};
use crate::types::report::CodeReport;

/// Least certainty with which a code is recognised: the probability of a chance agreement is below 1e-9.
const RECOGNISED: f64 = 9.0;

/// Evidence about which dot is which in a slice, relative to the reference slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Identity {
    /// The dot with label `l` in this slice has label `l + shift` in the reference slice.
    pub shift: Label,
    /// Negative decadic logarithm of the probability that this evidence is due to chance.
    pub certainty: f64,
}

/// One of the 8 symmetries of the square grid, as a 2 x 2 matrix of integers, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Symmetry([[i32; 2]; 2]);

impl Symmetry {
    /// All of them.
    fn all() -> [Self; 8] {
        std::array::from_fn(|k| {
            let [x, y] = [1, 2].map(|bit| if k & bit == 0 { 1 } else { -1 });
            Self(if k & 4 == 0 { [[x, 0], [0, y]] } else { [[0, x], [y, 0]] })
        })
    }

    fn apply(self, [i, j]: Label) -> Label {
        self.0.map(|row| row[0] * i + row[1] * j)
    }

    /// The transpose, which is the inverse.
    fn inverse(self) -> Self {
        let [[a, b], [c, d]] = self.0;
        Self([[a, c], [b, d]])
    }

    /// 1, or -1 for reflections.
    fn determinant(self) -> i32 {
        let [[a, b], [c, d]] = self.0;
        a * d - b * c
    }
}

/// Where the labels of a grid lie in the code: column and row are `symmetry * label + shift`, modulo the period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CodePlace {
    symmetry: Symmetry,
    shift: Label,
}

impl CodePlace {
    /// Column and row of the dot with this label; they may lie outside 0 to 255, because the code is periodic.
    pub(super) fn position(&self, label: Label) -> Label {
        let [x, y] = self.symmetry.apply(label);
        [x + self.shift[0], y + self.shift[1]]
    }

    /// Size of the dot with this label.
    pub(super) fn size(&self, label: Label) -> DotSize {
        let [column, row] = self.position(label).map(i64::from);
        dot_size(column, row)
    }

    /// True when the grid with these steps shows the code mirrored.
    pub(super) fn is_mirrored(&self, [u, v]: [[f64; 2]; 2]) -> bool {
        f64::from(self.symmetry.determinant()) * (u[0] * v[1] - u[1] * v[0]) < 0.0
    }
}

/// A recognised code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RecognisedCode {
    /// Where the labels lie in it.
    pub place: CodePlace,
    /// Negative decadic logarithm of the probability that chance agrees as well anywhere in the code.
    pub certainty: f64,
}

/// The code of the grid with dots at `places` (px of the plane), or `None` when the probability of a chance agreement
/// is not below 1e-9.
pub(super) fn recognise(contrast: &Plane<f32>, places: &Places) -> Option<RecognisedCode> {
    let readings = reading::read(contrast, places);
    recognise_readings(&readings)
}

fn recognise_readings(readings: &[(Label, f64)]) -> Option<RecognisedCode> {
    let weights: Vec<f64> = readings.iter().map(|(_, reading)| *reading).collect();
    // not worth a search
    if significance::chance(weights.iter().map(|w| w.abs()).sum(), &weights) + log_hypotheses() > -RECOGNISED {
        return None;
    }
    let (place, agreement) = search::best(readings)?;
    let certainty = -(significance::chance(agreement, &weights) + log_hypotheses());
    (certainty >= RECOGNISED).then_some(RecognisedCode { place, certainty })
}

/// The part of the code that slice `reference` shows; `None` for a target without a code.
pub(super) fn report(tracked: &Tracked, reference: usize) -> Option<CodeReport> {
    let code = tracked.target.code?;
    let detection = tracked.detections.get(reference)?.as_ref()?;
    let range = |axis: usize| {
        let positions = || detection.dots.keys().map(|label| code.place.position(*label)[axis]);
        let (first, last) = (positions().min()?, positions().max()?);
        let from = first.rem_euclid(CODE_PERIOD as i32);
        Some([from, from + last - first].map(i32::unsigned_abs))
    };
    Some(CodeReport {
        version: CODE_VERSION,
        columns: range(0)?,
        rows: range(1)?,
        mirrored: code.place.is_mirrored(grid_steps(&detection.places)),
        certainty: code.certainty,
    })
}

/// Decadic logarithm of the number of shifts and symmetries that are compared.
fn log_hypotheses() -> f64 {
    (8.0 * f64::from(CODE_PERIOD).powi(2)).log10()
}

/// Agreement of readings with the code at `place`: the sum of the readings, each times the sign of the code there.
fn agreement(readings: &[(Label, f64)], place: &CodePlace) -> f64 {
    readings.iter().map(|(label, reading)| reading * place.size(*label).sign()).sum()
}

#[cfg(test)]
mod tests;
