//! Registration of two slices: coarse to fine, then many windows each by itself.

use nalgebra::{DVector, Matrix2};

use super::matched::WindowMatch;
use super::picture::Picture;
use super::transform::derivatives;
use super::window::{HALF, Jacobian, Window};
use crate::calibration::transform_models::{self, Frame, Match, Parameters, TransformModel, map_point};
use crate::imaging::Plane;

/// How far the content may have moved between neighbouring slices, as a share of the longer side of the image.
const FARTHEST: f64 = 0.12;
/// Fewest windows from which a similarity is taken.
const FEWEST: usize = 8;
/// Fewest windows of a pair that counts.
pub(super) const LEAST_WINDOWS: usize = 12;
/// How far a window is searched beyond the start, px of its level, while levels are refined.
const COARSE_REACH: f64 = 6.0;
/// The same for the measurement.
const REACH: f64 = 3.0;
/// Standard deviation that every window has at least, px of its level: interpolation, occlusion.
const FLOOR: f64 = 0.02;
/// Places across and down the image from which windows are taken in equal numbers.
const PLACES: [usize; 2] = [14, 10];
/// Windows per place in the first level, and in each other level.
const PER_PLACE: [usize; 2] = [2, 1];
/// Levels in which windows are measured.
const MEASURED_LEVELS: usize = 3;

/// Two slices with the map from the first to the second.
pub(super) struct Registered {
    /// Parameters of the map, first slice to second.
    pub map: Parameters,
    /// The windows.
    pub windows: Vec<WindowMatch>,
}

/// The slices to register.
pub(super) struct Registration<'a> {
    pub first: &'a Picture,
    pub second: &'a Picture,
    pub frame: &'a Frame,
}

/// A window with both its places, px of the level.
struct Placed {
    first: [f64; 2],
    second: [f64; 2],
    /// Px^2 of the level.
    covariance: [f64; 3],
}

