//! Translucent parts of the object, such as wings: areas that the back light shines through.
//!
//! In: the evened back light, the mask of the opaque object, and the tones. Out: the pixels of the translucent parts.
//!
//! 1. Candidates are the centres of squares of `2 reach + 1` px whose pixels all have a cover from 0.15 to 0.85:
//!    neither object nor background, and too wide to be an edge.
//! 2. Each connected area ends where the value is half-way between the median of its candidates and the background.
//! 3. Areas connected to the opaque object belong to it.
//! 4. Areas that end gradually are dropped: they are the defocused edge of something dark, which no slice shows sharp.
//!    A wing has an edge, at which most of its cover is lost within a few pixels.

use rayon::prelude::*;

use super::{
    components::{Components, Connectivity, reachable},
    tones::Tones,
};
use crate::imaging::{Plane, statistics::median};

/// Cover of translucent pixels.
const COVER: std::ops::Range<f32> = 0.15..0.85;
/// Half the side of the squares, px: the shorter side of the picture divided by this, within these limits.
const REACH_OF_SIDE: usize = 180;
const REACH_LIMITS: (usize, usize) = (3, 22);
/// Distance of the rim of an area from its squares, px, at most.
const RIM: usize = 3;
/// Share of its cover that an area loses across its rim, within `2 / 3 reach` on either side: less is a defocused edge.
const EDGE_OF_REACH: [usize; 2] = [2, 3];
const MIN_STEP: f32 = 0.7;
/// Least share of the object; smaller areas are not reported as translucent parts.
const MIN_SHARE: f64 = 0.01;

/// The translucent parts of the object.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Translucent {
    /// Their pixels, inside the opaque mask and outside.
    pub pixels: Vec<bool>,
    /// Their share of the object.
    pub share: f64,
    /// Share of the light that passes through them, the median over pixels.
    pub transmittance: f64,
}

/// Finds the translucent parts attached to the opaque object `mask` (255); none when they are too small, or when the
/// picture has only one class, so that there is nothing to shine through.
pub(super) fn find(
    grey: &[f32],
    mask: &Plane<u8>,
    is_valid: impl Fn(usize) -> bool + Sync,
    tones: &Tones,
) -> Option<Translucent> {
    if tones.one_class {
        return None;
    }
    let (width, height) = (mask.width, mask.height);
    let reach = (width.min(height) / REACH_OF_SIDE).clamp(REACH_LIMITS.0, REACH_LIMITS.1);
    let pixels = (0..grey.len()).into_par_iter();
    let between: Vec<bool> = pixels.map(|at| is_valid(at) && COVER.contains(&tones.cover(grey[at]))).collect();
    let areas = eroded(&between, width, height, reach);
    if !areas.contains(&true) {
        return None;
    }
    let around = dilated(&areas, width, height, reach + RIM);
    let rims = rims(grey, &areas, &around, (width, height), tones);
    let mut pixels = reachable(mask, |at| is_valid(at) && grey[at] < rims[at]);
    // pixels with a cover above one half are in the mask already, and are translucent all the same
    for (at, beside) in pixels.iter_mut().enumerate() {
        *beside |= mask.data[at] != 0 && around[at] && between[at];
    }
    let outside = |at: usize| is_valid(at) && mask.data[at] == 0;
    let edge = reach * EDGE_OF_REACH[0] / EDGE_OF_REACH[1];
    drop_defocused_edges(&mut pixels, (width, height), edge, outside, |at| tones.cover(grey[at]));
    let inner = grey.iter().zip(&areas).zip(&pixels).filter(|((_, area), translucent)| **area && **translucent);
    let through = f64::from(median(&mut inner.map(|((&value, _), _)| value).collect::<Vec<_>>())?);
    let translucent = pixels.iter().filter(|&&translucent| translucent).count();
    let object = pixels.iter().zip(&mask.data).filter(|(translucent, mask)| **translucent || **mask != 0).count();
    let share = translucent as f64 / object.max(1) as f64;
    let transmittance = (through - tones.dark) / (tones.bright - tones.dark).max(1e-6);
    (share > MIN_SHARE).then_some(Translucent { pixels, share, transmittance })
}

