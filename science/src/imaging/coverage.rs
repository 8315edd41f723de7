//! Coverage: the pixels of the canvas that a warped slice covers.

use std::ops::Range;

use super::{Plane, Rect, SliceMapping};
use crate::types::Homography;

/// Tolerance for points outside the outermost pixel centres of a slice, px. A homography that equals the identity up to
/// rounding must not lose the border.
const TOLERANCE: f64 = 1e-6;
/// Distance of the pixels at which a row is probed for a bent border, px.
const PROBE: usize = 4;

/// The pixels of a canvas that a warped slice covers, as one span per row.
///
/// A homography maps the rectangle of a slice to a convex quadrilateral, so the covered pixels of a row are contiguous:
/// two numbers per row replace a mask.
///
/// A pixel is covered when its source position is between the outermost pixel centres of the slice, `[0, w-1] x [0,
/// h-1]`. Interpolation near the border of the slice repeats the border pixels; focus measures exclude such pixels with
/// [`Coverage::eroded`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Coverage {
    width: usize,
    spans: Vec<Range<usize>>,
}

impl Coverage {
    /// Full coverage.
    pub fn full(width: usize, height: usize) -> Self {
        Self { width, spans: vec![0..width; height] }
    }

    /// The coverage of a `width` x `height` canvas by a slice of `slice` = (width, height) px. `to_slice` maps canvas
    /// pixels to slice pixels.
    pub fn of(to_slice: &Homography, slice: (usize, usize), width: usize, height: usize) -> Self {
        let h = to_slice.0;
        let limit = [slice.0 as f64 - 1.0 + TOLERANCE, slice.1 as f64 - 1.0 + TOLERANCE];
        let inside = |x: usize, y: f64| {
            let x = x as f64;
            let w = h[6] * x + h[7] * y + h[8];
            let (u, v) = ((h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w);
            u >= -TOLERANCE && v >= -TOLERANCE && u <= limit[0] && v <= limit[1]
        };
        let spans = (0..height)
            .map(|y| {
                let y = y as f64;
                let Some(start) = (0..width).find(|&x| inside(x, y)) else {
                    return 0..0;
                };
                let last = (start..width).rev().find(|&x| inside(x, y)).unwrap_or(start);
                start..last + 1
            })
            .collect();
        Self { width, spans }
    }

    /// The coverage of a canvas of `slice` = (width, height) px by a slice of the same size with lens distortion.
    ///
    /// The borders of such a slice are bent. Where they cut a row into several parts, only the longest counts.
    pub fn of_mapping(mapping: &SliceMapping, slice: (usize, usize)) -> Self {
        let (width, height) = slice;
        let limit = [width as f64 - 1.0 + TOLERANCE, height as f64 - 1.0 + TOLERANCE];
        let inside = |x: usize, y: usize| {
            let [u, v] = mapping.apply([x as f64, y as f64]);
            u >= -TOLERANCE && v >= -TOLERANCE && u <= limit[0] && v <= limit[1]
        };
        let spans = (0..height)
            .map(|y| {
                let Some(start) = (0..width).find(|&x| inside(x, y)) else { return 0..0 };
                let end = (start..width).rev().find(|&x| inside(x, y)).unwrap_or(start) + 1;
                if (start..end).step_by(PROBE).all(|x| inside(x, y)) {
                    return start..end;
                }
                let (mut longest, mut from) = (0..0, start);
                for x in start..=end {
                    if x == end || !inside(x, y) {
                        if x - from > longest.len() {
                            longest = from..x;
                        }
                        from = x + 1;
                    }
                }
                longest
            })
            .collect();
        Self { width, spans }
    }

    /// Columns of the canvas.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows of the canvas.
    pub fn height(&self) -> usize {
        self.spans.len()
    }

    /// The covered columns of row `y`; empty when there is none.
    #[inline]
    pub fn span(&self, y: usize) -> Range<usize> {
        self.spans[y].clone()
    }

    /// Number of covered pixels.
    pub fn pixels(&self) -> usize {
        self.spans.iter().map(ExactSizeIterator::len).sum()
    }

    /// The pixels whose complete neighbourhood of `radius` px is covered. Positions beyond the canvas do not count as
    /// uncovered, because filters repeat the border there.
    #[must_use]
    pub fn eroded(&self, radius: usize) -> Self {
        let height = self.spans.len();
        let spans = (0..height)
            .map(|y| {
                let around = &self.spans[y.saturating_sub(radius)..(y + radius + 1).min(height)];
                let start = around.iter().map(|span| span.start).max().unwrap_or(0);
                let end = around.iter().map(|span| span.end).min().unwrap_or(0);
                let start = if start == 0 { 0 } else { start + radius };
                let end = if end == self.width { end } else { end.saturating_sub(radius) };
                if around.iter().any(Range::is_empty) || start >= end { 0..0 } else { start..end }
            })
            .collect();
        Self { width: self.width, spans }
    }

    /// The pixels that both cover.
    #[must_use]
    pub fn intersection(&self, other: &Self) -> Self {
        let both = |(a, b): (&Range<usize>, &Range<usize>)| {
            let (start, end) = (a.start.max(b.start), a.end.min(b.end));
            if start >= end { 0..0 } else { start..end }
        };
        Self { width: self.width, spans: self.spans.iter().zip(&other.spans).map(both).collect() }
    }

    /// True when every pixel of `rect` is covered.
    pub fn contains(&self, rect: Rect) -> bool {
        self.spans[rect.y..rect.y + rect.height]
            .iter()
            .all(|span| span.start <= rect.x && span.end >= rect.x + rect.width)
    }

    /// True when no pixel of `rect` is covered.
    pub fn misses(&self, rect: Rect) -> bool {
        self.spans[rect.y..rect.y + rect.height]
            .iter()
            .all(|span| span.is_empty() || span.end <= rect.x || span.start >= rect.x + rect.width)
    }

    /// The span of row `y` of the canvas within `rect`, in columns relative to it.
    pub fn span_in(&self, y: usize, rect: Rect) -> Range<usize> {
        let within = |column: usize| column.clamp(rect.x, rect.x + rect.width) - rect.x;
        within(self.spans[y].start)..within(self.spans[y].end)
    }

    /// The spans of the rows of `rect`, in columns relative to it.
    pub fn spans_in(&self, rect: Rect) -> impl Iterator<Item = Range<usize>> + '_ {
        (rect.y..rect.y + rect.height).map(move |y| self.span_in(y, rect))
    }

