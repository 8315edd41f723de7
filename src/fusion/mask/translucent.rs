//! Wings and other thin parts that the back light shines through: neither dark nor bright, over whole areas.

use super::{components::reached, tones::Tones};
use crate::imaging::Plane;

/// Shares of cover that are neither background nor opaque.
const BETWEEN: std::ops::Range<f32> = 0.15..0.85;
/// Squares of this part of the shorter side (and at least of 7 px) are areas and no edges, px to each side.
const REACH_OF_SIDE: usize = 180;
const REACH: (usize, usize) = (3, 22);
/// The rim of an area lies within so many px of where whole squares end.
const RIM: usize = 3;
/// A smaller share of the object is an odd place and no wing.
const LEAST_SHARE: f64 = 0.01;

/// Thin parts of the object.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Thin {
    /// Where they are, beside the opaque object.
    pub pixels: Vec<bool>,
    /// Share of the object that they are.
    pub share: f64,
    /// Share of the light that comes through, in the middle of all that does.
    pub passes: f64,
}

/// Looks for areas between dark and bright that hang on the opaque object `alpha` (255).
pub(super) fn find(grey: &[f32], alpha: &Plane<u8>, is_valid: impl Fn(usize) -> bool, tones: &Tones) -> Option<Thin> {
    let (width, height) = (alpha.width, alpha.height);
    let reach = (width.min(height) / REACH_OF_SIDE).clamp(REACH.0, REACH.1);
    let between: Vec<bool> =
        (0..grey.len()).map(|at| is_valid(at) && BETWEEN.contains(&tones.cover(grey[at]))).collect();
    let areas = eroded(&between, width, height, reach);
    let mut inner: Vec<f32> = grey.iter().zip(&areas).filter(|(_, area)| **area).map(|(&value, _)| value).collect();
    if inner.is_empty() {
        return None;
    }
    let middle = inner.len() / 2;
    let through = f64::from(*inner.select_nth_unstable_by(middle, f32::total_cmp).1);
    // half-way between what comes through and the light itself
    let rim = f64::midpoint(through, tones.bright) as f32;
    let around = dilated(&areas, width, height, reach + RIM);
    let pixels = reached(alpha, |at| around[at] && is_valid(at) && grey[at] < rim);
    // what lets less than half of the light through counts as object already, and is thin all the same
    let (mut thin, mut object) = (0u64, 0u64);
    for (at, &beside) in pixels.iter().enumerate() {
        let counts = beside || alpha.data[at] != 0;
        object += u64::from(counts);
        thin += u64::from(counts && around[at] && (between[at] || beside));
    }
    let share = thin as f64 / object.max(1) as f64;
    let passes = (through - tones.dark) / (tones.bright - tones.dark).max(1e-6);
    (share > LEAST_SHARE).then_some(Thin { pixels, share, passes })
}

/// Pixels whose whole square of `reach` to each side is set.
fn eroded(set: &[bool], width: usize, height: usize, reach: usize) -> Vec<bool> {
    let side = 2 * reach + 1;
    let mut out = vec![false; set.len()];
    // per column: rows in a row, up to here, whose stretch of columns is set
    let mut rows = vec![0usize; width];
    for y in 0..height {
        let mut columns = 0;
        let mut whole = vec![false; width];
        for x in 0..width {
            columns = if set[y * width + x] { columns + 1 } else { 0 };
            if columns >= side {
                whole[x - reach] = true;
            }
        }
        for x in 0..width {
            rows[x] = if whole[x] { rows[x] + 1 } else { 0 };
            if rows[x] >= side {
                out[(y - reach) * width + x] = true;
            }
        }
    }
    out
}

/// Pixels within `reach` columns and rows of one that is set.
fn dilated(set: &[bool], width: usize, height: usize, reach: usize) -> Vec<bool> {
    // what is not set, eroded, is what stays out; beyond the border nothing is set
    let (wide, high) = (width + 2 * reach, height + 2 * reach);
    let mut out = vec![true; wide * high];
    for y in 0..height {
        for x in 0..width {
            out[(y + reach) * wide + x + reach] = !set[y * width + x];
        }
    }
    let free = eroded(&out, wide, high, reach);
    (0..height).flat_map(|y| (0..width).map(move |x| (y + reach) * wide + x + reach)).map(|at| !free[at]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_eroded_to_their_middle_and_dilated_back() {
        let (width, height) = (20, 14);
        let square: Vec<bool> =
            (0..width * height).map(|at| (3..10).contains(&(at % width)) && (2..7).contains(&(at / width))).collect();
        let middle = eroded(&square, width, height, 2);
        let expected: Vec<bool> =
            (0..width * height).map(|at| (5..8).contains(&(at % width)) && at / width == 4).collect();
        assert_eq!(middle, expected);
        assert_eq!(dilated(&middle, width, height, 2), square);
        let corner: Vec<bool> = (0..width * height).map(|at| at == 0).collect();
        assert_eq!(dilated(&corner, width, height, 1).iter().filter(|&&set| set).count(), 4);
    }
}