/// Per pixel, the grey value at which its area ends: half-way between the median of the area and the background.
/// `areas` are the candidates, `around` includes squares and rims; elsewhere the value is 0.
fn rims(grey: &[f32], areas: &[bool], around: &[bool], (width, height): (usize, usize), tones: &Tones) -> Vec<f32> {
    let mut components = Components::of(width, height, Connectivity::Eight, |at| around[at]);
    let mut inner = components.accumulate(|inner: &mut Vec<f32>, y, columns| {
        let columns = y * width + columns.start..y * width + columns.end;
        inner.extend(columns.filter(|&at| areas[at]).map(|at| grey[at]));
    });
    let rim = |through: f32| f64::midpoint(f64::from(through), tones.bright) as f32;
    let ends: Vec<f32> = inner.iter_mut().map(|inner| median(inner).map_or(0.0, rim)).collect();
    let mut out = vec![0.0; grey.len()];
    components
        .for_each_run(&ends, |end, y, columns| out[y * width + columns.start..y * width + columns.end].fill(*end));
    out
}

/// Removes the components of `translucent` that have no edge: their cover falls gradually. The step at the rim, as a
/// share of the cover inside, is measured between `edge` px inside and outside, and the median along the rim counts.
fn drop_defocused_edges(
    translucent: &mut [bool],
    (width, height): (usize, usize),
    edge: usize,
    outside: impl Fn(usize) -> bool,
    cover: impl Fn(usize) -> f32,
) {
    let mut components = Components::of(width, height, Connectivity::Eight, |at| translucent[at]);
    let mut steps = components.accumulate(|steps: &mut Vec<f32>, y, columns| {
        for x in columns.clone() {
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let place = |far: isize| {
                    let (u, v) = (x.checked_add_signed(far * dx)?, y.checked_add_signed(far * dy)?);
                    (u < width && v < height).then_some(v * width + u)
                };
                let ends = place(1).is_some_and(|next| !translucent[next] && outside(next));
                if let (true, Some(before), Some(beyond)) = (ends, place(-(edge as isize)), place(edge as isize)) {
                    let before = cover(before);
                    steps.push((before - cover(beyond)) / before.max(1e-6));
                }
            }
        }
    });
    // a part enclosed by the object has no rim to measure and is kept
    let is_gradual: Vec<bool> =
        steps.iter_mut().map(|steps| median(steps).is_some_and(|step| step < MIN_STEP)).collect();
    components.for_each_run(&is_gradual, |is_gradual, y, columns| {
        if *is_gradual {
            translucent[y * width + columns.start..y * width + columns.end].fill(false);
        }
    });
}

/// Erosion by a square of `2 reach + 1` px; nothing beyond the border is set.
fn eroded(set: &[bool], width: usize, height: usize, reach: usize) -> Vec<bool> {
    let side = 2 * reach + 1;
    let mut out = vec![false; set.len()];
    // per column: number of consecutive rows, up to this one, in which the whole width of the square is set
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

/// Dilation by a square of `2 reach + 1` px.
fn dilated(set: &[bool], width: usize, height: usize, reach: usize) -> Vec<bool> {
    // the complement of the eroded complement; beyond the border nothing is set
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

    /// A dark disc; `arm` is the value, a share of full scale, at a distance from it.
    fn armed(arm: impl Fn(f64) -> f32) -> (Vec<f32>, Plane<u8>, Tones) {
        let (width, height) = (200, 120);
        let grey: Vec<f32> = (0..width * height)
            .map(|at| {
                let (x, y) = ((at % width) as f64, (at / width) as f64);
                let from_body = (x - 60.0).hypot(y - 60.0) - 40.0;
                if from_body < 0.0 { 0.05 } else { arm(from_body) }
            })
            .collect();
        let mask = Plane { width, height, data: grey.iter().map(|&v| if v < 0.45 { 255 } else { 0 }).collect() };
        (grey, mask, Tones { dark: 0.05, threshold: 0.45, bright: 0.85, separability: None, one_class: false })
    }

    #[test]
    fn a_translucent_rim_is_found_and_a_defocused_edge_is_not() {
        for transmitted in [0.35, 0.5, 0.7] {
            let (grey, mask, tones) = armed(|away| if away < 20.0 { transmitted } else { 0.85 });
            let translucent = find(&grey, &mask, |_| true, &tones).expect("a wing");
            assert!(translucent.pixels[60 * 200 + 110] && !translucent.pixels[60 * 200 + 125], "{transmitted}");
            let expected = (f64::from(transmitted) - 0.05) / 0.8;
            assert!(
                (translucent.transmittance - expected).abs() < 0.01,
                "{transmitted}: {}",
                translucent.transmittance
            );
        }
        for width in [25.0, 40.0, 60.0] {
            // like blur: half of the light at the edge, and more with the distance from it
            let (grey, mask, tones) = armed(|away| 0.85 - 0.4 * (1.0 - away / width).max(0.0).powi(2) as f32);
            assert_eq!(find(&grey, &mask, |_| true, &tones), None, "{width} px");
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
