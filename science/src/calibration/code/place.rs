//! Where the labels of a grid lie in the code.

use crate::calibration::lattice::Label;
use crate::target::{DotSize, dot_size};

/// Evidence about which dot is which in a slice, relative to the reference slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::calibration) struct Identity {
    /// The dot with label `l` in this slice has label `l + shift` in the reference slice.
    pub shift: Label,
    /// Negative decadic logarithm of the probability that this evidence is due to chance.
    pub certainty: f64,
}

/// One of the 8 symmetries of the square grid, as a 2 x 2 matrix of integers, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::calibration) struct Symmetry([[i32; 2]; 2]);

impl Symmetry {
    /// All of them.
    pub(super) fn all() -> [Self; 8] {
        std::array::from_fn(|k| {
            let [x, y] = [1, 2].map(|bit| if k & bit == 0 { 1 } else { -1 });
            Self(if k & 4 == 0 { [[x, 0], [0, y]] } else { [[0, x], [y, 0]] })
        })
    }

    pub(super) fn apply(self, [i, j]: Label) -> Label {
        self.0.map(|row| row[0] * i + row[1] * j)
    }

    /// The transpose, which is the inverse.
    pub(super) fn inverse(self) -> Self {
        let [[a, b], [c, d]] = self.0;
        Self([[a, c], [b, d]])
    }

    /// 1, or -1 for reflections.
    pub(super) fn determinant(self) -> i32 {
        let [[a, b], [c, d]] = self.0;
        a * d - b * c
    }
}

/// Where the labels of a grid lie in the code: column and row are `symmetry * label + shift`, modulo the period.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::calibration) struct CodePlace {
    /// The symmetry.
    pub(super) symmetry: Symmetry,
    /// The shift.
    pub(super) shift: Label,
}

impl CodePlace {
    /// Column and row of the dot with this label; they may lie outside 0 to 255, because the code is periodic.
    pub(in crate::calibration) fn position(&self, label: Label) -> Label {
        let [x, y] = self.symmetry.apply(label);
        [x + self.shift[0], y + self.shift[1]]
    }

    /// Size of the dot with this label.
    pub(in crate::calibration) fn size(&self, label: Label) -> DotSize {
        let [column, row] = self.position(label).map(i64::from);
        dot_size(column, row)
    }

    /// True when the grid with these steps shows the code mirrored.
    pub(in crate::calibration) fn is_mirrored(&self, [u, v]: [[f64; 2]; 2]) -> bool {
        f64::from(self.symmetry.determinant()) * (u[0] * v[1] - u[1] * v[0]) < 0.0
    }
}

/// A recognised code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::calibration) struct RecognisedCode {
    /// Where the labels lie in it.
    pub place: CodePlace,
    /// Negative decadic logarithm of the probability that chance agrees as well anywhere in the code.
    pub certainty: f64,
}

/// Agreement of readings with the code at `place`: the sum of the readings, each times the sign of the code there.
pub(super) fn agreement(readings: &[(Label, f64)], place: &CodePlace) -> f64 {
    readings.iter().map(|(label, reading)| reading * place.size(*label).sign()).sum()
}
