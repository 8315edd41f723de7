//! Where blur of near parts covers far pixels, and how much of it.
//!
//! Let `c_a` be the share of each cell of 4 x 4 px that is textured and of the near slice `a`, and `D_ab` the disc
//! between `a` and the far slice `b` of a pixel. Near parts cover the pixel by `s = sum over a of (D_ab * c_a)`. The
//! share `t` of the blur that is removed is `min(1, (s - 0.05) / (0.3 - 0.05))`, with the near slice that contributes
//! most. The gain of detail is `g = 1 / (1 - min(s, 0.1))`. All pixels of one cell and one slice have the same `s`.

use std::collections::BTreeMap;

use super::{
    super::{decision_map::DecisionMap, defocus_model::DefocusModel},
    corrections::{Correction, Corrections, Kind},
};
use crate::{
    fusion::{align::coarse_focus::CELL, plan::UNCOVERED},
    imaging::{Plane, Rect, filter::disc::Disc},
    types::{Cancelled, Control},
};

/// Cover by near parts from which their blur is removed, and from which it is removed completely.
const FROM: f32 = 0.05;
const COMPLETE: f32 = 0.3;

/// Largest cover whose loss of contrast is compensated. The decision map extends beyond the outlines of near parts, so
/// the true cover is less than the computed one, and a larger gain would exaggerate detail.
const MAX_COMPENSATED: f32 = 0.1;

/// Share of the blur of near parts that is removed where they cover a pixel by `cover`, 0 to 1.
pub(super) fn removed(cover: f32) -> f32 {
    ((cover - FROM) / (COMPLETE - FROM)).clamp(0.0, 1.0)
}

/// Factor on the detail of a pixel that near parts cover by `cover`, 1 to 1.11. The pixel's own slice shows the far
/// part at the contrast `1 - cover`.
pub(super) fn detail_gain(cover: f32) -> f32 {
    1.0 / (1.0 - cover.clamp(0.0, MAX_COMPENSATED))
}

/// Lists the covered pixels of the tile `rect` in `corrections`. `pairs` are the (near, far) slices to consider, in the
/// order of the near slice; `skip` are the pixels that are corrected otherwise.
pub(super) fn find(
    map: &DecisionMap,
    model: &DefocusModel,
    control: &dyn Control,
    rect: Rect,
    pairs: &[(u16, u16)],
    skip: &[bool],
    corrections: &mut Corrections,
) -> Result<(), Cancelled> {
    let Some(&(last_near, _)) = pairs.last() else { return Ok(()) };
    let (width, height) = (map.slice.width, map.slice.height);
    let window = window(rect, model, pairs, (width, height));
    let (columns, rows) = (window.width.div_ceil(CELL), window.height.div_ceil(CELL));
    let regions = Regions::of(map, rect, window, skip);
    let mut covers = vec![Cover { sum: 0.0, largest: (0.0, UNCOVERED) }; regions.all.len()];
    let all_shares = shares(map, last_near, window);
    // the shares of one slice at a time: 0 where it has none
    let mut plane = Plane::filled(columns, rows, 0.0f32);
    for pairs in pairs.chunk_by(|one, other| one.0 == other.0) {
        control.check()?;
        let near = pairs[0].0;
        let shares = &all_shares[usize::from(near)];
        if shares.is_empty() {
            continue;
        }
        shares.iter().for_each(|&(cell, share)| plane.data[cell as usize] += share);
        // slices at the same distance are covered by the same blur, which is computed once
        let mut by_radius: BTreeMap<u32, Vec<&[u32]>> = BTreeMap::new();
        for &(_, far) in pairs {
            if let Some(here) = regions.of_slice.get(&far) {
                by_radius.entry(model.radius(near.into(), far.into()).to_bits()).or_default().push(here);
            }
        }
        for (radius, here) in by_radius {
            let spread = Disc::new(f32::from_bits(radius) / CELL as f32).blurred(&plane);
            for &region in here.into_iter().flatten() {
                covers[region as usize].add(near, spread.data[regions.all[region as usize].1 as usize]);
            }
        }
        shares.iter().for_each(|&(cell, _)| plane.data[cell as usize] = 0.0);
    }
    debug_assert!(regions.all.iter().all(|&(_, cell)| (cell as usize) < columns * rows));
    for (at, &region) in regions.at.iter().enumerate() {
        let Some(&Cover { sum, largest: (_, near) }) = covers.get(region as usize) else { continue };
        if sum > FROM && near != UNCOVERED {
            let correction = Correction { at, kind: Kind::Covered(sum) };
            corrections.add((near, regions.all[region as usize].0), correction);
        }
    }
    Ok(())
}

/// The part of the canvas whose cells can cover the tile `rect`. It consists of whole squares of the canvas in which
/// the discs blur (one cell, or several for a large disc), so the result does not depend on the tile.
fn window(rect: Rect, model: &DefocusModel, pairs: &[(u16, u16)], (width, height): (usize, usize)) -> Rect {
    let largest = pairs.iter().map(|&(near, far)| model.radius(near.into(), far.into())).fold(0.0, f32::max);
    let disc = Disc::new(largest / CELL as f32);
    rect.grown(disc.reach() * CELL, width, height).in_squares(disc.square_side() * CELL, width, height)
}