    /// Fills the uncovered pixels of `plane`, which is the rectangle `rect` of the canvas. A row with covered pixels
    /// gets the nearest of them on either side; the rows above and below are copies of the nearest such row. A
    /// rectangle without any covered pixel stays as it is.
    pub fn extend(&self, rect: Rect, plane: &mut Plane<f32>) {
        if self.contains(rect) {
            return;
        }
        let spans: Vec<Range<usize>> = self.spans_in(rect).collect();
        for (y, span) in spans.iter().enumerate().filter(|(_, span)| !span.is_empty()) {
            let row = plane.row_mut(y);
            let (first, last) = (row[span.start], row[span.end - 1]);
            row[..span.start].fill(first);
            row[span.end..].fill(last);
        }
        let any = |span: &Range<usize>| !span.is_empty();
        let Some((top, bottom)) = spans.iter().position(any).zip(spans.iter().rposition(any)) else { return };
        // the covered rows are contiguous
        let width = rect.width;
        for y in (0..top).chain(bottom + 1..rect.height) {
            let from = if y < top { top } else { bottom };
            plane.data.copy_within(from * width..(from + 1) * width, y * width);
        }
    }

    /// `rect` as a mask: 255 covered, 0 not.
    pub fn mask(&self, rect: Rect) -> Plane<u8> {
        let mut plane = Plane::filled(rect.width, rect.height, 0);
        for (y, span) in self.spans_in(rect).enumerate() {
            plane.row_mut(y)[span].fill(255);
        }
        plane
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shifted(dx: f64, dy: f64) -> Coverage {
        Coverage::of(&Homography::similarity(1.0, [-dx, -dy]), (20, 10), 20, 10)
    }

    #[test]
    fn the_identity_covers_everything_and_erosion_stops_at_the_canvas() {
        let full = Coverage::full(20, 10);
        assert_eq!(shifted(0.0, 0.0), full);
        assert_eq!(shifted(1e-9, -1e-9), full);
        assert_eq!(full.eroded(6), full);
    }

    #[test]
    fn a_shift_uncovers_the_side_it_leaves() {
        let coverage = shifted(2.5, 1.0);
        assert_eq!(coverage.span(0), 0..0);
        assert_eq!(coverage.span(1), 3..20);
        assert_eq!(coverage.pixels(), 9 * 17);
        assert_eq!(coverage.eroded(2).span(2), 0..0);
        assert_eq!(coverage.eroded(2).span(3), 5..20);
        assert!(coverage.contains(Rect { x: 3, y: 1, width: 17, height: 9 }));
        assert!(!coverage.contains(Rect { x: 2, y: 1, width: 1, height: 1 }));
        assert!(coverage.misses(Rect { x: 0, y: 0, width: 3, height: 10 }));
    }

    #[test]
    fn the_mask_of_a_rectangle_is_cut_out_of_the_mask_of_the_whole() {
        let turn = Homography([0.95, 0.1, -0.5, -0.12, 0.9, 2.0, 1e-3, -2e-3, 1.0]);
        let coverage = Coverage::of(&turn, (20, 10), 20, 10);
        let whole = coverage.mask(Rect::whole(20, 10));
        let rect = Rect { x: 3, y: 2, width: 9, height: 6 };
        let part = coverage.mask(rect);
        for y in 0..rect.height {
            assert_eq!(part.row(y), &whole.row(y + rect.y)[rect.x..rect.x + rect.width]);
        }
        assert_eq!(whole.data.iter().filter(|&&v| v == 255).count(), coverage.pixels());
    }

    #[test]
    fn extending_repeats_the_nearest_covered_row_and_column() {
        let coverage = shifted(2.5, 1.0);
        let rect = Rect { x: 1, y: 0, width: 5, height: 4 };
        let mut plane = Plane { width: 5, height: 4, data: (0..20).map(|at| at as f32).collect() };
        coverage.extend(rect, &mut plane);
        let row = |y: f32| [5.0 * y + 2.0, 5.0 * y + 2.0, 5.0 * y + 2.0, 5.0 * y + 3.0, 5.0 * y + 4.0];
        assert_eq!(plane.data, [row(1.0), row(1.0), row(2.0), row(3.0)].concat());
        let uncovered = Rect { x: 0, y: 0, width: 3, height: 4 };
        let mut plane = Plane::filled(3, 4, 7.0);
        coverage.extend(uncovered, &mut plane);
        assert_eq!(plane.data, vec![7.0; 12]);
    }

    #[test]
    fn erosion_agrees_with_looking_at_every_neighbour() {
        let turn = Homography([0.9, 0.2, -2.0, -0.2, 0.9, 3.0, 0.0, 0.0, 1.0]);
        let (width, height, radius) = (40usize, 30usize, 3i64);
        let coverage = Coverage::of(&turn, (40, 30), width, height);
        let mask = coverage.mask(Rect::whole(width, height));
        let eroded = coverage.eroded(3).mask(Rect::whole(width, height));
        for y in 0..height as i64 {
            for x in 0..width as i64 {
                let all = (-radius..=radius).all(|dy| {
                    (-radius..=radius).all(|dx| {
                        let (u, v) = ((x + dx).clamp(0, 39) as usize, (y + dy).clamp(0, 29) as usize);
                        mask.at(u, v) == 255
                    })
                });
                assert_eq!(eroded.at(x as usize, y as usize) == 255, all, "at {x}, {y}");
            }
        }
    }
}
