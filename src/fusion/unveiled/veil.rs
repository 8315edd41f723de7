//! Taking off a tile the blur that near parts lay over what is behind them.
//!
//! Beside the outline of a near part, sharp in slice `a`, a far part, sharp in slice `b`, is veiled by the near part's
//! blur in `b` and in every slice like it. But slice `a` shows the far part too, unveiled, only blurred: by the disc
//! `D` of known radius. So the far part is `I_a + (I_b - D * I_b)`: its coarse structure from the slice of the near part,
//! its detail from its own. What is left of the veil is the detail of the veil, and a veil has little detail.
//!
//! The formula needs no outline: where it is used on the near part by mistake, the near part's blur has no detail
//! either, and `I_a` stays as it was.

use std::collections::BTreeMap;

use super::{
    labels::Labels,
    optics::{Optics, WIDEST},
    pictures::Pictures,
    survey::CELL,
};
use crate::{
    fusion::UNCOVERED,
    imaging::{
        Plane, Rect, Sample,
        filter::{
            disc::Disc,
            focus::{FocusEnergy, Rows},
        },
    },
    model::Stop,
};

/// How far, px, the label of a near part reaches over its outline, because the focus measure looks that far.
const OVERREACH: isize = 6;

/// In reach of both, the far part's detail is taken where its fine energy is more than this share of the near part's ...
const DETAIL_SHARE: f32 = 0.25;
/// ... with a soft step, in powers of e.
const STEP: f32 = 3.0;
/// Energy that counts as none, squared grey levels.
const NONE: f32 = 0.02;

/// Share of the near part in a far pixel's blur from which the veil is taken off, and from which wholly.
const FROM: f32 = 0.05;
const WHOLLY: f32 = 0.3;

/// How far a pixel without its veil may lie beyond what both slices show there, grey levels of 255: a highlight that clips
/// or moves is no blur of the other slice, and must not be taken off as if it were.
const BEYOND: f32 = 8.0;

/// Side of the squares that are corrected in one go, px.
const BLOCK: usize = 128;

/// What takes the veil off, for one stack.
pub(super) struct Veil<'a, S, const C: usize> {
    pub pictures: &'a Pictures<'a, S, C>,
    pub labels: &'a Labels,
    pub optics: &'a Optics,
}

/// What is done to a pixel.
#[derive(Clone, Copy)]
struct Task {
    /// Index within the tile.
    at: usize,
    /// How much of the veil is taken off; none in reach of both parts, where the detail decides.
    share: Option<f32>,
}