/// Per slice up to `last`: the cells of `window` that are partly textured and of that slice, and a share of each. Of
/// several entries of one cell, the sum counts.
fn shares(map: &DecisionMap, last: u16, window: Rect) -> Vec<Vec<(u32, f32)>> {
    const PIXEL: f32 = 1.0 / (CELL * CELL) as f32;
    let columns = window.width.div_ceil(CELL);
    let mut shares: Vec<Vec<(u32, f32)>> = vec![Vec::new(); usize::from(last) + 1];
    for y in window.y..window.y + window.height {
        let first = (y - window.y) / CELL * columns;
        let part = window.x..window.x + window.width;
        let (slices, textured) = (&map.slice.row(y)[part.clone()], &map.textured.row(y)[part]);
        for (x, (&slice, &textured)) in slices.iter().zip(textured).enumerate() {
            if !textured {
                continue;
            }
            let Some(shares) = shares.get_mut(usize::from(slice)) else { continue };
            let cell = (first + x / CELL) as u32;
            match shares.last_mut() {
                Some((of, share)) if *of == cell => *share += PIXEL,
                _ => shares.push((cell, PIXEL)),
            }
        }
    }
    shares
}

/// The pixels of a tile in regions, each of one cell and one slice.
struct Regions {
    /// Per pixel, its region; `u32::MAX` for skipped ones.
    at: Vec<u32>,
    /// Per region, its slice and its cell.
    all: Vec<(u16, u32)>,
    /// Per slice, its regions.
    of_slice: BTreeMap<u16, Vec<u32>>,
}

impl Regions {
    /// Those of `rect` without the pixels to `skip`; cells are those of `window`.
    fn of(map: &DecisionMap, rect: Rect, window: Rect, skip: &[bool]) -> Self {
        let columns = window.width.div_ceil(CELL);
        let mut regions = Self { at: Vec::with_capacity(skip.len()), all: Vec::new(), of_slice: BTreeMap::new() };
        // the regions of each cell in the present row of cells
        let mut here: Vec<Vec<(u16, u32)>> = vec![Vec::new(); columns];
        for (row, skip) in skip.chunks_exact(rect.width).enumerate() {
            let y = rect.y + row;
            if row == 0 || y.is_multiple_of(CELL) {
                here.iter_mut().for_each(Vec::clear);
            }
            let first = (y - window.y) / CELL * columns;
            let slices = &map.slice.row(y)[rect.x..rect.x + rect.width];
            for (x, (&slice, &skip)) in (rect.x..).zip(slices.iter().zip(skip)) {
                if skip {
                    regions.at.push(u32::MAX);
                    continue;
                }
                let column = (x - window.x) / CELL;
                let known = here[column].iter().find(|(of, _)| *of == slice).map(|&(_, region)| region);
                let region = known.unwrap_or_else(|| {
                    let region = regions.all.len() as u32;
                    regions.all.push((slice, (first + column) as u32));
                    regions.of_slice.entry(slice).or_default().push(region);
                    here[column].push((slice, region));
                    region
                });
                regions.at.push(region);
            }
        }
        regions
    }
}

/// How much near parts cover a region: in total, and the one that covers most.
#[derive(Clone, Copy)]
struct Cover {
    sum: f32,
    largest: (f32, u16),
}

impl Cover {
    fn add(&mut self, near: u16, share: f32) {
        self.sum += share;
        if share > self.largest.0 {
            self.largest = (share, near);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// Cancels after a number of checks.
    struct CancelAfter(AtomicUsize);

    impl Control for CancelAfter {
        fn progress(&self, _stage: &'static str, _completed: usize, _total: usize) {}

        fn check(&self) -> Result<(), Cancelled> {
            let take = |left: usize| left.checked_sub(1);
            self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take).map(|_| ()).map_err(|_| Cancelled)
        }
    }

    #[test]
    fn a_cancel_is_noticed_at_every_near_slice() {
        let count = 6u16;
        let map = DecisionMap {
            slice: Plane::from_fn(90, 60, |x, _| (x / 15) as u16).into(),
            textured: Plane::filled(90, 60, true),
        };
        let model = DefocusModel::near_first(count.into(), 4.0);
        // each slice is near those after it
        let pairs: Vec<(u16, u16)> =
            (0..count).flat_map(|near| (near + 1..count).map(move |far| (near, far))).collect();
        let found = |checks: usize| {
            let (control, mut corrections) = (CancelAfter(AtomicUsize::new(checks)), Corrections::new());
            let rect = Rect::whole(90, 60);
            find(&map, &model, &control, rect, &pairs, &[false; 90 * 60], &mut corrections)
                .map(|()| corrections.finish().into_values().map(|pixels| pixels.len()).sum::<usize>())
        };
        for checks in 0..usize::from(count) - 1 {
            assert_eq!(found(checks), Err(Cancelled), "after {checks} checks");
        }
        assert!(found(usize::from(count) - 1).expect("no further check") > 200);
    }
}
