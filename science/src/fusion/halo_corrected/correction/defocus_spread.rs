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

/// Lists the covered pixels of the tile `rect` in `corrections`. `pairs` are the (near, far) slices to consider; `skip`
/// are the pixels that are corrected otherwise.
pub(super) fn find(
    map: &DecisionMap,
    model: &DefocusModel,
    slices: usize,
    rect: Rect,
    pairs: &[(u16, u16)],
    skip: &[bool],
    corrections: &mut Corrections,
) {
    let (width, height) = (map.slice.width, map.slice.height);
    let reach = pairs.iter().map(|&(near, far)| model.radius(near.into(), far.into())).fold(0.0, f32::max);
    let window = rect.grown(reach as usize + 2 * CELL, width, height).in_squares(CELL, width, height);
    let columns = window.width.div_ceil(CELL);
    let regions = Regions::of(map, rect, window, skip);
    let mut covers = vec![Cover { sum: 0.0, largest: (0.0, UNCOVERED) }; regions.all.len()];
    let mut nears: Vec<u16> = pairs.iter().map(|&(near, _)| near).collect();
    nears.sort_unstable();
    nears.dedup();
    let shares = shares(map, slices, &nears, window);
    for (&near, shares) in nears.iter().zip(&shares) {
        if shares.data.iter().all(|&share| share == 0.0) {
            continue;
        }
        for &(_, far) in pairs.iter().filter(|pair| pair.0 == near) {
            let Some(here) = regions.of_slice.get(&far) else { continue };
            let radius = model.radius(near.into(), far.into());
            let spread = Disc::new(radius / CELL as f32).blurred(shares);
            for &region in here {
                covers[region as usize].add(near, spread.data[regions.all[region as usize].1 as usize]);
            }
        }
    }
    debug_assert!(regions.all.iter().all(|&(_, cell)| (cell as usize) < columns * window.height.div_ceil(CELL)));
    for (at, &region) in regions.at.iter().enumerate() {
        let Some(&Cover { sum, largest: (_, near) }) = covers.get(region as usize) else { continue };
        if sum > FROM && near != UNCOVERED {
            let correction = Correction { at, kind: Kind::Covered(sum) };
            corrections.add(near, regions.all[region as usize].0, correction);
        }
    }
}

/// Share of each cell of `window` that is textured and of each of the slices `nears`, out of `slices`.
fn shares(map: &DecisionMap, slices: usize, nears: &[u16], window: Rect) -> Vec<Plane<f32>> {
    let (columns, rows) = (window.width.div_ceil(CELL), window.height.div_ceil(CELL));
    let mut shares = vec![Plane::filled(columns, rows, 0.0f32); nears.len()];
    let mut place = vec![usize::MAX; slices];
    for (at, &near) in nears.iter().enumerate() {
        place[usize::from(near)] = at;
    }
    for y in window.y..window.y + window.height {
        let part = window.x..window.x + window.width;
        let (slices, textured) = (&map.slice.row(y)[part.clone()], &map.textured.row(y)[part]);
        for (x, (&slice, &textured)) in slices.iter().zip(textured).enumerate() {
            if !textured {
                continue;
            }
            if let Some(shares) = place.get(usize::from(slice)).and_then(|&at| shares.get_mut(at)) {
                shares.row_mut((y - window.y) / CELL)[x / CELL] += 1.0 / (CELL * CELL) as f32;
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
