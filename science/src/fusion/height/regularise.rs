//! Averages estimates of the same surface, and fills gaps from reliable neighbours.
//!
//! In: the [`Estimates`] of single pixels and the index. Out, per pixel: position and standard deviation. Let `h_q` and
//! `c_q = 1 / sigma_q^2` be the estimate of pixel `q` and its confidence, `G` a Gaussian over the distance in the
//! image, and `T` Tukey's biweight, which is 0 where two positions differ by [`SAME_SURFACE`] steps or more:
//!
//! ```text
//! h(p) = sum G(p - q) T(h_q - r_p) c_q h_q / sum G(p - q) T(h_q - r_p) c_q
//! ```
//!
//! The reference `r_p` is the pixel's own estimate if that is reliable and near the weighted median of 9 pixels (itself
//! and those 2 px away), else that median. If the index is a decision map and its slice is [`SAME_SURFACE`] steps or
//! more from this, `r_p` is the position of that slice. So nothing is mixed across a step between surfaces, and a step
//! stays where it is. A pixel that remains uncertain takes the mean of the reliable cells of 4 x 4 px around it: of all
//! if they lie on one surface, else of those near the slice of the index.
//!
//! The variance of the mean is a share of the mean variance of its estimates and of their spread, times
//! `sum G c / sum G T c`, which is more than 1 near other surfaces, plus the squared departure from the decision map.

use rayon::prelude::*;

use super::estimates::Estimates;
use crate::{fusion::plan::UNCOVERED, imaging::Plane};

/// Radius of the window, px, and standard deviation of its Gaussian.
const RADIUS: usize = 4;
const GAUSSIAN: f32 = 2.0;
/// Difference of positions, steps, from which two estimates belong to different surfaces.
const SAME_SURFACE: f32 = 1.5;
/// Standard deviation, steps, up to which an estimate is reliable.
const RELIABLE: f32 = 0.5;
/// Share of the mean variance of the estimates of a window that their weighted mean has: their errors are correlated.
const CORRELATION: f32 = 0.35;
/// Share of the variance between the estimates of a window that counts as an error of their mean.
const SPREAD: f32 = 0.25;
/// Least standard deviation of a mean, steps.
const LEAST_SIGMA: f32 = 0.05;
/// Distance from the slice of a decision map, steps, up to which an estimate agrees with it; beyond it, the standard
/// deviation per step.
const WITHIN_INDEX: f32 = 0.6;
const DEPARTURE: f32 = 0.7;
/// Side of a cell, px.
pub(super) const CELL: usize = 4;
/// Radius of the window of cells, and standard deviation of its Gaussian, cells.
const CELL_RADIUS: usize = 8;
const CELL_GAUSSIAN: f32 = 3.0;
/// Spread of the positions of cells, steps, up to which they lie on one surface.
const ONE_SURFACE: f32 = 0.5;
/// Least sum of the Gaussian over reliable cells.
const MIN_CELLS: f32 = 1.5;
/// How much a surface may depart from the mean of its neighbours, steps per px of distance.
const ROUGHNESS: f32 = 0.015;

/// A position and its standard deviation, steps.
pub(super) type Estimate = (f32, f32);

/// The regularisation of a stack.
pub(super) struct Regularisation<'a> {
    raw: &'a Estimates,
    index: &'a Plane<u16>,
    refined: bool,
    positions: &'a [f64],
    weights: [[f32; 2 * RADIUS + 1]; 2 * RADIUS + 1],
    cell_weights: [f32; 2 * CELL_RADIUS + 1],
}

/// Buffers of [`Regularisation::fill`] for a row of cells.
#[derive(Default)]
pub(super) struct Filled {
    /// Per cell: the last slice of the index it was filled for, and the result.
    cells: Vec<Option<(u16, Option<Estimate>)>>,
}

impl Filled {
    /// Prepares for another row of cells.
    pub(super) fn clear(&mut self) {
        self.cells.clear();
    }
}

impl<'a> Regularisation<'a> {
    /// `positions`: of each slice, steps. `refined`: whether the index is a decision map, whose steps are those of the
    /// surface; otherwise it is only the largest focus measure of each pixel.
    pub(super) fn new(raw: &'a Estimates, index: &'a Plane<u16>, refined: bool, positions: &'a [f64]) -> Self {
        let gaussian = |d: usize, centre: usize, sigma: f32| {
            let squared = d.abs_diff(centre).pow(2) as f32;
            (-squared / (2.0 * sigma * sigma)).exp()
        };
        let weight = |d: usize| gaussian(d, RADIUS, GAUSSIAN);
        let weights = std::array::from_fn(|v| std::array::from_fn(|u| weight(u) * weight(v)));
        let cell_weights = std::array::from_fn(|d| gaussian(d, CELL_RADIUS, CELL_GAUSSIAN));
        Self { raw, index, refined, positions, weights, cell_weights }
    }

