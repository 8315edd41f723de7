//! The gain model: brightness over the rail is `a + b z + c z^2`, fitted so that single slices do not bend it.

use nalgebra::{Matrix3, Vector3};

use crate::calibration::statistics::{median_of, range};

/// A value at a rail position.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Rail position.
    pub z: f64,
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// The model.
#[derive(Debug, Clone)]
pub(super) struct GainModel {
    middle: f64,
    half: f64,
    coefficients: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// Scatter of the values about the model beyond their own standard deviations: the flicker of the light.
    pub scatter: f64,
    /// Sum of the squared deviations in standard deviations, each at most [`CUT`] squared, and of the squared curvature
    /// in its standard deviation.
    pub cost: f64,
}

/// Least standard deviation of a value.
const FLOOR: f64 = 2e-4;
/// Deviations beyond this many standard deviations count no more than this.
const CUT: f64 = 3.0;
/// Deviations beyond this many standard deviations have no weight in the end.
const GROSS: f64 = 8.0;
const ROUNDS: usize = 16;

impl GainModel {
    /// Weighted least squares with Huber's weights. `curvature` is the standard deviation expected of `c`, with z from
    /// -1 to 1 over the points; `scatter`: the scatter where it is known. `None` for fewer than three points.
    pub(super) fn fit(points: &[Point], curvature: f64, scatter: Option<f64>) -> Option<Self> {
        if points.len() < 3 {
            return None;
        }
        let (low, high) = range(points.iter().map(|p| p.z));
        let (middle, half) = (0.5 * (low + high), (0.5 * (high - low)).max(1e-9));
        let mut model = Self {
            middle,
            half,
            coefficients: Vector3::zeros(),
            covariance: Matrix3::zeros(),
            scatter: scatter.unwrap_or(0.0),
            cost: 0.0,
        };
        let sigmas: Vec<f64> = points.iter().map(|p| p.sigma.max(FLOOR)).collect();
        let usual = median_of(sigmas.iter().copied());
        // the degrees of freedom of a line; the prior bounds the curvature
        let freedom = (points.len() as f64 / (points.len() as f64 - 2.0)).sqrt();
        model.start(points);
        for round in 0..=ROUNDS {
            let off: Vec<f64> = points.iter().map(|p| p.value - model.at(p.z)).collect();
            if scatter.is_none() {
                let spread = 1.4826 * freedom * median_of(off.iter().map(|r| r.abs()));
                model.scatter = (spread * spread - usual * usual).max(0.0).sqrt();
            }
            let away = |k: usize| off[k].abs() / sigmas[k].hypot(model.scatter);
            if round == ROUNDS {
                model.cost = (model.coefficients[2] / curvature).powi(2)
                    + (0..points.len()).map(|k| away(k).min(CUT).powi(2)).sum::<f64>();
                break;
            }
            let mut normal = Matrix3::from_diagonal(&Vector3::new(1e-9, 1e-6, curvature.powi(-2)));
            let mut right = Vector3::zeros();
            for (k, point) in points.iter().enumerate() {
                let row = model.row(point.z);
                let is_gross = round + 4 > ROUNDS && away(k) > GROSS;
                let robust = if is_gross { 0.0 } else { (2.0 / away(k).max(1e-9)).min(1.0) };
                let weight = robust / (sigmas[k].powi(2) + model.scatter * model.scatter);
                normal += weight * row * row.transpose();
                right += weight * point.value * row;
            }
            model.covariance = normal.try_inverse()?;
            model.coefficients = model.covariance * right;
        }
        model.coefficients.iter().all(|c| c.is_finite()).then_some(model)
    }

    /// Starts with the line of the median slope between points half the stack apart, which single slices do not bend.
    fn start(&mut self, points: &[Point]) {
        let apart = points.len() / 2;
        let slopes = points.iter().zip(&points[apart..]).filter(|(a, b)| a.z != b.z);
        let slope = median_of(slopes.map(|(a, b)| (b.value - a.value) / (b.z - a.z) * self.half));
        self.coefficients = Vector3::new(0.0, slope, 0.0);
        self.coefficients[0] = median_of(points.iter().map(|p| p.value - self.at(p.z)));
    }

    fn row(&self, z: f64) -> Vector3<f64> {
        let x = (z - self.middle) / self.half;
        Vector3::new(1.0, x, x * x)
    }

    /// The value at `z`.
    pub(super) fn at(&self, z: f64) -> f64 {
        self.row(z).dot(&self.coefficients)
    }

    /// Standard deviation of a slice's value at `z` about the model: of the model itself and of the flicker.
    pub(super) fn sigma_at(&self, z: f64) -> f64 {
        let row = self.row(z);
        (row.dot(&(self.covariance * row)).max(0.0) + self.scatter * self.scatter).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(off: impl Fn(usize) -> f64) -> Vec<Point> {
        let at = |i: usize| 0.02 * i as f64 - 0.0004 * (i * i) as f64;
        (0..11).map(|i| Point { z: i as f64, value: at(i) + off(i), sigma: 1e-3 }).collect()
    }

    #[test]
    fn one_of_six_slices_does_not_bend_the_model_even_near_its_end() {
        let at = |i: usize| Point { z: i as f64, value: if i == 4 { 0.26 } else { 0.0 }, sigma: 1e-3 };
        let model = GainModel::fit(&(0..6).map(at).collect::<Vec<_>>(), 0.02, None).expect("points");
        assert!((0..6).all(|i| model.at(f64::from(i)).abs() < 1e-3) && model.scatter < 1e-3, "{model:?}");
    }

    #[test]
    fn one_slice_does_not_bend_the_model() {
        let clean = GainModel::fit(&points(|_| 0.0), 0.02, None).expect("points");
        let bent = GainModel::fit(&points(|i| if i == 8 { -0.5 } else { 0.0 }), 0.02, None).expect("points");
        for i in 0..11 {
            let z = i as f64;
            assert!((clean.at(z) - bent.at(z)).abs() < 1e-3, "{i}: {} for {}", bent.at(z), clean.at(z));
        }
        assert!(bent.scatter < 1e-3, "{}", bent.scatter);
    }

    #[test]
    fn flicker_of_every_slice_is_scatter_and_not_curvature() {
        let model = GainModel::fit(&points(|i| if i % 2 == 0 { 0.01 } else { -0.01 }), 0.02, None).expect("points");
        assert!((0.006..0.02).contains(&model.scatter), "{}", model.scatter);
        assert!(model.sigma_at(5.0) > 0.006);
        assert!(GainModel::fit(&points(|_| 0.0)[..2], 0.02, None).is_none());
    }
}
