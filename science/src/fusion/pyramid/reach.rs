//! The pixels of every level that a tile depends on, computed backwards from the tile. With all of them at hand the
//! result does not depend on the tiles.

use std::ops::Range;

use super::filter::ENERGY_REACH;
use crate::imaging::Rect;

/// Radius of the energy of the base, pixels of the coarsest level.
pub(super) const BASE_REACH: usize = 4;

/// Ranges of pixels along one axis, per level, finest first. Pixel `i` of a level is at pixel `2 i` of the next finer
/// one.
#[derive(Debug, Clone, PartialEq)]
struct Axis {
    /// Pixels that are fused.
    result: Vec<Range<usize>>,
    /// Pixels where detail is computed: those that are fused, and those that their energy depends on.
    detail: Vec<Range<usize>>,
    /// Pixels where slices are needed.
    source: Vec<Range<usize>>,
}

impl Axis {
    fn of(tile: Range<usize>, lengths: &[usize]) -> Self {
        let mut result = vec![tile];
        for &length in &lengths[1..] {
            let finer = &result[result.len() - 1];
            result.push(expanded_from(finer, length));
        }
        let last = lengths.len() - 1;
        let around = |level: usize| {
            let reach = if level == last { BASE_REACH } else { ENERGY_REACH };
            result[level].start.saturating_sub(reach)..(result[level].end + reach).min(lengths[level])
        };
        let detail: Vec<Range<usize>> = (0..=last).map(around).collect();
        let mut source = detail.clone();
        for level in (0..=last).rev() {
            if level > 0 {
                let finer = expanded_from(&detail[level - 1], lengths[level]);
                source[level] = joined(&source[level], &finer);
            }
            if level < last {
                let coarser = &source[level + 1];
                let seen = (2 * coarser.start).saturating_sub(2)..(2 * coarser.end + 1).min(lengths[level]);
                source[level] = joined(&source[level], &seen);
            }
        }
        Self { result, detail, source }
    }
}

/// The pixels of the next coarser level, of `length` px, that the pixels `fine` are expanded from.
fn expanded_from(fine: &Range<usize>, length: usize) -> Range<usize> {
    fine.start.div_ceil(2).saturating_sub(1)..((fine.end - 1) / 2 + 2).min(length)
}

/// The smallest range that contains both.
fn joined(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    a.start.min(b.start)..a.end.max(b.end)
}

/// Width and height of every level, finest first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sizes(pub Vec<(usize, usize)>);

impl Sizes {
    /// The levels of a canvas that is halved `levels` times, or fewer times if a side is below 8 px.
    pub(super) fn of(width: usize, height: usize, levels: usize) -> Self {
        let mut sizes = vec![(width, height)];
        while sizes.len() <= levels {
            let (width, height) = sizes[sizes.len() - 1];
            if width.min(height) < 8 {
                break;
            }
            sizes.push((width.div_ceil(2), height.div_ceil(2)));
        }
        Self(sizes)
    }
}

/// The pixels that a tile depends on, per level, finest first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reach {
    /// Pixels that are fused.
    pub result: Vec<Rect>,
    /// Pixels where the energy of the detail (in the last level: of the base) is measured.
    pub detail: Vec<Rect>,
    /// Pixels of the slices.
    pub source: Vec<Rect>,
}

impl Reach {
    pub(super) fn of(tile: Rect, sizes: &Sizes) -> Self {
        let (widths, heights): (Vec<_>, Vec<_>) = sizes.0.iter().copied().unzip();
        let across = Axis::of(tile.x..tile.x + tile.width, &widths);
        let down = Axis::of(tile.y..tile.y + tile.height, &heights);
        let rects = |across: &[Range<usize>], down: &[Range<usize>]| {
            across
                .iter()
                .zip(down)
                .map(|(x, y)| Rect { x: x.start, y: y.start, width: x.len(), height: y.len() })
                .collect()
        };
        Self {
            result: rects(&across.result, &down.result),
            detail: rects(&across.detail, &down.detail),
            source: rects(&across.source, &down.source),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_has_all_pixels_that_the_next_step_depends_on() {
        let lengths = [101, 51, 26, 13];
        for tile in [0..101, 0..40, 37..61, 64..101, 100..101] {
            let axis = Axis::of(tile, &lengths);
            for level in 0..3 {
                for x in axis.detail[level].clone() {
                    let coarse = if x % 2 == 0 { (x / 2).saturating_sub(1)..x / 2 + 2 } else { x / 2..x / 2 + 2 };
                    for c in coarse.filter(|&c| c < lengths[level + 1]) {
                        assert!(axis.source[level + 1].contains(&c), "{c} of level {} for {x}", level + 1);
                    }
                }
                for c in axis.source[level + 1].clone() {
                    for x in (2 * c).saturating_sub(2)..(2 * c + 3).min(lengths[level]) {
                        assert!(axis.source[level].contains(&x), "{x} of level {level} for {c}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_small_canvas_has_fewer_levels() {
        assert_eq!(Sizes::of(100, 21, 4).0, [(100, 21), (50, 11), (25, 6)]);
        assert_eq!(Sizes::of(3, 1, 4).0, [(3, 1)]);
    }
}