    /// The position of the slice of the index at (x, y); `None` where no slice covers the pixel.
    fn decided(&self, x: usize, y: usize) -> Option<f32> {
        let slice = self.index.at(x, y);
        if slice == UNCOVERED { None } else { self.positions.get(usize::from(slice)).map(|&position| position as f32) }
    }

    /// The position that the window of (x, y) is compared with: the pixel's own estimate, the median around it, or that
    /// of the decision map, which is right where a step between surfaces is.
    fn reference(&self, x: usize, y: usize) -> Option<f32> {
        let decided = self.decided(x, y);
        let Some(median) = self.median_around(x, y) else { return decided };
        let (own, confidence) = (self.raw.position.at(x, y), self.raw.confidence.at(x, y));
        let is_confirmed = confidence >= 1.0 / (RELIABLE * RELIABLE) && (own - median).abs() < 0.5 * SAME_SURFACE;
        let measured = if is_confirmed { own } else { median };
        let on_another_surface = |decided: &f32| self.refined && (measured - decided).abs() >= SAME_SURFACE;
        decided.filter(on_another_surface).or(Some(measured))
    }

    /// The median of 9 estimates, weighted by their confidence: that of the pixel, which counts twice, and those 2 px
    /// away from it. `None` where nothing is known.
    fn median_around(&self, x: usize, y: usize) -> Option<f32> {
        let mut around = [(0.0f32, 0.0f32); 9];
        let mut total = 0.0;
        for (i, slot) in around.iter_mut().enumerate() {
            let place = |at: usize, by: usize, length: usize| (at + 2 * by).saturating_sub(2).min(length - 1);
            let at = (place(x, i % 3, self.index.width), place(y, i / 3, self.index.height));
            let weight = self.raw.confidence.at(at.0, at.1) * if i == 4 { 2.0 } else { 1.0 };
            *slot = (self.raw.position.at(at.0, at.1), weight);
            total += weight;
        }
        if total <= 0.0 {
            return None;
        }
        around.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut below = 0.0;
        let median = around.iter().find(|(_, weight)| {
            below += weight;
            below >= 0.5 * total
        });
        Some(median.map_or(self.raw.position.at(x, y), |found| found.0))
    }

