//! Regions of a row in whose windows the binary map is constant: the filter returns that constant, so nothing is
//! computed.

use std::ops::Range;

/// Columns of a region.
pub(super) const REGION: usize = 64;

/// The value of the map in all windows of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MapValue {
    /// 0 everywhere.
    Zero,
    /// 1 everywhere.
    One,
    /// Both values occur.
    Mixed,
}

/// The columns of each region of a row of `columns` columns.
pub(super) fn regions_of(columns: usize) -> impl Iterator<Item = Range<usize>> {
    (0..columns).step_by(REGION).map(move |start| start..(start + REGION).min(columns))
}

/// How many rows of a window have either value, per region.
#[derive(Debug, Default)]
pub(super) struct RegionCounts {
    rows: usize,
    ones: Vec<usize>,
    mixed: Vec<usize>,
}

impl RegionCounts {
    pub(super) fn start(&mut self, columns: usize) {
        self.rows = 0;
        for counts in [&mut self.ones, &mut self.mixed] {
            counts.clear();
            counts.resize(columns.div_ceil(REGION), 0);
        }
    }

    pub(super) fn enter(&mut self, row: &[MapValue]) {
        self.rows += 1;
        for (region, value) in row.iter().enumerate() {
            self.ones[region] += usize::from(*value == MapValue::One);
            self.mixed[region] += usize::from(*value == MapValue::Mixed);
        }
    }

    pub(super) fn leave(&mut self, row: &[MapValue]) {
        self.rows -= 1;
        for (region, value) in row.iter().enumerate() {
            self.ones[region] -= usize::from(*value == MapValue::One);
            self.mixed[region] -= usize::from(*value == MapValue::Mixed);
        }
    }

    /// The value in all rows of the window and all regions that overlap `columns`.
    pub(super) fn value(&self, columns: Range<usize>) -> MapValue {
        let regions = columns.start / REGION..columns.end.div_ceil(REGION);
        let (ones, mixed) = (&self.ones[regions.clone()], &self.mixed[regions]);
        if mixed.iter().any(|&rows| rows > 0) {
            return MapValue::Mixed;
        }
        match ones {
            rows if rows.iter().all(|&rows| rows == 0) => MapValue::Zero,
            rows if rows.iter().all(|&rows| rows == self.rows) => MapValue::One,
            _ => MapValue::Mixed,
        }
    }
}
