//! Parts of rows in whose windows the map is the same everywhere: what comes of them is known without a calculation.

use std::ops::Range;

/// Columns that are looked at together.
pub(super) const PART: usize = 64;

/// What the windows of a part hold of the map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Held {
    /// Nothing of it.
    Nothing,
    /// It alone.
    Everything,
    /// Pixels in it and pixels outside.
    Both,
}

/// The parts of `columns` columns.
pub(super) fn parts(columns: usize) -> impl Iterator<Item = Range<usize>> {
    (0..columns).step_by(PART).map(move |start| start..(start + PART).min(columns))
}

/// For each part how many rows of a window there are of either kind.
#[derive(Debug, Default)]
pub(super) struct Tally {
    rows: usize,
    everything: Vec<usize>,
    both: Vec<usize>,
}

impl Tally {
    pub(super) fn start(&mut self, columns: usize) {
        self.rows = 0;
        for counts in [&mut self.everything, &mut self.both] {
            counts.clear();
            counts.resize(columns.div_ceil(PART), 0);
        }
    }

    pub(super) fn enter(&mut self, row: &[Held]) {
        self.rows += 1;
        for (part, held) in row.iter().enumerate() {
            self.everything[part] += usize::from(*held == Held::Everything);
            self.both[part] += usize::from(*held == Held::Both);
        }
    }

    pub(super) fn leave(&mut self, row: &[Held]) {
        self.rows -= 1;
        for (part, held) in row.iter().enumerate() {
            self.everything[part] -= usize::from(*held == Held::Everything);
            self.both[part] -= usize::from(*held == Held::Both);
        }
    }

    /// What all rows hold together in the parts that `columns` touches.
    pub(super) fn held(&self, columns: Range<usize>) -> Held {
        let parts = columns.start / PART..columns.end.div_ceil(PART);
        let (everything, both) = (&self.everything[parts.clone()], &self.both[parts]);
        if both.iter().any(|&rows| rows > 0) {
            return Held::Both;
        }
        match everything {
            rows if rows.iter().all(|&rows| rows == 0) => Held::Nothing,
            rows if rows.iter().all(|&rows| rows == self.rows) => Held::Everything,
            _ => Held::Both,
        }
    }
}