impl<S: Sample, const C: usize> Veil<'_, S, C> {
    /// Corrects the pixels of the tile `rect`, interleaved in `out`, in the scale of the samples.
    pub fn take_off(&self, rect: Rect, out: &mut [f32], rows: &mut Rows) -> Result<(), Stop> {
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
        let mut tasks = BTreeMap::new();
        let taken = self.in_reach_of_both(rect, &mut tasks);
        self.veiled(rect, &veiled, &taken, &mut tasks);
        for ((near, far), tasks) in tasks {
            // a few pixels at opposite ends of a tile are no reason to blur all of it
            for tasks in by_block(&tasks, rect.width) {
                self.correct(rect, usize::from(near), usize::from(far), &tasks, out, rows)?;
            }
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
            for &label in &self.labels.slice.row(y)[rect.x..rect.x + rect.width] {
                if let Some(seen) = seen.get_mut(usize::from(label)) {
                    *seen = true;
                }
            }
        }
        (0..self.pictures.count()).filter(|&slice| seen[slice]).map(|slice| slice as u16).collect()
    }

    /// Pixels labelled near with something certainly far in reach: either may be true. Says which they are.
    fn in_reach_of_both(&self, rect: Rect, tasks: &mut BTreeMap<(u16, u16), Vec<Task>>) -> Vec<bool> {
        let (width, height) = self.pictures.size();
        let labels = &self.labels.slice;
        let offsets = offsets();
        let farthest = self.farthest_around(rect);
        let mut taken = vec![false; rect.width * rect.height];
        for (at, taken) in taken.iter_mut().enumerate() {
            let (x, y) = (rect.x + at % rect.width, rect.y + at / rect.width);
            let (near, farthest) = (labels.at(x, y), farthest[at]);
            if near == UNCOVERED || farthest == UNCOVERED || !self.labels.sure.at(x, y) || !self.veils(near, farthest) {
                continue;
            }
            let far = offsets.iter().find_map(|&(dx, dy)| {
                let (u, v) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
                let inside = u < width && v < height;
                let far = (inside && self.labels.sure.at(u, v)).then(|| labels.at(u, v))?;
                (far != UNCOVERED && self.veils(near, far)).then_some(far)
            });
            if let Some(far) = far {
                tasks.entry((near, far)).or_default().push(Task { at, share: None });
                *taken = true;
            }
        }
        taken
    }

    /// For each pixel of `rect`, the farthest sure label in the square of [`OVERREACH`] around it.
    fn farthest_around(&self, rect: Rect) -> Vec<u16> {
        let (width, height) = self.pictures.size();
        let reach = OVERREACH as usize;
        let window = rect.grown(reach, width, height);
        let farther = |a: u16, b: u16| match (a, b) {
            (UNCOVERED, other) | (other, UNCOVERED) => other,
            (a, b) => {
                if self.optics.is_behind(usize::from(a), usize::from(b)) {
                    a
                } else {
                    b
                }
            }
        };
        let mut down = vec![UNCOVERED; window.width * rect.height];
        for (y, out) in down.chunks_exact_mut(window.width).enumerate() {
            let middle = rect.y + y;
            for row in middle.saturating_sub(reach)..(middle + reach + 1).min(height) {
                let labels = &self.labels.slice.row(row)[window.x..];
                let sure = &self.labels.sure.row(row)[window.x..];
                for ((out, &label), &sure) in out.iter_mut().zip(labels).zip(sure) {
                    if sure && label != *out {
                        *out = farther(*out, label);
                    }
                }
            }
        }
        let mut farthest = Vec::with_capacity(rect.width * rect.height);
        for row in down.chunks_exact(window.width) {
            for x in rect.x - window.x..rect.x - window.x + rect.width {
                let around = &row[x.saturating_sub(reach)..(x + reach + 1).min(window.width)];
                farthest.push(around.iter().fold(UNCOVERED, |a, &b| if a == b { a } else { farther(a, b) }));
            }
        }
        farthest
    }

    /// Far pixels that the blur of near parts reaches, with the near part that reaches most.
    fn veiled(&self, rect: Rect, pairs: &[(u16, u16)], taken: &[bool], tasks: &mut BTreeMap<(u16, u16), Vec<Task>>) {
        let (width, height) = self.pictures.size();
        let reach = pairs.iter().map(|&(near, far)| self.optics.radius(near.into(), far.into())).fold(0.0, f32::max);
        let wide = rect.grown(reach as usize + 2 * CELL, width, height);
        // cells lie where those of the whole canvas do, and are whole
        let (left, top) = (wide.x / CELL * CELL, wide.y / CELL * CELL);
        let (right, bottom) = (wide.x + wide.width, wide.y + wide.height);
        let (right, bottom) = (right.next_multiple_of(CELL).min(width), bottom.next_multiple_of(CELL).min(height));
        let wide = Rect { x: left, y: top, width: right - left, height: bottom - top };
        let first = [wide.x / CELL, wide.y / CELL];
        let cells = [(wide.x + wide.width).div_ceil(CELL) - first[0], (wide.y + wide.height).div_ceil(CELL) - first[1]];
        let mut veils = Strongest { sum: vec![0.0; taken.len()], best: vec![(0.0, UNCOVERED); taken.len()] };
        let mut of_label: BTreeMap<u16, Vec<usize>> = BTreeMap::new();
        for (at, &taken) in taken.iter().enumerate() {
            if !taken {
                let label = self.labels.slice.at(rect.x + at % rect.width, rect.y + at / rect.width);
                of_label.entry(label).or_default().push(at);
            }
        }
        let mut nears: Vec<u16> = pairs.iter().map(|&(near, _)| near).collect();
        nears.sort_unstable();
        nears.dedup();
        for near in nears {
            let shares = self.shares(near, wide, first, cells);
            if shares.data.iter().all(|&share| share == 0.0) {
                continue;
            }
            for &(_, far) in pairs.iter().filter(|pair| pair.0 == near) {
                let Some(pixels) = of_label.get(&far) else { continue };
                let radius = self.optics.radius(near.into(), far.into());
                let reached = Disc::new(radius / CELL as f32).blurred(&shares);
                for &at in pixels {
                    let (x, y) = (rect.x + at % rect.width, rect.y + at / rect.width);
                    veils.add(at, near, reached.at(x / CELL - first[0], y / CELL - first[1]));
                }
            }
        }
        for (at, (&sum, &(_, near))) in veils.sum.iter().zip(&veils.best).enumerate() {
            if sum > FROM && near != UNCOVERED {
                let far = self.labels.slice.at(rect.x + at % rect.width, rect.y + at / rect.width);
                let share = ((sum - FROM) / (WHOLLY - FROM)).min(1.0);
                tasks.entry((near, far)).or_default().push(Task { at, share: Some(share) });
            }
        }
    }

    /// Share of each cell that is surely of slice `near`.
    fn shares(&self, near: u16, wide: Rect, first: [usize; 2], cells: [usize; 2]) -> Plane<f32> {
        let mut shares = Plane::filled(cells[0], cells[1], 0.0f32);
        for y in wide.y..wide.y + wide.height {
            let (labels, sure) = (self.labels.slice.row(y), self.labels.sure.row(y));
            let out = shares.row_mut(y / CELL - first[1]);
            for x in wide.x..wide.x + wide.width {
                if labels[x] == near && sure[x] {
                    out[x / CELL - first[0]] += 1.0 / (CELL * CELL) as f32;
                }
            }
        }
        shares
    }

    fn correct(
        &self,
        rect: Rect,
        near: usize,
        far: usize,
        tasks: &[Task],
        out: &mut [f32],
        rows: &mut Rows,
    ) -> Result<(), Stop> {
        let (width, height) = self.pictures.size();
        let disc = Disc::new(self.optics.radius(near, far));
        let bounds = bounds(tasks, rect);
        let window = bounds.grown(disc.reach(), width, height);
        if !self.pictures.covers(far, window) || !self.pictures.covers(near, bounds) {
            return Ok(());
        }
        let far_part = self.pictures.channels(far, window)?;
        let near_part = self.pictures.channels(near, bounds)?;
        let coarse = far_part.each_ref().map(|channel| disc.blurred(channel));
        let shares = self.detail_shares(near, far, bounds, tasks, rows)?;
        let beyond = BEYOND * S::DEPTH.max() / 255.0;
        for task in tasks {
            let (x, y) = (rect.x + task.at % rect.width, rect.y + task.at / rect.width);
            let there = (y - window.y) * window.width + x - window.x;
            let here = (y - bounds.y) * bounds.width + x - bounds.x;
            let plain = !self.labels.sure.at(x, y);
            for (c, out) in out[task.at * C..(task.at + 1) * C].iter_mut().enumerate() {
                let (near, far, coarse) = (near_part[c].data[here], far_part[c].data[there], coarse[c].data[there]);
                let unveiled = match task.share {
                    Some(share) if plain => *out + share * (near - *out),
                    Some(share) => *out - share * (coarse - near),
                    None => *out + shares.data[here] * (far - coarse),
                };
                let (low, high) = (near.min(far).min(*out) - beyond, near.max(far).max(*out) + beyond);
                *out = unveiled.clamp(low, high);
            }
        }
        Ok(())
    }

    /// How much of the far part's detail each pixel of `bounds` takes, 0 to 1, where both parts are in reach.
    fn detail_shares(
        &self,
        near: usize,
        far: usize,
        bounds: Rect,
        tasks: &[Task],
        rows: &mut Rows,
    ) -> Result<Plane<f32>, Stop> {
        if tasks.iter().all(|task| task.share.is_some()) {
            return Ok(Plane::default());
        }
        let (width, height) = self.pictures.size();
        let fine = FocusEnergy::fine();
        let window = bounds.grown(fine.reach(), width, height);
        let near = fine.plane(&self.pictures.luma(near, window)?, rows);
        let far = fine.plane(&self.pictures.luma(far, window)?, rows);
        Ok(Plane::from_fn(bounds.width, bounds.height, |x, y| {
            let (x, y) = (x + bounds.x - window.x, y + bounds.y - window.y);
            let ratio = (far.at(x, y) + NONE) / (near.at(x, y) + NONE);
            ((ratio / DETAIL_SHARE).ln() / STEP + 0.5).clamp(0.0, 1.0)
        }))
    }
}

