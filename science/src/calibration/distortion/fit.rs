//! The joint least-squares fit of a lens distortion and of one homography per view.
//!
//! All coordinates are in units (see [`super::super::transform_models`]). With the distortion `D`, a dot that is at `x`
//! in the reference slice is at `D(H_i D^-1(x))` in slice i; and a dot of the printed grid that is at `g` on the plate
//! is at `D(H g)` in the reference slice. The homographies are eliminated from the normal equations (Schur complement),
//! so the system to solve has the size of the distortion, whatever the number of slices.

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, Vector2};

use super::super::statistics::median;
use super::super::transform_models::{Match, Parameters, jacobian, map_point};
use crate::types::distortion::Distortion;

/// Dots that one homography maps.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// The slice; the reference slice for the printed grid.
    pub slice: usize,
    /// Positions in the reference slice (or on the plate) and in the slice, both as seen, with distortion.
    pub matches: Vec<Match>,
    /// True for the printed grid: its positions on the plate have no distortion.
    pub is_grid: bool,
    /// Weight relative to independent dots.
    pub weight: f64,
}

/// Distortion as fitted: `k1`, centre (x, y), `k2`.
pub(super) type Coefficients = [f64; 4];

/// The distortion with these coefficients, in units.
pub(super) fn lens(c: &Coefficients) -> Distortion {
    Distortion { centre_px: [c[1], c[2]], k1: c[0], k2: c[3], radius_px: 1.0 }
}

/// A joint fit.
#[derive(Debug, Clone)]
pub(super) struct JointFit {
    /// The distortion.
    pub coefficients: Coefficients,
    /// Covariance of its free coefficients, the first ones.
    pub covariance: DMatrix<f64>,
    /// Per view the transform of ideal positions.
    pub parameters: Vec<Parameters>,
    /// Per view the change of its parameters per change of the free coefficients, negative.
    response: Vec<DMatrix<f64>>,
}

/// Standard deviation of the centre of a lens about the centre of the image, units.
const CENTRE: f64 = 0.15;
/// Huber limit, in standard deviations.
const HUBER: f64 = 2.0;
/// Smallest scatter that is accepted, relative to the expected noise.
const MIN_SCATTER: f64 = 0.3;
/// Most iterations.
const ROUNDS: usize = 16;
/// Step of numeric derivatives.
const STEP: f64 = 1e-5;

/// The normal equations of one view, with its homography eliminated.
struct Reduced {
    inverse: DMatrix<f64>,
    mixed: DMatrix<f64>,
    own: DVector<f64>,
    normal: DMatrix<f64>,
    right: DVector<f64>,
}

/// Fits the first `size` coefficients, starting at `start`, and all homographies. With `size` 0 only the homographies.
/// `None` when the dots do not determine them.
pub(super) fn fit(views: &[View], size: usize, start: Coefficients) -> Option<JointFit> {
    let mut coefficients = start;
    let mut parameters: Vec<Parameters> = vec![[0.0; 8]; views.len()];
    let mut scatters = vec![f64::INFINITY; views.len()];
    for round in 0..ROUNDS {
        let mut all = Vec::with_capacity(views.len());
        for ((view, p), scatter) in views.iter().zip(&parameters).zip(&mut scatters) {
            all.push(reduce(view, size, &coefficients, p, scatter)?);
        }
        let mut normal = prior(size);
        let mut right = DVector::zeros(size);
        for k in 1..size.min(3) {
            right[k] = -coefficients[k] * normal[(k, k)];
        }
        for reduced in &all {
            normal += &reduced.normal;
            right += &reduced.right;
        }
        let covariance = if size == 0 { DMatrix::zeros(0, 0) } else { normal.clone().try_inverse()? };
        let mut step = &covariance * right;
        step.iter_mut().for_each(|s| *s = s.clamp(-0.1, 0.1));
        let mut moved: f64 = 0.0;
        for k in 0..size {
            coefficients[k] += step[k];
            moved = moved.max(step[k].abs());
        }
        coefficients[0] = coefficients[0].clamp(-0.3, 0.5);
        coefficients[3] = coefficients[3].clamp(-0.1, 0.3);
        for (p, reduced) in parameters.iter_mut().zip(&all) {
            let change = &reduced.inverse * (&reduced.own - &reduced.mixed * &step);
            for (p, change) in p.iter_mut().zip(change.iter()) {
                *p += change;
                moved = moved.max(change.abs());
            }
        }
        if !moved.is_finite() {
            return None;
        }
        if (round >= 4 && moved < 1e-8) || round + 1 == ROUNDS {
            let response = all.iter().map(|r| &r.inverse * &r.mixed).collect();
            let covariance = widened(covariance, &normal, views, &all);
            return Some(JointFit { coefficients, covariance, parameters, response });
        }
    }
    None
}

/// What is known of the coefficients before any dot: the centre of the lens is near that of the image.
fn prior(size: usize) -> DMatrix<f64> {
    let mut normal = DMatrix::zeros(size, size);
    for k in 1..size.min(3) {
        normal[(k, k)] = 1.0 / (CENTRE * CENTRE);
    }
    normal
}

