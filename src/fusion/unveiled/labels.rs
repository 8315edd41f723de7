//! One label per pixel: the slice in which it is sharp, doubted where another slice explains it.
//!
//! The sharpest slice at a pixel is wrong beside strong detail: the blur of an edge in a far-off slice has more energy
//! than the smooth place it spreads over has in any slice. But that blur can be foretold from the slice in which
//! the edge is sharp. So where the sharpest slice of the surroundings is another one, and blurring it leaves nothing
//! of the pixel's own slice unexplained, the surroundings are right.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{
    optics::Optics,
    pictures::Pictures,
    survey::{CELL, Surveyed},
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

/// Times the noise from which energy is detail.
pub(super) const DETAIL: f32 = 4.0;

/// Share of a pixel's energy that may stay unexplained.
const UNEXPLAINED: f32 = 0.2;

/// Side of the tiles that labels are doubted in, px; a multiple of a cell.
const TILE: usize = 256;

/// Side of the squares in which few pixels are explained, px: those at opposite ends of a tile are no reason to blur all of
/// it.
const BLOCK: usize = 64;

/// Labels, and where they come from detail of the pixel's own.
pub(crate) struct Labels {
    /// 0-based slice; [`UNCOVERED`] where there is none.
    pub slice: Plane<u16>,
    /// Whether the pixel's own detail says so.
    pub sure: Plane<bool>,
}

/// The labels of a stack: `sharpest` is the sharpest slice per pixel and `energy` its focus energy.
pub(super) fn refine<S: Sample, const C: usize>(
    pictures: &Pictures<'_, S, C>,
    sharpest: &Plane<u16>,
    sure: Plane<bool>,
    energy: &Plane<f32>,
    surveyed: &Surveyed,
    optics: &Optics,
) -> Result<Labels, Stop> {
    let (width, height) = pictures.size();
    let tiles: Vec<Rect> = (0..height)
        .step_by(TILE)
        .flat_map(|y| {
            (0..width).step_by(TILE).map(move |x| Rect {
                x,
                y,
                width: TILE.min(width - x),
                height: TILE.min(height - y),
            })
        })
        .collect();
    let doubt = Doubt { pictures, sharpest, sure: &sure, energy, surveyed, optics };
    let parts: Vec<Part> = tiles
        .into_par_iter()
        .with_max_len(1)
        .map_init(Rows::default, |rows, rect| doubt.tile(rect, rows))
        .collect::<Result<_, Stop>>()?;
    let mut labels = Labels { slice: sharpest.clone(), sure };
    for part in parts {
        for y in 0..part.rect.height {
            let (from, to) = (y * part.rect.width, part.rect.x..part.rect.x + part.rect.width);
            let row = from..from + part.rect.width;
            labels.slice.row_mut(part.rect.y + y)[to.clone()].copy_from_slice(&part.slice[row.clone()]);
            labels.sure.row_mut(part.rect.y + y)[to].copy_from_slice(&part.sure[row]);
        }
    }
    labels.slice = calmed(pictures, &labels.slice);
    Ok(labels)
}

struct Part {
    rect: Rect,
    slice: Vec<u16>,
    sure: Vec<bool>,
}

struct Doubt<'a, S, const C: usize> {
    pictures: &'a Pictures<'a, S, C>,
    sharpest: &'a Plane<u16>,
    sure: &'a Plane<bool>,
    energy: &'a Plane<f32>,
    surveyed: &'a Surveyed,
    optics: &'a Optics,
}

impl<S: Sample, const C: usize> Doubt<'_, S, C> {
    fn tile(&self, rect: Rect, rows: &mut Rows) -> Result<Part, Stop> {
        let cut = |y: usize| rect.y + y;
        let columns = rect.x..rect.x + rect.width;
        let mut part = Part {
            rect,
            slice: (0..rect.height).flat_map(|y| &self.sharpest.row(cut(y))[columns.clone()]).copied().collect(),
            sure: (0..rect.height).flat_map(|y| &self.sure.row(cut(y))[columns.clone()]).copied().collect(),
        };
        for wide in &self.surveyed.wide {
            // pixels whose own detail must be explained first, by (slice of the surroundings, own slice)
            let mut claims: BTreeMap<(u16, u16), Vec<usize>> = BTreeMap::new();
            for at in 0..part.slice.len() {
                let (x, y) = (rect.x + at % rect.width, rect.y + at / rect.width);
                let (own, around) = (part.slice[at], wide.at(x / CELL, y / CELL));
                if own == UNCOVERED || around == UNCOVERED || own == around {
                    continue;
                }
                let covered = self.pictures.coverage(usize::from(around)).span(y).contains(&x);
                if !covered || !self.optics.apart(usize::from(own), usize::from(around)) {
                    continue;
                }
                if part.sure[at] {
                    claims.entry((around, own)).or_default().push(at);
                } else {
                    part.slice[at] = around;
                }
            }
            for ((around, own), pixels) in claims {
                self.explain(&mut part, usize::from(around), usize::from(own), &pixels, rows)?;
            }
        }
        Ok(part)
    }

    /// Gives `pixels` of slice `own` to slice `around` where its blur explains them.
    fn explain(
        &self,
        part: &mut Part,
        around_slice: usize,
        own: usize,
        pixels: &[usize],
        rows: &mut Rows,
    ) -> Result<(), Stop> {
        let (width, height) = self.pictures.size();
        let disc = Disc::new(self.optics.radius(around_slice, own));
        let measure = FocusEnergy::steady();
        let bounds = bounds(pixels, part.rect);
        let around = measure.reach() + disc.reach();
        if let Some(blocks) = in_blocks(pixels, bounds, part.rect, around) {
            for pixels in blocks {
                self.explain(part, around_slice, own, &pixels, rows)?;
            }
            return Ok(());
        }
        let (core, window) = (bounds.grown(measure.reach(), width, height), bounds.grown(around, width, height));
        let mut difference = self.pictures.luma(own, core)?;
        let inner = Rect { x: core.x - window.x, y: core.y - window.y, ..core };
        let blurred = disc.blurred_in(&self.pictures.luma(around_slice, window)?, inner);
        difference.data.iter_mut().zip(&blurred.data).for_each(|(own, blurred)| *own -= blurred);
        let left = measure.plane(&difference, rows);
        for &at in pixels {
            let (x, y) = (part.rect.x + at % part.rect.width, part.rect.y + at / part.rect.width);
            if left.at(x - core.x, y - core.y) < UNEXPLAINED * self.energy.at(x, y) {
                part.slice[at] = around_slice as u16;
                part.sure[at] = false;
            }
        }
        Ok(())
    }
}