    /// The mean over the window of (x, y); `None` where nothing is known.
    pub(super) fn smooth(&self, x: usize, y: usize) -> Option<Estimate> {
        let reference = self.reference(x, y)?;
        let (width, height) = (self.index.width, self.index.height);
        let columns = x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(width);
        let left = columns.start + RADIUS - x;
        let limit = 1.0 / SAME_SURFACE;
        // sums of G T, G T c, G T c d, G T c d^2 with d = h - r, and of G c
        let [mut shares, mut total, mut first, mut second, mut all] = [0.0f32; 5];
        for v in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height) {
            let weights = &self.weights[v + RADIUS - y][left..];
            let heights = &self.raw.position.row(v)[columns.clone()];
            let confidences = &self.raw.confidence.row(v)[columns.clone()];
            for ((&weight, &height), &confidence) in weights.iter().zip(heights).zip(confidences) {
                let difference = height - reference;
                let u = (difference * limit).powi(2);
                let share = weight * (1.0 - u).max(0.0).powi(2);
                let known = if confidence > 0.0 { share } else { 0.0 };
                let c = share * confidence;
                shares += known;
                total += c;
                first += c * difference;
                second += c * difference * difference;
                all += weight * confidence;
            }
        }
        if total <= 0.0 {
            return None;
        }
        let mean = first / total;
        let spread = (second / total - mean * mean).max(0.0);
        let mixed = (all / total).min(10.0);
        let departs = self
            .decided(x, y)
            .filter(|_| self.refined)
            .map_or(0.0, |decided| ((reference + mean - decided).abs() - WITHIN_INDEX).max(0.0) * DEPARTURE);
        let variance =
            departs * departs + (CORRELATION * shares / total + SPREAD * spread) * mixed + LEAST_SIGMA * LEAST_SIGMA;
        Some((reference + mean, variance.sqrt()))
    }

    /// Per cell, the mean at its most confident pixel if that is reliable; otherwise a confidence of 0.
    pub(super) fn cells(&self) -> Estimates {
        let (width, height) = (self.index.width, self.index.height);
        let best = |column: usize, row: usize| {
            let pixels = (row * CELL..(row * CELL + CELL).min(height))
                .flat_map(|y| (column * CELL..(column * CELL + CELL).min(width)).map(move |x| (x, y)));
            let confidence = |&(x, y): &(usize, usize)| self.raw.confidence.at(x, y);
            let (x, y) = pixels.max_by(|a, b| confidence(a).total_cmp(&confidence(b)))?;
            self.smooth(x, y).filter(|_| confidence(&(x, y)) > 0.0).filter(|&(_, sigma)| sigma <= RELIABLE)
        };
        let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
        let mut cells =
            Estimates { position: Plane::filled(columns, rows, 0.0), confidence: Plane::filled(columns, rows, 0.0) };
        let lines = cells.position.data.par_chunks_mut(columns).zip(cells.confidence.data.par_chunks_mut(columns));
        lines.enumerate().for_each(|(row, (position, confidence))| {
            for (column, (position, confidence)) in position.iter_mut().zip(confidence).enumerate() {
                if let Some((mean, sigma)) = best(column, row) {
                    (*position, *confidence) = (mean, 1.0 / (sigma * sigma));
                }
            }
        });
        cells
    }

    /// The final estimate at (x, y). `filled` belongs to the row of cells of `y`.
    pub(super) fn at(&self, x: usize, y: usize, cells: &Estimates, filled: &mut Filled) -> Option<Estimate> {
        let slice = self.index.at(x, y);
        if slice == UNCOVERED {
            return None;
        }
        let smooth = self.smooth(x, y);
        if let Some((_, sigma)) = smooth
            && sigma <= RELIABLE
        {
            return smooth;
        }
        filled.cells.resize(cells.position.width, None);
        let slot = &mut filled.cells[x / CELL];
        let fill = match *slot {
            Some((of, result)) if of == slice => result,
            _ => {
                let result = self.decided(x, y).and_then(|decided| self.fill(x / CELL, y / CELL, decided, cells));
                *slot = Some((slice, result));
                result
            }
        };
        match (smooth, fill) {
            (Some(smooth), Some(fill)) => Some(if fill.1 < smooth.1 { fill } else { smooth }),
            (one, other) => one.or(other),
        }
    }

    /// The mean of the reliable cells around a cell.
    fn fill(&self, column: usize, row: usize, decided: f32, cells: &Estimates) -> Option<Estimate> {
        let (columns, rows) = (cells.position.width, cells.position.height);
        let mean_of = |accepts: &dyn Fn(f32) -> bool| {
            // sums of G, G c, G c d, G c d^2, and G c times the squared distance in cells
            let [mut shares, mut total, mut first, mut second, mut distance] = [0.0f32; 5];
            for v in row.saturating_sub(CELL_RADIUS)..(row + CELL_RADIUS + 1).min(rows) {
                for u in column.saturating_sub(CELL_RADIUS)..(column + CELL_RADIUS + 1).min(columns) {
                    let confidence = cells.confidence.at(u, v);
                    let difference = cells.position.at(u, v) - decided;
                    if confidence <= 0.0 || !accepts(difference) {
                        continue;
                    }
                    let share = self.cell_weights[u + CELL_RADIUS - column] * self.cell_weights[v + CELL_RADIUS - row];
                    let weight = share * confidence.min(100.0);
                    shares += share;
                    total += weight;
                    first += weight * difference;
                    second += weight * difference * difference;
                    distance += weight * (u.abs_diff(column).pow(2) + v.abs_diff(row).pow(2)) as f32;
                }
            }
            (shares >= MIN_CELLS).then(|| {
                let mean = first / total;
                let spread = (second / total - mean * mean).max(0.0);
                let away = ROUGHNESS * CELL as f32 * (distance / total).sqrt();
                (decided + mean, spread, (spread + shares / total + away * away).sqrt())
            })
        };
        let (position, spread, sigma) = mean_of(&|_| true)?;
        if spread.sqrt() <= ONE_SURFACE {
            return Some((position, sigma));
        }
        mean_of(&|difference| difference.abs() < SAME_SURFACE).map(|(position, _, sigma)| (position, sigma))
    }
}