/// The normal equations of one view; updates its scatter.
fn reduce(view: &View, size: usize, c: &Coefficients, p: &Parameters, scatter: &mut f64) -> Option<Reduced> {
    let mut hh = SMatrix::<f64, 8, 8>::zeros();
    let mut hk = DMatrix::zeros(8, size);
    let (mut kk, mut own, mut right) =
        (DMatrix::zeros(size, size), SMatrix::<f64, 8, 1>::zeros(), DVector::zeros(size));
    let known = if scatter.is_finite() { *scatter } else { 1.0 };
    let limit = HUBER * *scatter;
    let mut sizes = Vec::with_capacity(view.matches.len());
    for m in &view.matches {
        let seen = predict(c, p, m.base, view.is_grid);
        let miss = Vector2::new(m.here[0] - seen[0], m.here[1] - seen[1]) / m.sigma;
        let far = miss.norm();
        sizes.push(far);
        let robust = if far <= limit { 1.0 } else { limit / far };
        let weight = robust * view.weight / (known * known * m.sigma * m.sigma);
        let jh = by_parameters(c, p, m.base, view.is_grid);
        let jk = by_coefficients(c, p, m.base, view.is_grid, size);
        let miss = miss * m.sigma;
        hh += weight * jh.transpose() * jh;
        own += weight * jh.transpose() * miss;
        hk += weight * (jh.transpose() * &jk);
        kk += weight * (jk.transpose() * &jk);
        right += weight * (jk.transpose() * miss);
    }
    // the median length of a two-dimensional normal deviate is 1.18 sigma
    *scatter = (median(&mut sizes) / 1.18).max(MIN_SCATTER);
    let inverse = hh.try_inverse()?;
    let inverse = DMatrix::from_column_slice(8, 8, inverse.as_slice());
    let own = DVector::from_column_slice(own.as_slice());
    let across = hk.transpose() * &inverse;
    let normal = kk - &across * &hk;
    let right = right - &across * &own;
    Some(Reduced { inverse, mixed: hk, own, normal, right })
}

/// The covariance, widened to what leaving out one slice at a time shows (a jackknife): errors that the dots of a slice
/// share do not average out among them.
fn widened(covariance: DMatrix<f64>, normal: &DMatrix<f64>, views: &[View], all: &[Reduced]) -> DMatrix<f64> {
    let parts: Vec<&Reduced> = all.iter().zip(views).filter(|(_, view)| !view.is_grid).map(|(part, _)| part).collect();
    if covariance.is_empty() || parts.len() < 3 {
        return covariance;
    }
    let count = parts.len() as f64;
    let square: f64 = parts
        .iter()
        .filter_map(|part| {
            let rest = (normal - &part.normal).try_inverse()?;
            Some((rest * &part.right)[0].powi(2))
        })
        .sum();
    let ratio = square * (count - 1.0) / count / covariance[(0, 0)].max(1e-300);
    covariance * ratio.max(1.0)
}

/// Where the dot at `base` is seen.
pub(super) fn predict(c: &Coefficients, p: &Parameters, base: [f64; 2], is_grid: bool) -> [f64; 2] {
    let lens = lens(c);
    lens.distort(map_point(p, if is_grid { base } else { lens.undistort(base) }))
}

fn by_parameters(c: &Coefficients, p: &Parameters, base: [f64; 2], is_grid: bool) -> SMatrix<f64, 2, 8> {
    let lens = lens(c);
    let ideal = if is_grid { base } else { lens.undistort(base) };
    let [dx, dy] = jacobian(p, ideal);
    let [x, y] = map_point(p, ideal);
    let (x, y) = (x - c[1], y - c[2]);
    let square = x * x + y * y;
    let factor = 1.0 + square * (lens.k1 + square * lens.k2);
    let slope = 2.0 * (lens.k1 + 2.0 * square * lens.k2);
    let bend = Matrix2::new(factor + slope * x * x, slope * x * y, slope * x * y, factor + slope * y * y);
    bend * SMatrix::<f64, 2, 8>::from_fn(|row, k| if row == 0 { dx[k] } else { dy[k] })
}

fn by_coefficients(c: &Coefficients, p: &Parameters, base: [f64; 2], is_grid: bool, size: usize) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(2, size);
    for k in 0..size {
        let moved = |by: f64| {
            let mut c = *c;
            c[k] += by;
            predict(&c, p, base, is_grid)
        };
        let (up, down) = (moved(STEP), moved(-STEP));
        for a in 0..2 {
            out[(a, k)] = (up[a] - down[a]) / (2.0 * STEP);
        }
    }
    out
}

impl JointFit {
    /// Standard deviation of a free coefficient of the distortion.
    pub(super) fn sigma(&self, coefficient: usize) -> f64 {
        self.covariance[(coefficient, coefficient)].max(0.0).sqrt()
    }

    /// Standard deviation of the position of `corner` in view `index`, units, from the uncertainty of the distortion.
    /// Its homography follows the distortion.
    pub(super) fn corner_sigma(&self, index: usize, corner: [f64; 2]) -> f64 {
        let (c, p) = (&self.coefficients, &self.parameters[index]);
        let direct = by_coefficients(c, p, corner, false, self.covariance.nrows());
        let followed = by_parameters(c, p, corner, false) * &self.response[index];
        let total = direct - followed;
        (&total * &self.covariance * total.transpose()).trace().max(0.0).sqrt()
    }
}
