//! The rail-linear model: one fit of `x_i = x + dz_i (a x + e)` for the whole stack, with three parameters (a, e_x,
//! e_y).
//!
//! When the rail positions are exact, this is the best estimate: every dot of every slice contributes.

use nalgebra::{Matrix3, Vector3};

use super::statistics::median;
use super::transform_models::{Match, Parameters};

/// The three parameters with their covariance, in units (see [`super::transform_models`]).
#[derive(Debug, Clone)]
pub(super) struct RailFit {
    growth: f64,
    drift: [f64; 2],
    covariance: Matrix3<f64>,
}

/// Huber limit, in standard deviations: larger residuals get less weight.
const HUBER: f64 = 1.5;

impl RailFit {
    /// Iteratively reweighted least squares over all dots. `matches` per slice; `offsets`: rail positions relative to
    /// the reference slice.
    pub(super) fn fit(matches: &[impl AsRef<[Match]>], offsets: &[f64]) -> Option<Self> {
        let mut found = Vector3::zeros();
        let mut scatter = f64::INFINITY;
        let mut covariance = Matrix3::identity();
        for _ in 0..8 {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            let (mut square, mut sizes) = (0.0, Vec::new());
            for (dots, dz) in matches.iter().zip(offsets) {
                for m in dots.as_ref() {
                    let rows = [0, 1].map(|a| {
                        let mut row = Vector3::new(m.base[a], 0.0, 0.0);
                        row[1 + a] = 1.0;
                        row * (*dz / m.sigma)
                    });
                    let r = [0, 1].map(|a| (m.here[a] - m.base[a]) / m.sigma - rows[a].dot(&found));
                    let far = r[0].hypot(r[1]);
                    let limit = HUBER * scatter;
                    let weight = if far <= limit { 1.0 } else { limit / far };
                    for a in 0..2 {
                        normal += weight * rows[a] * rows[a].transpose();
                        right += weight * r[a] * rows[a];
                    }
                    square += weight * far * far;
                    sizes.push(far);
                }
            }
            let inverse = normal.try_inverse()?;
            found += inverse * right;
            let freedom = (2.0 * sizes.len() as f64 - 3.0).max(1.0);
            covariance = inverse * (square / freedom);
            scatter = (median(&mut sizes) / 1.18).max(0.3);
        }
        found.iter().all(|v| v.is_finite()).then(|| Self { growth: found[0], drift: [found[1], found[2]], covariance })
    }

    /// Parameters of the transform of a slice at `dz` from the reference slice.
    pub(super) fn parameters(&self, dz: f64) -> Parameters {
        [self.growth * dz, 0.0, self.drift[0] * dz, 0.0, self.growth * dz, self.drift[1] * dz, 0.0, 0.0]
    }

    /// Standard deviation of an image corner (one unit from the centre) of such a slice, units.
    pub(super) fn corner_sigma(&self, dz: f64) -> f64 {
        let c = &self.covariance;
        dz.abs() * (c[(0, 0)] + c[(1, 1)] + c[(2, 2)] + 2.0 * c[(0, 1)].abs().max(c[(0, 2)].abs())).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::super::testkit::Noise;
    use super::*;

    #[test]
    fn the_fit_to_all_dots_recovers_the_three_parameters() {
        let mut noise = Noise(5);
        let offsets: Vec<f64> = (-4..=4).map(f64::from).collect();
        let matches: Vec<Vec<Match>> = offsets
            .iter()
            .map(|dz| {
                (0..60)
                    .map(|k| {
                        let base = [f64::from(k % 10) / 6.0 - 0.75, f64::from(k / 10) / 6.0 - 0.4];
                        let gross = if k == 7 { 0.05 } else { 0.0 };
                        let here = [base[0] + dz * (0.01 * base[0] + 0.001), base[1] + dz * (0.01 * base[1] - 0.002)];
                        Match { base, here: here.map(|v| v + gross + 1e-4 * noise.normal()), sigma: 1e-4 }
                    })
                    .collect()
            })
            .collect();
        let fit = RailFit::fit(&matches, &offsets).expect("a law");
        let p = fit.parameters(2.0);
        assert!((p[0] - 0.02).abs() < 1e-5 && (p[2] - 0.002).abs() < 2e-5 && (p[5] + 0.004).abs() < 2e-5, "{p:?}");
        assert!((1e-6..1e-4).contains(&fit.corner_sigma(2.0)), "{}", fit.corner_sigma(2.0));
    }
}