impl Registration<'_> {
    /// Registers the two slices. `near`: a map that is known to about a pixel of the first level; without one, the
    /// content is searched. `None` when they share too few windows.
    pub(super) fn run(&self, near: Option<Parameters>) -> Option<Registered> {
        let map = match near {
            Some(map) => map,
            None => self.coarse()?,
        };
        let levels = MEASURED_LEVELS.min(self.first.levels.len());
        let mut windows = Vec::new();
        for level in 0..levels {
            let per_place = PER_PLACE[level.min(1)];
            let placed = self.measured(level, &map, &self.strongest(level, &map, per_place), REACH);
            windows.extend(placed.iter().filter_map(|p| self.matched(level, p)));
        }
        (windows.len() >= LEAST_WINDOWS).then_some(Registered { map, windows })
    }

    /// The similarity from the first slice to the second, by search in the coarsest level.
    fn coarse(&self) -> Option<Parameters> {
        let coarsest = self.first.levels.len() - 1;
        let mut map = self.shifted(coarsest);
        let mut is_found = false;
        for level in (0..=coarsest).rev() {
            let middles = self.strongest(level, &map, PER_PLACE[1]);
            let placed = self.measured(level, &map, &middles, COARSE_REACH);
            if placed.len() < FEWEST {
                continue;
            }
            let matches: Vec<Match> = placed.iter().map(|p| self.plain_match(level, p)).collect();
            if let Some(fit) = transform_models::fit(TransformModel::Similarity, &matches) {
                map = TransformModel::Similarity.parameters(&fit.free);
                is_found = true;
            }
        }
        is_found.then_some(map)
    }

    /// The shift with the highest correlation of the detail, as parameters.
    fn shifted(&self, level: usize) -> Parameters {
        let (a, b) = (&self.first.levels[level], &self.second.levels[level]);
        let farthest = (FARTHEST * a.width.max(a.height) as f64).ceil() as isize;
        let score = |dx: isize, dy: isize| -> f64 {
            let rows = (0..a.height as isize).filter(|y| (0..b.height as isize).contains(&(y + dy)));
            let (from, to) = ((-dx).max(0), (b.width as isize - dx).min(a.width as isize));
            let (mut product, mut squares) = (0.0_f64, [0.0_f64; 2]);
            for y in rows {
                let here = &a.row(y as usize)[from as usize..to as usize];
                let there = &b.row((y + dy) as usize)[(from + dx) as usize..(to + dx) as usize];
                let sum = |x: &[f32], y: &[f32]| f64::from(x.iter().zip(y).map(|(x, y)| x * y).sum::<f32>());
                product += sum(here, there);
                squares = [squares[0] + sum(here, here), squares[1] + sum(there, there)];
            }
            product / (squares[0] * squares[1]).sqrt().max(1e-9)
        };
        let shifts = (-farthest..=farthest).flat_map(|dy| (-farthest..=farthest).map(move |dx| (dx, dy)));
        // of equal scores the smaller shift
        let best = shifts
            .map(|(dx, dy)| (score(dx, dy) - 1e-3 * ((dx * dx + dy * dy) as f64).sqrt() / farthest as f64, dx, dy))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or([0.0; 2], |(_, dx, dy)| [dx as f64, dy as f64]);
        let unit = self.first.side(level) / self.frame.half;
        let [x, y] = best.map(|v| v * unit);
        TransformModel::Similarity.parameters(&DVector::from_column_slice(&[0.0, 0.0, x, y]))
    }

    /// Middles of the windows of the first slice with the most detail that the second shows as well, spread over the
    /// image.
    fn strongest(&self, level: usize, map: &Parameters, per_place: usize) -> Vec<[usize; 2]> {
        let (a, b) = (&self.first.levels[level], &self.second.levels[level]);
        let (here, there) = (Blocks::of(a), Blocks::of(b));
        let mut places: Vec<Vec<(f32, [usize; 2])>> = vec![Vec::new(); PLACES[0] * PLACES[1]];
        for row in 1..here.rows {
            for column in 1..here.columns {
                let middle = [column * HALF, row * HALF];
                let to = self.mapped(level, map, middle.map(|v| v as f64));
                let Some(shown) = there.around(to) else { continue };
                let energy = here.at(column, row).min(shown);
                let place = [middle[0] * PLACES[0] / a.width, middle[1] * PLACES[1] / a.height];
                places[place[1] * PLACES[0] + place[0]].push((energy, middle));
            }
        }
        let best = places.iter_mut().flat_map(|place| {
            place.sort_by(|a, b| b.0.total_cmp(&a.0));
            place.iter().take(per_place).map(|(_, middle)| *middle)
        });
        best.collect()
    }

    /// The windows of the first slice around `middles` that are found in the second.
    fn measured(&self, level: usize, map: &Parameters, middles: &[[usize; 2]], reach: f64) -> Vec<Placed> {
        let (a, b) = (&self.first.levels[level], &self.second.levels[level]);
        let find = |middle: &[usize; 2]| {
            let window = Window::of(a, *middle)?;
            let first = window.middle();
            let local = self.local(level, map, first);
            let found = window.find(b, self.mapped(level, map, first), local, reach)?;
            Some(Placed { first, second: found.at, covariance: found.covariance })
        };
        middles.iter().filter_map(find).collect()
    }

    fn mapped(&self, level: usize, map: &Parameters, at: [f64; 2]) -> [f64; 2] {
        let sent = map_point(map, self.frame.unit(self.first.to_slice(level, at)));
        self.second.to_level(level, self.frame.pixel(sent))
    }

    fn local(&self, level: usize, map: &Parameters, at: [f64; 2]) -> Jacobian {
        derivatives(map, self.frame.unit(self.first.to_slice(level, at)))
    }

    /// The window for a fit that treats both directions alike.
    fn plain_match(&self, level: usize, placed: &Placed) -> Match {
        let [base, here] = [placed.first, placed.second].map(|at| self.frame.unit(self.first.to_slice(level, at)));
        let sigma = (placed.covariance[0] + placed.covariance[2] + FLOOR * FLOOR).sqrt();
        Match { base, here, sigma: sigma * self.first.side(level) / self.frame.half }
    }

    fn matched(&self, level: usize, placed: &Placed) -> Option<WindowMatch> {
        let [first, second] = [placed.first, placed.second].map(|at| self.frame.unit(self.first.to_slice(level, at)));
        let unit = (self.first.side(level) / self.frame.half).powi(2);
        let [xx, xy, yy] = placed.covariance;
        let covariance = Matrix2::new(xx + FLOOR * FLOOR, xy, xy, yy + FLOOR * FLOOR) * unit;
        let cell = self.first.cell(self.first.to_slice(level, placed.first))? as u32;
        Some(WindowMatch { first, second, information: covariance.try_inverse()?, cell })
    }
}

/// Mean squared detail of the windows of a level, at multiples of [`HALF`] px.
struct Blocks {
    columns: usize,
    rows: usize,
    sums: Vec<f32>,
}

impl Blocks {
    fn of(plane: &Plane<f32>) -> Self {
        let (columns, rows) = (plane.width / HALF, plane.height / HALF);
        let mut sums = vec![0.0; columns * rows];
        for y in 0..rows * HALF {
            for (sum, few) in sums[y / HALF * columns..].iter_mut().zip(plane.row(y).chunks_exact(HALF)) {
                *sum += few.iter().map(|v| v * v).sum::<f32>();
            }
        }
        Self { columns, rows, sums }
    }

    /// Of the window around the corner between four blocks.
    fn at(&self, column: usize, row: usize) -> f32 {
        let block = |x: usize, y: usize| self.sums[y * self.columns + x];
        block(column - 1, row - 1) + block(column, row - 1) + block(column - 1, row) + block(column, row)
    }

    /// Of the window nearest to a point; `None` outside.
    fn around(&self, at: [f64; 2]) -> Option<f32> {
        let [column, row] = at.map(|v| (v / HALF as f64).round());
        let is_inside = (1.0..self.columns as f64).contains(&column) && (1.0..self.rows as f64).contains(&row);
        is_inside.then(|| self.at(column as usize, row as usize))
    }
}
