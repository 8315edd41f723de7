//! What the kernels share: the guide, windows that slide over it, and exact conversions of their sums.

use std::ops::Range;

use crate::imaging::{Plane, Rect};

/// Full scale of the guide.
pub(super) const SCALE: f64 = 65_535.0;

/// The guide: a tile of an image, and its valid pixels.
#[derive(Debug, Clone, Copy)]
pub struct Guide<'a> {
    /// Grey values, 0..65535.
    pub grey: &'a Plane<u16>,
    /// The valid columns of each row.
    pub valid: &'a [Range<usize>],
}

/// Offset of the column sums in a buffer that extends beyond both edges of the image by the radius.
#[derive(Debug, Clone, Copy)]
pub(super) struct Padding {
    pub(super) left: usize,
    pub(super) length: usize,
}

impl Padding {
    /// For windows of `radius` around the columns of `centres`, with sums of the columns of `taps`.
    pub(super) fn new(centres: Rect, taps: Rect, radius: usize) -> Self {
        Self { left: radius - (centres.x - taps.x), length: centres.width + 2 * radius }
    }
}

/// The rows of a window that slides down: each row is added once and removed once.
#[derive(Debug)]
pub(super) struct RowWindow {
    radius: usize,
    height: usize,
    pub(super) rows: Range<usize>,
}

impl RowWindow {
    pub(super) fn new(radius: usize, height: usize) -> Self {
        Self { radius, height, rows: 0..0 }
    }

    /// Moves to row `y`, which must not decrease. `update(row, sign)` adds (+1) or removes (-1) a row.
    pub(super) fn slide(&mut self, y: usize, mut update: impl FnMut(usize, i8)) {
        self.exchange(y, |enters, leaves| {
            if let Some(row) = enters {
                update(row, 1);
            }
            if let Some(row) = leaves {
                update(row, -1);
            }
        });
    }

    /// The same, with a row to add and a row to remove per call.
    pub(super) fn exchange(&mut self, y: usize, mut update: impl FnMut(Option<usize>, Option<usize>)) {
        let wanted = y.saturating_sub(self.radius)..(y + self.radius + 1).min(self.height);
        if self.rows.is_empty() {
            self.rows = wanted.start..wanted.start;
        }
        let mut enters = self.rows.end..wanted.end;
        let mut leaves = self.rows.start..wanted.start;
        while !enters.is_empty() || !leaves.is_empty() {
            update(enters.next(), leaves.next());
        }
        self.rows = wanted;
    }
}

/// The part of `span` inside the columns `start..start + width`, relative to `start`.
pub(super) fn clip(span: &Range<usize>, start: usize, width: usize) -> Range<usize> {
    span.start.clamp(start, start + width) - start..span.end.clamp(start, start + width) - start
}

/// 2^52, and its bits. OR-ing an integer below 2^52 into the bits adds it.
const TWO_52: f64 = 4_503_599_627_370_496.0;
const TWO_52_BITS: u64 = 0x4330_0000_0000_0000;

/// An integer below 2^52 as a float, exactly, by instructions that every vector unit has.
#[inline(always)]
pub(super) fn float(value: u64) -> f64 {
    f64::from_bits(TWO_52_BITS | value) - TWO_52
}

/// The integer nearest to a number below 2^31, which is in the low bits of its sum with 1.5 * 2^52.
#[inline(always)]
pub(super) fn rounded(value: f64) -> i32 {
    (value + 1.5 * TWO_52).to_bits() as i32
}
