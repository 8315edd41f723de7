//! Refines a tile by the coarse focus: pixels that show blur of what is sharp around them take its slice.
//!
//! In: the slice of each pixel, its energy, and the coarse focus. Out: the same tile, in which pixels that the table of
//! the parent module lists have another slice.

use super::{
    super::pixel_groups::{PixelGroups, in_blocks},
    refinement::{Refinement, Tile},
};
use crate::{
    fusion::{
        align::coarse_focus::{CELL, CoarseScale},
        plan::UNCOVERED,
    },
    imaging::{
        Rect, Sample,
        filter::{
            disc::Disc,
            focus::{FocusEnergy, Rows},
        },
    },
    types::Interrupted,
};

/// Share of a pixel's energy that a prediction may leave unexplained.
const MAX_UNEXPLAINED: f32 = 0.2;

/// Energy of a pixel, in multiples of the mean energy around it, up to which blur by a disc of radius `r` px can
/// explain it: `REMAINING / r^2`, and at least `MIN_REMAINING`, because the rim of a large disc is sharp.
const REMAINING: f32 = 8.0;
const MIN_REMAINING: f32 = 1.0 / 12.0;

/// Energy of a textured pixel, in multiples of the mean energy around it at the narrow scale, up to which it counts as
/// one without texture: the rim of a disc of blur has as much.
const WEAK: f32 = 0.045;

/// Pixels of a tile by the slice that is sharpest around them and their own slice.
type Candidates = PixelGroups<(u16, u16), usize>;

impl<S: Sample, const C: usize> Refinement<'_, S, C> {
    /// Refines `tile` by each scale of the coarse focus, from narrow to wide. Only with `predicts`, textured pixels are
    /// compared with the blur of what is around them.
    pub(super) fn refine_by_surroundings(
        &self,
        tile: &mut Tile,
        predicts: bool,
        rows: &mut Rows,
    ) -> Result<(), Interrupted> {
        for (number, scale) in self.focus.coarse.scales.iter().enumerate() {
            let weak = if number == 0 { WEAK } else { 0.0 };
            let mut candidates = predicts.then(Candidates::new);
            (0..tile.rect.height).for_each(|row| self.refine_row(tile, row, scale, weak, candidates.as_mut()));
            for ((around, own), pixels) in candidates.into_iter().flat_map(Candidates::finish) {
                let (around, own) = (usize::from(around), usize::from(own));
                let disc = Disc::new(self.model.radius(around, own));
                let reach = FocusEnergy::for_decision_map().reach() + disc.reach();
                for (bounds, pixels) in in_blocks(&pixels, |&at| at, tile.rect, reach) {
                    self.predict(tile, (around, own), &disc, (bounds, &pixels), rows)?;
                }
            }
        }
        Ok(())
    }

    /// Gives the pixels without texture of a row to the slice that is sharpest around them, and lists the textured ones
    /// that its blur may explain. Up to `weak` times the energy around it, a pixel counts as one without texture.
    fn refine_row(
        &self,
        tile: &mut Tile,
        row: usize,
        scale: &CoarseScale,
        weak: f32,
        mut candidates: Option<&mut Candidates>,
    ) {
        let (x, y, width) = (tile.rect.x, tile.rect.y + row, tile.rect.width);
        let line = row * width..(row + 1) * width;
        let (slices, textured) = (&mut tile.slice[line.clone()], &mut tile.textured[line.clone()]);
        let energies = &self.focus.energy.row(y)[x..x + width];
        let around = scale.slice.row(y / CELL).iter().zip(scale.energy.row(y / CELL));
        let around = around.zip(self.focus.coarse.textureless.row(y / CELL)).skip(x / CELL);
        let cells = slices.chunks_mut(CELL).zip(textured.chunks_mut(CELL)).zip(around);
        for (i, ((slices, textured), ((&around, &around_energy), &textureless))) in cells.enumerate() {
            // cells are whole except at the border of the canvas, and whole ones are compared at once
            let is_same = match slices.first_chunk::<CELL>() {
                Some(cell) => *cell == [around; CELL],
                None => slices.iter().all(|&own| own == around),
            };
            if around == UNCOVERED || is_same {
                continue;
            }
            let covered = self.slices.coverage(usize::from(around)).span(y);
            for (column, (own, textured)) in (i * CELL..).zip(slices.iter_mut().zip(textured)) {
                let energy = energies[column].value();
                let has_texture = *textured && energy > weak * around_energy;
                let separable = || self.model.separable(usize::from(*own), usize::from(around));
                let may_change = *own != UNCOVERED
                    && covered.contains(&(x + column))
                    && ((textureless && !has_texture) || separable());
                if may_change && !has_texture {
                    (*own, *textured) = (around, false);
                } else if may_change
                    && let Some(candidates) = candidates.as_mut()
                    && energy <= explicable(around_energy, self.model.radius(around.into(), (*own).into()))
                {
                    candidates.add((around, *own), line.start + column);
                }
            }
        }
    }

    /// Gives `pixels` of slice `own`, which lie within `bounds`, to slice `around` where its blur by `disc` explains
    /// them.
    fn predict(
        &self,
        tile: &mut Tile,
        (around, own): (usize, usize),
        disc: &Disc,
        (bounds, pixels): (Rect, &[usize]),
        rows: &mut Rows,
    ) -> Result<(), Interrupted> {
        let (width, height) = self.slices.size();
        let measure = FocusEnergy::for_decision_map();
        let core = bounds.grown(measure.reach(), width, height);
        let window = disc.window(core, width, height);
        let mut difference = self.slices.luma(own, core)?;
        let inner = Rect { x: core.x - window.x, y: core.y - window.y, ..core };
        let blurred = disc.blurred_in(&self.slices.luma(around, window)?, inner);
        difference.data.iter_mut().zip(&blurred.data).for_each(|(own, blurred)| *own -= blurred);
        let unexplained = measure.plane(&difference, rows);
        for &at in pixels {
            let (x, y) = (tile.rect.x + at % tile.rect.width, tile.rect.y + at / tile.rect.width);
            if unexplained.at(x - core.x, y - core.y) < MAX_UNEXPLAINED * self.focus.energy.at(x, y).value() {
                tile.slice[at] = around as u16;
                tile.textured[at] = false;
            }
        }
        Ok(())
    }
}