struct Strongest {
    sum: Vec<f32>,
    best: Vec<(f32, u16)>,
}

impl Strongest {
    fn add(&mut self, at: usize, near: u16, share: f32) {
        self.sum[at] += share;
        if share > self.best[at].0 {
            self.best[at] = (share, near);
        }
    }
}

/// Offsets within [`OVERREACH`], nearest first.
fn offsets() -> Vec<(isize, isize)> {
    let all = (-OVERREACH..=OVERREACH).flat_map(|dy| (-OVERREACH..=OVERREACH).map(move |dx| (dx, dy)));
    let mut within: Vec<_> = all.filter(|(dx, dy)| dx * dx + dy * dy <= OVERREACH * OVERREACH).collect();
    within.sort_by_key(|(dx, dy)| (dx * dx + dy * dy, *dy, *dx));
    within
}

/// The tasks of each square of [`BLOCK`] px of a tile of `width` columns.
fn by_block(tasks: &[Task], width: usize) -> Vec<Vec<Task>> {
    let mut blocks: BTreeMap<(usize, usize), Vec<Task>> = BTreeMap::new();
    for task in tasks {
        blocks.entry((task.at / width / BLOCK, task.at % width / BLOCK)).or_default().push(*task);
    }
    blocks.into_values().collect()
}

/// The smallest rectangle of the canvas around the pixels of `tasks`.
fn bounds(tasks: &[Task], rect: Rect) -> Rect {
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for task in tasks {
        let (x, y) = (task.at % rect.width, task.at / rect.width);
        (left, right, top, bottom) = (left.min(x), right.max(x), top.min(y), bottom.max(y));
    }
    let (left, top) = (left.min(right), top.min(bottom));
    Rect { x: rect.x + left, y: rect.y + top, width: right - left + 1, height: bottom - top + 1 }
}
