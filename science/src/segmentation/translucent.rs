//! Wings and other thin parts that the back light shines through: neither dark nor bright, over whole areas.

use super::{
    components::{Connectivity, Parts, reached},
    tones::Tones,
};
use crate::imaging::Plane;

/// Shares of cover that are neither background nor opaque.
const BETWEEN: std::ops::Range<f32> = 0.15..0.85;
/// Squares of this part of the shorter side (and at least of 7 px) are areas and no edges, px to each side.
const REACH_OF_SIDE: usize = 180;
const REACH: (usize, usize) = (3, 22);
/// The rim of an area lies within so many px of where whole squares end.
const RIM: usize = 3;
/// Over this part of `reach` to each side of its rim an area loses this share of its cover, or it is no area but a blur.
const EDGE_OF_REACH: [usize; 2] = [2, 3];
const LEAST_STEP: f32 = 0.7;
/// A smaller share of the object is an odd place and no wing.
const LEAST_SHARE: f64 = 0.01;

/// Thin parts of the object.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Thin {
    /// Where they are, in the object and beside it.
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
    if !areas.contains(&true) {
        return None;
    }
    let around = dilated(&areas, width, height, reach + RIM);
    let rims = rims(grey, &areas, &around, (width, height), tones);
    let mut pixels = reached(alpha, |at| is_valid(at) && grey[at] < rims[at]);
    // what lets less than half of the light through counts as object already, and is thin all the same
    for (at, beside) in pixels.iter_mut().enumerate() {
        *beside |= alpha.data[at] != 0 && around[at] && between[at];
    }
    let outside = |at: usize| is_valid(at) && alpha.data[at] == 0;
    let edge = reach * EDGE_OF_REACH[0] / EDGE_OF_REACH[1];
    drop_veils(&mut pixels, (width, height), edge, outside, |at| tones.cover(grey[at]));
    let inner = grey.iter().zip(&areas).zip(&pixels).filter(|((_, area), thin)| **area && **thin);
    let through = f64::from(median(&mut inner.map(|((&value, _), _)| value).collect::<Vec<_>>())?);
    let thin = pixels.iter().filter(|&&thin| thin).count();
    let object = pixels.iter().zip(&alpha.data).filter(|(thin, alpha)| **thin || **alpha != 0).count();
    let share = thin as f64 / object.max(1) as f64;
    let passes = (through - tones.dark) / (tones.bright - tones.dark).max(1e-6);
    (share > LEAST_SHARE).then_some(Thin { pixels, share, passes })
}

/// The grey value at which each of the `areas` ends, half-way between what comes through it and the light itself;
/// nothing is darker than it where there is no area `around`.
fn rims(grey: &[f32], areas: &[bool], around: &[bool], (width, height): (usize, usize), tones: &Tones) -> Vec<f32> {
    let mut parts = Parts::of(width, height, Connectivity::Eight, |at| around[at]);
    let mut inner = parts.survey(|inner: &mut Vec<f32>, y, columns| {
        let columns = y * width + columns.start..y * width + columns.end;
        inner.extend(columns.filter(|&at| areas[at]).map(|at| grey[at]));
    });
    let rim = |through: f32| f64::midpoint(f64::from(through), tones.bright) as f32;
    let ends: Vec<f32> = inner.iter_mut().map(|inner| median(inner).map_or(0.0, rim)).collect();
    let mut out = vec![0.0; grey.len()];
    parts.visit(&ends, |end, y, columns| out[y * width + columns.start..y * width + columns.end].fill(*end));
    out
}

/// The value in the middle; none of nothing.
fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

/// Takes out the parts of `thin` that end nowhere: the blur of what is dark. A wing has an edge, at which most of its
/// cover is lost within a few pixels; a veil loses it little by little.
fn drop_veils(
    thin: &mut [bool],
    (width, height): (usize, usize),
    edge: usize,
    outside: impl Fn(usize) -> bool,
    cover: impl Fn(usize) -> f32,
) {
    let mut parts = Parts::of(width, height, Connectivity::Eight, |at| thin[at]);
    let mut steps = parts.survey(|steps: &mut Vec<f32>, y, columns| {
        for x in columns.clone() {
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let place = |far: isize| {
                    let (u, v) = (x.checked_add_signed(far * dx)?, y.checked_add_signed(far * dy)?);
                    (u < width && v < height).then_some(v * width + u)
                };
                let ends = place(1).is_some_and(|next| !thin[next] && outside(next));
                if let (true, Some(before), Some(beyond)) = (ends, place(-(edge as isize)), place(edge as isize)) {
                    let before = cover(before);
                    steps.push((before - cover(beyond)) / before.max(1e-6));
                }
            }
        }
    });
    // what is enclosed by the object shows no edge
    let is_veil: Vec<bool> =
        steps.iter_mut().map(|steps| median(steps).is_some_and(|step| step < LEAST_STEP)).collect();
    parts.visit(&is_veil, |veil, y, columns| {
        if *veil {
            thin[y * width + columns.start..y * width + columns.end].fill(false);
        }
    });
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

    /// A dark disc with an arm of light that comes through, in shares of full scale.
    fn armed(arm: impl Fn(f64) -> f32) -> (Vec<f32>, Plane<u8>, Tones) {
        let (width, height) = (200, 120);
        let grey: Vec<f32> = (0..width * height)
            .map(|at| {
                let (x, y) = ((at % width) as f64, (at / width) as f64);
                let from_body = (x - 60.0).hypot(y - 60.0) - 40.0;
                if from_body < 0.0 { 0.05 } else { arm(from_body) }
            })
            .collect();
        let alpha = Plane { width, height, data: grey.iter().map(|&v| if v < 0.45 { 255 } else { 0 }).collect() };
        (grey, alpha, Tones { dark: 0.05, threshold: 0.45, bright: 0.85, separability: None })
    }

    #[test]
    fn a_rim_of_light_that_comes_through_is_a_wing_and_a_veil_is_none() {
        for passes in [0.35, 0.5, 0.7] {
            let (grey, alpha, tones) = armed(|away| if away < 20.0 { passes } else { 0.85 });
            let thin = find(&grey, &alpha, |_| true, &tones).expect("a wing");
            assert!(thin.pixels[60 * 200 + 110] && !thin.pixels[60 * 200 + 125], "{passes}");
            assert!((thin.passes - (f64::from(passes) - 0.05) / 0.8).abs() < 0.01, "{passes}: {}", thin.passes);
        }
        for width in [25.0, 40.0, 60.0] {
            // as blur leaves it: half of the light at the edge, and more and more away from it
            let (grey, alpha, tones) = armed(|away| 0.85 - 0.4 * (1.0 - away / width).max(0.0).powi(2) as f32);
            assert_eq!(find(&grey, &alpha, |_| true, &tones), None, "{width} px");
        }
    }

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
