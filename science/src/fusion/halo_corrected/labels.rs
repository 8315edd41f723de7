//! One label per pixel: the slice in which it is sharp, doubted where another slice explains it.
//!
//! The sharpest slice at a pixel is wrong beside strong detail: the blur of an edge in a far-off slice has more energy
//! than the smooth place it spreads over has in any slice. But that blur can be foretold from the slice in which
//! the edge is sharp. So where the sharpest slice of the surroundings is another one, and blurring it leaves nothing
//! of the pixel's own slice unexplained, the surroundings are right. Most of the doubts would come to nothing: blur leaves
//! little of detail, and a pixel with more than that of its own is not asked.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::{
    bounds::bounds,
    calm::calmed,
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
    types::Interrupted,
};

/// Times the noise from which energy is detail.
pub(super) const DETAIL: f32 = 4.0;

/// Share of a pixel's energy that may stay unexplained.
const UNEXPLAINED: f32 = 0.2;

/// Times the mean energy of wide surroundings that a pixel may have for their blur to explain it: `LEFT / r^2` where they are
/// blurred by a disc of radius r px, and at least `LEAST`, because the rim of a large disc is sharp.
const LEFT: f32 = 8.0;
const LEAST: f32 = 1.0 / 12.0;

/// Side of the tiles that labels are doubted in, px; a multiple of a cell.
const TILE: usize = 256;

/// Sides of the squares in which pixels are explained, px: what is around a square costs more than the square, and scattered
/// pixels are no reason to blur all that lies between them.
const SIDES: [usize; 4] = [256, 64, 32, 16];

/// What a square costs besides its pixels, in pixels.
const EACH: usize = 1000;

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
) -> Result<Labels, Interrupted> {
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
        .collect::<Result<_, Interrupted>>()?;
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
    fn tile(&self, rect: Rect, rows: &mut Rows) -> Result<Part, Interrupted> {
        let cut = |y: usize| rect.y + y;
        let columns = rect.x..rect.x + rect.width;
        let mut part = Part {
            rect,
            slice: (0..rect.height).flat_map(|y| &self.sharpest.row(cut(y))[columns.clone()]).copied().collect(),
            sure: (0..rect.height).flat_map(|y| &self.sure.row(cut(y))[columns.clone()]).copied().collect(),
        };
        for wide in &self.surveyed.wide {
            // pixels whose own detail must be explained first, by (slice of the surroundings, own slice)
            let mut claims = Claims::default();
            for row in 0..rect.height {
                let y = rect.y + row;
                let line = row * rect.width..(row + 1) * rect.width;
                let (slices, sure) = (&mut part.slice[line.clone()], &part.sure[line.clone()]);
                let energies = &self.energy.row(y)[columns.clone()];
                let surroundings = wide.slice.row(y / CELL).iter().zip(wide.energy.row(y / CELL));
                let surroundings = surroundings.zip(self.surveyed.plain.row(y / CELL)).skip(rect.x / CELL);
                let cells = slices.chunks_mut(CELL).zip(sure.chunks(CELL)).zip(surroundings);
                for (i, ((slices, sure), ((&around, &detail), &plain))) in cells.enumerate() {
                    if around == UNCOVERED || slices.iter().all(|&own| own == around) {
                        continue;
                    }
                    let covered = self.pictures.coverage(usize::from(around)).span(y);
                    for (k, (own, sure)) in slices.iter_mut().zip(sure).enumerate() {
                        let column = i * CELL + k;
                        let (known, there) = (*own != UNCOVERED, covered.contains(&(rect.x + column)));
                        let apart = || self.optics.apart(usize::from(*own), usize::from(around));
                        if !known || !there || !((plain && !sure) || apart()) {
                            continue;
                        }
                        if !sure {
                            *own = around;
                        } else if energies[column]
                            <= explicable(detail, self.optics.radius(around.into(), (*own).into()))
                        {
                            claims.add((around, *own), line.start + column);
                        }
                    }
                }
            }
            for ((around, own), pixels) in claims.finish() {
                let (around, own) = (usize::from(around), usize::from(own));
                let disc = Disc::new(self.optics.radius(around, own));
                let reach = FocusEnergy::steady().reach() + disc.reach();
                for (bounds, pixels) in in_squares(&pixels, rect, reach) {
                    self.explain(&mut part, around, own, &disc, (bounds, &pixels), rows)?;
                }
            }
        }
        Ok(part)
    }

    /// Gives pixels of slice `own`, which lie within `bounds`, to slice `around` where its blur by `disc` explains them.
    fn explain(
        &self,
        part: &mut Part,
        around: usize,
        own: usize,
        disc: &Disc,
        (bounds, pixels): (Rect, &[usize]),
        rows: &mut Rows,
    ) -> Result<(), Interrupted> {
        let (width, height) = self.pictures.size();
        let measure = FocusEnergy::steady();
        let core = bounds.grown(measure.reach(), width, height);
        let window = core.grown(disc.reach(), width, height);
        let mut difference = self.pictures.luma(own, core)?;
        let inner = Rect { x: core.x - window.x, y: core.y - window.y, ..core };
        let blurred = disc.blurred_in(&self.pictures.luma(around, window)?, inner);
        difference.data.iter_mut().zip(&blurred.data).for_each(|(own, blurred)| *own -= blurred);
        let left = measure.plane(&difference, rows);
        for &at in pixels {
            let (x, y) = (part.rect.x + at % part.rect.width, part.rect.y + at / part.rect.width);
            if left.at(x - core.x, y - core.y) < UNEXPLAINED * self.energy.at(x, y) {
                part.slice[at] = around as u16;
                part.sure[at] = false;
            }
        }
        Ok(())
    }
}

