//! Taking off a tile the blur that near parts lay over what is behind them.
//!
//! Beside the outline of a near part, sharp in slice `a`, a far part, sharp in slice `b`, is veiled by the near part's
//! blur in `b` and in every slice like it. But slice `a` shows the far part too, unveiled, only blurred: by the disc
//! `D` of known radius. So the far part is `I_a + (I_b - D * I_b)`: its coarse structure from the slice of the near part,
//! its detail from its own. What is left of the veil is the detail of the veil, and a veil has little detail.
//!
//! The formula needs no outline: where it is used on the near part by mistake, the near part's blur has little detail
//! either, and `I_a` stays nearly as it was. Where a label does not say which part is seen, [`outline`] does.

use std::collections::BTreeMap;

use super::{
    bounds::bounds,
    labels::Labels,
    optics::{Optics, WIDEST},
    outline::{self, Outline},
    overreach::{OVERREACH, farthest_around, offsets, ranks},
    pictures::Pictures,
    survey::CELL,
    tasks::{Kind, Task, Tasks},
};
use crate::{
    fusion::UNCOVERED,
    imaging::{Plane, Rect, Sample, filter::disc::Disc},
    types::Interrupted,
};

/// Share of the near part in a far pixel's blur from which the veil is taken off, and from which wholly.
const FROM: f32 = 0.05;
const WHOLLY: f32 = 0.3;

/// How far a pixel without its veil may lie beyond what both slices show there, grey levels of 255: a highlight that clips
/// or moves is no blur of the other slice, and must not be taken off as if it were.
const BEYOND: f32 = 8.0;

/// What takes the veil off, for one stack.
pub(super) struct Veil<'a, S, const C: usize> {
    pub pictures: &'a Pictures<'a, S, C>,
    pub labels: &'a Labels,
    pub optics: &'a Optics,
}