/// `pixels` of `rect` by squares of [`BLOCK`] px, if these together and what is `around` each of them are less than `bounds`
/// and what is around that.
fn in_blocks(pixels: &[usize], bounds: Rect, rect: Rect, around: usize) -> Option<Vec<Vec<usize>>> {
    let area = |width: usize, height: usize| (width + 2 * around) * (height + 2 * around);
    let most = area(bounds.width, bounds.height) / area(BLOCK, BLOCK);
    if bounds.width.max(bounds.height) <= BLOCK || most < 2 {
        return None;
    }
    let mut blocks: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for &at in pixels {
        blocks.entry((at / rect.width / BLOCK, at % rect.width / BLOCK)).or_default().push(at);
        if blocks.len() >= most {
            return None;
        }
    }
    Some(blocks.into_values().collect())
}

/// The smallest rectangle of the canvas around `pixels` of `rect`.
fn bounds(pixels: &[usize], rect: Rect) -> Rect {
    let (mut left, mut right, mut top, mut bottom) = (usize::MAX, 0, usize::MAX, 0);
    for at in pixels {
        let (x, y) = (at % rect.width, at / rect.width);
        (left, right, top, bottom) = (left.min(x), right.max(x), top.min(y), bottom.max(y));
    }
    let (left, top) = (left.min(right), top.min(bottom));
    Rect { x: rect.x + left, y: rect.y + top, width: right - left + 1, height: bottom - top + 1 }
}

/// The median over five columns of the medians over five rows: single labels and frayed borders go. A pixel keeps its
/// label where the new one's slice does not cover it.
fn calmed<S: Sample, const C: usize>(pictures: &Pictures<'_, S, C>, labels: &Plane<u16>) -> Plane<u16> {
    let (width, height) = (labels.width, labels.height);
    let mut across = vec![0u16; width * height];
    across.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let row = labels.row(y);
        let at = |x: usize, d: isize| row[x.saturating_add_signed(d).min(width - 1)];
        for (x, out) in out.iter_mut().enumerate() {
            *out = if x >= 2 && x + 2 < width {
                middle([row[x - 2], row[x - 1], row[x], row[x + 1], row[x + 2]])
            } else {
                middle([-2, -1, 0, 1, 2].map(|d| at(x, d)))
            };
        }
    });
    let mut calm = Plane { width, height, data: vec![0u16; width * height] };
    calm.data.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        let rows = [-2, -1, 0, 1, 2].map(|d: isize| {
            let y = y.saturating_add_signed(d).min(height - 1);
            &across[y * width..(y + 1) * width]
        });
        for (x, out) in out.iter_mut().enumerate() {
            let (old, new) = (labels.at(x, y), middle(rows.map(|row| row[x])));
            let known = new != UNCOVERED && old != UNCOVERED;
            let taken = new == old || (known && pictures.coverage(usize::from(new)).span(y).contains(&x));
            *out = if taken { new } else { old };
        }
    });
    calm
}

/// The median of five.
#[inline(always)]
fn middle([a, b, c, d, e]: [u16; 5]) -> u16 {
    let (a, b) = (a.min(b), a.max(b));
    let (c, d) = (c.min(d), c.max(d));
    // of four, the least and the greatest are not the median
    let (low, high) = (a.max(c), b.min(d));
    let (low, high) = (low.min(high), low.max(high));
    e.clamp(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_of_five_is_their_median() {
        for code in 0..3125u16 {
            let values = [code % 5, code / 5 % 5, code / 25 % 5, code / 125 % 5, code / 625];
            let mut sorted = values;
            sorted.sort_unstable();
            assert_eq!(middle(values), sorted[2], "{values:?}");
        }
    }
}