/// The largest energy of a pixel that blur by a disc of `radius` px can explain, given the mean energy around the
/// pixel.
fn explicable(around: f32, radius: f32) -> f32 {
    around * (REMAINING / (radius * radius)).max(MIN_REMAINING)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Plane;

    /// Weighted mean over 31 x 31 px around a place, with the weights of the narrow scale of the coarse focus.
    fn mean_around(energy: &Plane<f32>, x: usize, y: usize) -> f32 {
        let (mut sum, mut total) = (0.0, 0.0);
        for (u, v) in (0..31).flat_map(|v| (0..31).map(move |u| (u, v))) {
            let distance = (u as f32 - 15.0).powi(2) + (v as f32 - 15.0).powi(2);
            let weight = (-distance / 72.0).exp();
            sum += weight * energy.at(x + u - 15, y + v - 15);
            total += weight;
        }
        sum / total
    }

    #[test]
    fn blurred_edges_and_texture_seldom_have_more_energy_than_counts_as_explicable() {
        let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32;
        let edge = Plane::from_fn(120, 120, |x, y| if 3 * x + y < 240 { 40.0 } else { 200.0 });
        let texture = Plane::from_fn(120, 120, hash);
        let patches = Plane::from_fn(120, 120, |x, y| hash(x / 5, y / 5));
        let measure = FocusEnergy::for_decision_map();
        for (name, picture) in [("edge", edge), ("texture", texture), ("patches", patches)] {
            let sharp = measure.plane(&picture, &mut Rows::default());
            for radius in [1.8f32, 2.5, 4.0, 7.0, 11.0] {
                let left = measure.plane(&Disc::new(radius).blurred(&picture), &mut Rows::default());
                let places: Vec<(usize, usize)> =
                    (30..90).step_by(3).flat_map(|y| (30..90).step_by(3).map(move |x| (x, y))).collect();
                let more = places.iter().filter(|&&(x, y)| {
                    // a prediction succeeds only if this share of the pixel's energy is left after blurring
                    let needed = (1.0 - MAX_UNEXPLAINED.sqrt()).powi(2);
                    let explained = left.at(x, y) / needed;
                    explained > 1.0 && explained > explicable(mean_around(&sharp, x, y), radius)
                });
                let more = more.count() as f32 / places.len() as f32;
                assert!(more < 0.2, "{name}, radius {radius}: {more} of all places");
            }
        }
    }
}