/// The largest energy that surroundings of mean energy `detail` can explain when a disc of `radius` px blurs them.
fn explicable(detail: f32, radius: f32) -> f32 {
    detail * (LEFT / (radius * radius)).max(LEAST)
}

/// Pixels by a key that most often is the last one's too.
#[derive(Default)]
struct Claims {
    all: BTreeMap<(u16, u16), Vec<usize>>,
    last: ((u16, u16), Vec<usize>),
}

impl Claims {
    fn add(&mut self, key: (u16, u16), pixel: usize) {
        if key != self.last.0 {
            self.put_away();
            self.last.0 = key;
        }
        self.last.1.push(pixel);
    }

    fn put_away(&mut self) {
        if !self.last.1.is_empty() {
            self.all.entry(self.last.0).or_default().append(&mut self.last.1);
        }
    }

    fn finish(mut self) -> BTreeMap<(u16, u16), Vec<usize>> {
        self.put_away();
        self.all
    }
}

/// `pixels` of `rect` by squares, each with the smallest rectangle around its own: squares of that side with which least is
/// looked at, `reach` px around each rectangle included.
fn in_squares(pixels: &[usize], rect: Rect, reach: usize) -> Vec<(Rect, Vec<usize>)> {
    let of_side = |side: usize| -> Vec<(Rect, Vec<usize>)> {
        let mut squares: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for &at in pixels {
            squares.entry((at / rect.width / side, at % rect.width / side)).or_default().push(at);
        }
        squares.into_values().map(|pixels| (bounds(pixels.iter().copied(), rect), pixels)).collect()
    };
    let cost = |squares: &[(Rect, Vec<usize>)]| -> usize {
        let area = |bounds: &Rect| (bounds.width + 2 * reach) * (bounds.height + 2 * reach);
        squares.iter().map(|(bounds, _)| area(bounds) + EACH).sum()
    };
    SIDES.into_iter().map(of_side).min_by_key(|squares| cost(squares)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of the square of 31 x 31 px around a place, weighted as narrow surroundings are.
    fn around(energy: &Plane<f32>, x: usize, y: usize) -> f32 {
        let (mut sum, mut total) = (0.0, 0.0);
        for (u, v) in (0..31).flat_map(|v| (0..31).map(move |u| (u, v))) {
            let away = (u as f32 - 15.0).powi(2) + (v as f32 - 15.0).powi(2);
            let weight = (-away / 72.0).exp();
            sum += weight * energy.at(x + u - 15, y + v - 15);
            total += weight;
        }
        sum / total
    }

    #[test]
    fn what_blur_leaves_of_edges_and_of_texture_is_seldom_more_than_is_asked_for() {
        let hash = |x: usize, y: usize| ((x * 7919 + y * 104_729 + x * y * 31) % 251) as f32;
        let edge = Plane::from_fn(120, 120, |x, y| if 3 * x + y < 240 { 40.0 } else { 200.0 });
        let texture = Plane::from_fn(120, 120, hash);
        let patches = Plane::from_fn(120, 120, |x, y| hash(x / 5, y / 5));
        let measure = FocusEnergy::steady();
        for (name, picture) in [("edge", edge), ("texture", texture), ("patches", patches)] {
            let sharp = measure.plane(&picture, &mut Rows::default());
            for radius in [1.8f32, 2.5, 4.0, 7.0, 11.0] {
                let left = measure.plane(&Disc::new(radius).blurred(&picture), &mut Rows::default());
                let places: Vec<(usize, usize)> =
                    (30..90).step_by(3).flat_map(|y| (30..90).step_by(3).map(move |x| (x, y))).collect();
                let more = places.iter().filter(|&&(x, y)| {
                    // less than this of a pixel's energy is unexplained only if so much of it is left
                    let needed = (1.0 - UNEXPLAINED.sqrt()).powi(2);
                    let explained = left.at(x, y) / needed;
                    explained > 1.0 && explained > explicable(around(&sharp, x, y), radius)
                });
                let more = more.count() as f32 / places.len() as f32;
                assert!(more < 0.2, "{name}, radius {radius}: {more} of all places");
            }
        }
    }
}
