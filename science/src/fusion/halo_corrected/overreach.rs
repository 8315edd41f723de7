//! Which far label lies in reach of a near one: the focus measure looks so far that labels overreach outlines.

use super::optics::Optics;
use crate::imaging::{
    Rect,
    simd::{self, Avx2},
};

/// How far, px, the label of a near part reaches over its outline, because the focus measure looks that far.
pub(super) const OVERREACH: isize = 6;

/// For each slice a number, above 0, that is the larger, the farther the slice is in focus; and the least number of
/// those that it can veil.
pub(super) fn ranks(optics: &Optics, count: usize) -> (Vec<u16>, Vec<u16>) {
    let mut order: Vec<usize> = (0..count).collect();
    let behind = |a: usize, b: usize| optics.is_behind(a, b);
    order.sort_by(|&a, &b| behind(a, b).cmp(&behind(b, a)));
    let mut rank = vec![0u16; count];
    let mut last = 0;
    for (i, &slice) in order.iter().enumerate() {
        if i == 0 || behind(slice, order[i - 1]) {
            last += 1;
        }
        rank[slice] = last;
    }
    let least = |near: usize| {
        let far = order.iter().find(|&&far| optics.veils(near, far));
        far.map_or(u16::MAX, |&far| rank[far])
    };
    let least = (0..count).map(least).collect();
    (rank, least)
}

/// For each pixel of `rect`, the largest of `ranks` (of `window`) in the square of [`OVERREACH`] around it.
pub(super) fn farthest_around(ranks: &[u16], window: Rect, rect: Rect) -> Vec<u16> {
    let (reach, simd) = (OVERREACH as usize, Avx2::detect());
    let (left, top) = (rect.x - window.x, rect.y - window.y);
    let mut farthest = vec![0u16; rect.width * rect.height];
    // nothing beyond the window
    let mut down = vec![0u16; rect.width + 2 * reach];
    let first = left.saturating_sub(reach);
    let end = (left + rect.width + reach).min(window.width);
    let at = reach - left.min(reach);
    for (y, out) in farthest.chunks_exact_mut(rect.width).enumerate() {
        let rows = (top + y).saturating_sub(reach)..(top + y + reach + 1).min(window.height);
        simd::run(
            simd,
            #[inline(always)]
            || {
                down.fill(0);
                let part = &mut down[at..at + end - first];
                for row in rows {
                    let ranks = &ranks[row * window.width + first..row * window.width + end];
                    part.iter_mut().zip(ranks).for_each(|(most, &rank)| *most = rank.max(*most));
                }
                for by in 0..2 * reach + 1 {
                    out.iter_mut().zip(&down[by..]).for_each(|(most, &rank)| *most = rank.max(*most));
                }
            },
        );
    }
    farthest
}

/// Offsets within [`OVERREACH`], nearest first.
pub(super) fn offsets() -> Vec<(isize, isize)> {
    let all = (-OVERREACH..=OVERREACH).flat_map(|dy| (-OVERREACH..=OVERREACH).map(move |dx| (dx, dy)));
    let mut within: Vec<_> = all.filter(|(dx, dy)| dx * dx + dy * dy <= OVERREACH * OVERREACH).collect();
    within.sort_by_key(|(dx, dy)| (dx * dx + dy * dy, *dy, *dx));
    within
}
