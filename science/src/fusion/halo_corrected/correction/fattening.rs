//! Foreground fattening: pixels that the decision map gives to a near part although they may show the far part.
//!
//! The focus measure looks at a window, so an edge of a near part raises the energy of its slice beyond the outline
//! too: the decision map reaches over outlines by up to the size of that window. The same effect is known in stereo
//! matching. The candidates are textured pixels of a near slice with a textured pixel of a far slice within that reach.

use super::{
    super::{decision_map::DecisionMap, defocus_model::DefocusModel},
    corrections::{Correction, Corrections, Kind},
    sliding_maximum::sliding_maximum,
};
use crate::imaging::Rect;

/// How far the decision map reaches over the outline of a near part, px.
const REACH: usize = 6;

/// Lists the candidates of the tile `rect` in `corrections`, each with the slice of the nearest far pixel, and returns
/// which pixels they are.
pub(super) fn find(
    map: &DecisionMap,
    model: &DefocusModel,
    slices: usize,
    rect: Rect,
    corrections: &mut Corrections,
) -> Vec<bool> {
    let window = rect.grown(REACH, map.slice.width, map.slice.height);
    let (rank, least_covered) = ranks(model, slices);
    let ranks = textured_ranks(map, window, &rank);
    let farthest = sliding_maximum::<REACH>(&ranks, window, rect);
    let offsets = offsets();
    let stride = window.width as isize;
    let steps: Vec<isize> = offsets.iter().map(|&(dx, dy)| dy * stride + dx).collect();
    let inner = REACH..(window.width.saturating_sub(REACH));
    let inner_rows = REACH..(window.height.saturating_sub(REACH));
    let mut fattened = vec![false; rect.width * rect.height];
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    for (row, fattened) in fattened.chunks_exact_mut(rect.width).enumerate() {
        let y = rect.y + row;
        let near_slices = &map.slice.row(y)[rect.x..rect.x + rect.width];
        let farthest = &farthest[row * rect.width..][..rect.width];
        for (column, ((&near, &farthest), fattened)) in near_slices.iter().zip(farthest).zip(fattened).enumerate() {
            let Some(&least) = least_covered.get(usize::from(near)) else { continue };
            let (x, y) = (left + column, top + row);
            let here = y * window.width + x;
            // a pixel without texture has rank 0
            if farthest < least || ranks[here] == 0 {
                continue;
            }
            let found = if inner.contains(&x) && inner_rows.contains(&y) {
                steps.iter().position(|&step| ranks[here.wrapping_add_signed(step)] >= least)
            } else {
                offsets.iter().position(|&(dx, dy)| {
                    let place = x.checked_add_signed(dx).zip(y.checked_add_signed(dy));
                    let inside = place.filter(|&(u, v)| u < window.width && v < window.height);
                    inside.is_some_and(|(u, v)| ranks[v * window.width + u] >= least)
                })
            };
            if let Some(found) = found {
                let at = here.wrapping_add_signed(steps[found]);
                let far = map.slice.at(window.x + at % window.width, window.y + at / window.width);
                corrections.add((near, far), Correction { at: row * rect.width + column, kind: Kind::Fattened });
                *fattened = true;
            }
        }
    }
    fattened
}

/// The rank of each textured pixel's slice within `window`, row by row; 0 where there is no texture.
fn textured_ranks(map: &DecisionMap, window: Rect, rank: &[u16]) -> Vec<u16> {
    let mut ranks = vec![0u16; window.width * window.height];
    for (y, out) in (window.y..).zip(ranks.chunks_exact_mut(window.width)) {
        let columns = window.x..window.x + window.width;
        let (slices, textured) = (&map.slice.row(y)[columns.clone()], &map.textured.row(y)[columns]);
        for ((out, &slice), &textured) in out.iter_mut().zip(slices).zip(textured) {
            *out = rank.get(usize::from(slice)).copied().filter(|_| textured).unwrap_or(0);
        }
    }
    ranks
}

/// Per slice: its rank, from 1 on, which increases away from the camera; and the least rank of the slices that its blur
/// can spread over (`u16::MAX` when there is none).
fn ranks(model: &DefocusModel, slices: usize) -> (Vec<u16>, Vec<u16>) {
    let mut order: Vec<usize> = (0..slices).collect();
    let behind = |a: usize, b: usize| model.is_behind(a, b);
    order.sort_by(|&a, &b| behind(a, b).cmp(&behind(b, a)));
    let mut rank = vec![0u16; slices];
    let mut last = 0;
    for (i, &slice) in order.iter().enumerate() {
        if i == 0 || behind(slice, order[i - 1]) {
            last += 1;
        }
        rank[slice] = last;
    }
    let least = |near: usize| {
        let far = order.iter().find(|&&far| model.spreads_over(near, far));
        far.map_or(u16::MAX, |&far| rank[far])
    };
    let least = (0..slices).map(least).collect();
    (rank, least)
}

/// Offsets (x, y) within [`REACH`], nearest first.
fn offsets() -> Vec<(isize, isize)> {
    const REACH: isize = self::REACH as isize;
    let all = (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy)));
    let mut within: Vec<_> = all.filter(|(dx, dy)| dx * dx + dy * dy <= REACH * REACH).collect();
    within.sort_by_key(|(dx, dy)| (dx * dx + dy * dy, *dy, *dx));
    within
}