impl<S: Sample, const C: usize> Veil<'_, S, C> {
    /// Corrects the pixels of the tile `rect`, interleaved in `out`, in the scale of the samples.
    pub(super) fn take_off(&self, rect: Rect, out: &mut [f32]) -> Result<(), Interrupted> {
        if !self.optics.can_veil() {
            return Ok(());
        }
        let (width, height) = self.pictures.size();
        let around = self.present(rect.grown(WIDEST as usize, width, height));
        let inside = self.present(rect);
        let pairs = inside.iter().flat_map(|&far| around.iter().map(move |&near| (near, far)));
        let veiled: Vec<(u16, u16)> = pairs.filter(|&(near, far)| self.veils(near, far)).collect();
        let reaches_over = inside.iter().any(|&near| around.iter().any(|&far| self.veils(near, far)));
        if veiled.is_empty() && !reaches_over {
            return Ok(());
        }
        let mut tasks = Tasks::of(rect.width);
        let taken = self.in_reach_of_both(rect, &mut tasks);
        self.veiled(rect, &veiled, &taken, &mut tasks);
        for ((near, far, ..), tasks) in tasks.finish() {
            self.correct(rect, usize::from(near), usize::from(far), &tasks, out)?;
        }
        Ok(())
    }

    fn veils(&self, near: u16, far: u16) -> bool {
        self.optics.veils(usize::from(near), usize::from(far))
    }

    /// Labels in `rect`, ascending.
    fn present(&self, rect: Rect) -> Vec<u16> {
        let mut seen = vec![false; self.pictures.count()];
        for y in rect.y..rect.y + rect.height {
            let mut last = UNCOVERED;
            for &label in &self.labels.slice.row(y)[rect.x..rect.x + rect.width] {
                if label == last {
                    continue;
                }
                last = label;
                if let Some(seen) = seen.get_mut(usize::from(label)) {
                    *seen = true;
                }
            }
        }
        (0..self.pictures.count()).filter(|&slice| seen[slice]).map(|slice| slice as u16).collect()
    }

    /// Pixels labelled near with something certainly far in reach: either may be true. Says which they are.
    fn in_reach_of_both(&self, rect: Rect, tasks: &mut Tasks) -> Vec<bool> {
        let (width, height) = self.pictures.size();
        let labels = &self.labels.slice;
        let window = rect.grown(OVERREACH as usize, width, height);
        let (rank, least) = ranks(self.optics, self.pictures.count());
        let mut ranks = vec![0u16; window.width * window.height];
        for (y, out) in (window.y..).zip(ranks.chunks_exact_mut(window.width)) {
            let columns = window.x..window.x + window.width;
            let (labels, sure) = (&labels.row(y)[columns.clone()], &self.labels.sure.row(y)[columns]);
            for ((out, &label), &sure) in out.iter_mut().zip(labels).zip(sure) {
                *out = rank.get(usize::from(label)).copied().filter(|_| sure).unwrap_or(0);
            }
        }
        let farthest = farthest_around(&ranks, window, rect);
        let offsets = offsets();
        let stride = window.width as isize;
        let steps: Vec<isize> = offsets.iter().map(|&(dx, dy)| dy * stride + dx).collect();
        let inner = OVERREACH as usize..(window.width.saturating_sub(OVERREACH as usize));
        let inner_rows = OVERREACH as usize..(window.height.saturating_sub(OVERREACH as usize));
        let mut taken = vec![false; rect.width * rect.height];
        let (left, top) = (rect.x - window.x, rect.y - window.y);
        for (row, taken) in taken.chunks_exact_mut(rect.width).enumerate() {
            let y = rect.y + row;
            let near_labels = &labels.row(y)[rect.x..rect.x + rect.width];
            let farthest = &farthest[row * rect.width..][..rect.width];
            for (column, ((&near, &farthest), taken)) in near_labels.iter().zip(farthest).zip(taken).enumerate() {
                let Some(&least) = least.get(usize::from(near)) else { continue };
                let (x, y) = (left + column, top + row);
                let here = y * window.width + x;
                // a pixel that is not sure has no rank
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
                    let (at, (dx, dy)) = (here.wrapping_add_signed(steps[found]), offsets[found]);
                    let far = labels.at(window.x + at % window.width, window.y + at / window.width);
                    let kind = Kind::Either((dx as f32).hypot(dy as f32));
                    tasks.add(near, far, Task { at: row * rect.width + column, kind });
                    *taken = true;
                }
            }
        }
        taken
    }

    /// Far pixels that the blur of near parts reaches, with the near part that reaches most.
    fn veiled(&self, rect: Rect, pairs: &[(u16, u16)], taken: &[bool], tasks: &mut Tasks) {
        let (width, height) = self.pictures.size();
        let reach = pairs.iter().map(|&(near, far)| self.optics.radius(near.into(), far.into())).fold(0.0, f32::max);
        let wide = rect.grown(reach as usize + 2 * CELL, width, height);
        // cells lie where those of the whole canvas do, and are whole
        let (left, top) = (wide.x / CELL * CELL, wide.y / CELL * CELL);
        let (right, bottom) = (wide.x + wide.width, wide.y + wide.height);
        let (right, bottom) = (right.next_multiple_of(CELL).min(width), bottom.next_multiple_of(CELL).min(height));
        let wide = Rect { x: left, y: top, width: right - left, height: bottom - top };
        let columns = wide.width.div_ceil(CELL);
        let spots = self.spots(rect, wide, taken);
        let mut veils = vec![Strongest { sum: 0.0, best: (0.0, UNCOVERED) }; spots.all.len()];
        let mut nears: Vec<u16> = pairs.iter().map(|&(near, _)| near).collect();
        nears.sort_unstable();
        nears.dedup();
        let shares = self.shares(&nears, wide);
        for (&near, shares) in nears.iter().zip(&shares) {
            if shares.data.iter().all(|&share| share == 0.0) {
                continue;
            }
            for &(_, far) in pairs.iter().filter(|pair| pair.0 == near) {
                let Some(here) = spots.of_label.get(&far) else { continue };
                let radius = self.optics.radius(near.into(), far.into());
                let reached = Disc::new(radius / CELL as f32).blurred(shares);
                for &spot in here {
                    veils[spot as usize].add(near, reached.data[spots.all[spot as usize].1 as usize]);
                }
            }
        }
        debug_assert!(spots.all.iter().all(|&(_, cell)| (cell as usize) < columns * wide.height.div_ceil(CELL)));
        for (at, &spot) in spots.at.iter().enumerate() {
            let Some(&Strongest { sum, best: (_, near) }) = veils.get(spot as usize) else { continue };
            if sum > FROM && near != UNCOVERED {
                let share = ((sum - FROM) / (WHOLLY - FROM)).min(1.0);
                tasks.add(near, spots.all[spot as usize].0, Task { at, kind: Kind::Veiled(share) });
            }
        }
    }

    /// What pixels of `rect` are not taken, by label and cell of `wide`: the same is done to all of a spot.
    fn spots(&self, rect: Rect, wide: Rect, taken: &[bool]) -> Spots {
        let columns = wide.width.div_ceil(CELL);
        let mut spots = Spots { at: Vec::with_capacity(taken.len()), all: Vec::new(), of_label: BTreeMap::new() };
        // spots of a row of cells, per cell
        let mut here: Vec<Vec<(u16, u32)>> = vec![Vec::new(); columns];
        for (row, taken) in taken.chunks_exact(rect.width).enumerate() {
            let y = rect.y + row;
            if row == 0 || y.is_multiple_of(CELL) {
                here.iter_mut().for_each(Vec::clear);
            }
            let first = (y - wide.y) / CELL * columns;
            let labels = &self.labels.slice.row(y)[rect.x..rect.x + rect.width];
            for (x, (&label, &taken)) in (rect.x..).zip(labels.iter().zip(taken)) {
                if taken {
                    spots.at.push(u32::MAX);
                    continue;
                }
                let column = (x - wide.x) / CELL;
                let known = here[column].iter().find(|(of, _)| *of == label).map(|&(_, spot)| spot);
                let spot = known.unwrap_or_else(|| {
                    let spot = spots.all.len() as u32;
                    spots.all.push((label, (first + column) as u32));
                    spots.of_label.entry(label).or_default().push(spot);
                    here[column].push((label, spot));
                    spot
                });
                spots.at.push(spot);
            }
        }
        spots
    }

    /// Share of each cell of `wide` that is surely of each of the slices `nears`.
    fn shares(&self, nears: &[u16], wide: Rect) -> Vec<Plane<f32>> {
        let (columns, rows) = (wide.width.div_ceil(CELL), wide.height.div_ceil(CELL));
        let mut shares = vec![Plane::filled(columns, rows, 0.0f32); nears.len()];
        let mut place = vec![usize::MAX; self.pictures.count()];
        for (at, &near) in nears.iter().enumerate() {
            place[usize::from(near)] = at;
        }
        for y in wide.y..wide.y + wide.height {
            let part = wide.x..wide.x + wide.width;
            let (labels, sure) = (&self.labels.slice.row(y)[part.clone()], &self.labels.sure.row(y)[part]);
            for (x, (&label, &sure)) in labels.iter().zip(sure).enumerate() {
                if !sure {
                    continue;
                }
                if let Some(shares) = place.get(usize::from(label)).and_then(|&at| shares.get_mut(at)) {
                    shares.row_mut((y - wide.y) / CELL)[x / CELL] += 1.0 / (CELL * CELL) as f32;
                }
            }
        }
        shares
    }

    fn correct(&self, rect: Rect, near: usize, far: usize, tasks: &[Task], out: &mut [f32]) -> Result<(), Interrupted> {
        let (width, height) = self.pictures.size();
        let disc = Disc::new(self.optics.radius(near, far));
        let either = tasks.iter().any(|task| matches!(task.kind, Kind::Either(_)));
        let bounds = bounds(tasks.iter().map(|task| task.at), rect).grown(
            if either { outline::REACH } else { 0 },
            width,
            height,
        );
        let window = bounds.grown(disc.reach(), width, height);
        if !self.pictures.covers(far, window) || !self.pictures.covers(near, bounds) {
            return Ok(());
        }
        let far_part = self.pictures.channels(far, window)?;
        let near_part = self.pictures.channels(near, bounds)?;
        let inner = Rect { x: bounds.x - window.x, y: bounds.y - window.y, ..bounds };
        let coarse = far_part.each_ref().map(|channel| disc.blurred_in(channel, inner));
        let level = S::DEPTH.max() / 255.0;
        let outline = either.then(|| Outline::between(&near_part, &coarse, level));
        let beyond = BEYOND * level;
        for task in tasks {
            let (x, y) = (rect.x + task.at % rect.width, rect.y + task.at / rect.width);
            let there = (y - window.y) * window.width + x - window.x;
            let here = (y - bounds.y) * bounds.width + x - bounds.x;
            let plain = !self.labels.sure.at(x, y);
            let detail = match (task.kind, &outline) {
                (Kind::Either(away), Some(outline)) => outline.far_detail(here, away),
                _ => 0.0,
            };
            for (c, out) in out[task.at * C..(task.at + 1) * C].iter_mut().enumerate() {
                let (near, far, coarse) = (near_part[c].data[here], far_part[c].data[there], coarse[c].data[here]);
                let unveiled = match task.kind {
                    Kind::Veiled(share) if plain => *out + share * (near - *out),
                    Kind::Veiled(share) => *out - share * (coarse - near),
                    Kind::Either(_) => *out + detail * (far - coarse),
                };
                let (low, high) = (near.min(far).min(*out) - beyond, near.max(far).max(*out) + beyond);
                *out = unveiled.clamp(low, high);
            }
        }
        Ok(())
    }
}

/// Pixels of a tile in spots of one label and cell.
struct Spots {
    /// Per pixel, its spot; none for those that are taken.
    at: Vec<u32>,
    /// Per spot, its label and its cell.
    all: Vec<(u16, u32)>,
    of_label: BTreeMap<u16, Vec<u32>>,
}

#[derive(Clone, Copy)]
struct Strongest {
    sum: f32,
    best: (f32, u16),
}

impl Strongest {
    fn add(&mut self, near: u16, share: f32) {
        self.sum += share;
        if share > self.best.0 {
            self.best = (share, near);
        }
    }
}
