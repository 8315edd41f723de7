//! The last step: the homography of least weighted geometric error, and how sure it is.
//!
//! Levenberg-Marquardt on the distances in the reference slice, each divided by its standard deviation,
//! with Huber weights (Hartley & Zisserman, Multiple View Geometry, sections 4.5 and 5.2).

use nalgebra::{Matrix3, SMatrix, SVector};

use super::dlt::{self, Pair};
use crate::model::Homography;

/// A refined homography.
#[derive(Debug, Clone)]
pub struct Refined {
    /// Slice px -> reference-slice px.
    pub homography: Homography,
    /// Standard deviation of the worst corner of the picture, px.
    pub corner_sigma: f64,
}

type Vector8 = SVector<f64, 8>;
type Matrix8 = SMatrix<f64, 8, 8>;

/// Residuals beyond this many standard deviations count less and less.
const HUBER: f64 = 1.5;

/// Refines `start` on `pairs`; `sigmas` are the standard deviations of their distances, px. `None` when the
/// equations are singular.
pub fn refine(start: &Homography, pairs: &[Pair], sigmas: &[f64], width: u32, height: u32) -> Option<Refined> {
    let from = dlt::normalisation(pairs.iter().map(|p| p.0))?;
    let to = dlt::normalisation(pairs.iter().map(|p| p.1))?;
    let (back, unit) = (to.try_inverse()?, to[(0, 0)]);
    let scaled = to * start.matrix() * from.try_inverse()?;
    let mut h = parameters(&(scaled / scaled[(2, 2)]));
    let points: Vec<([f64; 2], [f64; 2], f64)> = pairs
        .iter()
        .zip(sigmas)
        .map(|((p, q), s)| (move_by(&from, *p), move_by(&to, *q), unit * s.max(1e-6)))
        .collect();
    let mut damping = 1e-4;
    let mut cost = cost_of(&h, &points);
    for _ in 0..30 {
        let (normal, right, _) = equations(&h, &points);
        let mut damped = normal;
        for k in 0..8 {
            damped[(k, k)] *= 1.0 + damping;
        }
        let step = damped.cholesky()?.solve(&right);
        let next = h + step;
        let next_cost = cost_of(&next, &points);
        if next_cost <= cost {
            let gain = cost - next_cost;
            h = next;
            cost = next_cost;
            damping = (damping * 0.2).max(1e-12);
            if gain <= 1e-10 * cost || step.norm() < 1e-13 {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e8 {
                break;
            }
        }
    }
    let (normal, _, chi_square) = equations(&h, &points);
    let freedom = (2.0 * pairs.len() as f64 - 8.0).max(1.0);
    // scatter beyond what the dots claim widens the claim; scatter below it does not narrow it
    let covariance = normal.try_inverse()? * (chi_square / freedom).max(1.0);
    let homography = Homography::from_matrix(&(back * matrix(&h) * from))?;
    let corner_sigma = Homography::corners(width, height)
        .into_iter()
        .map(|corner| {
            let slopes = jacobian(&h, move_by(&from, corner));
            let spread = |j: &Vector8| (j.transpose() * covariance * j)[(0, 0)];
            (spread(&slopes.0) + spread(&slopes.1)).max(0.0).sqrt() / unit
        })
        .fold(0.0, f64::max);
    corner_sigma.is_finite().then_some(Refined { homography, corner_sigma })
}

fn parameters(m: &Matrix3<f64>) -> Vector8 {
    Vector8::from_fn(|k, _| m[(k / 3, k % 3)])
}

fn matrix(h: &Vector8) -> Matrix3<f64> {
    Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0)
}

fn move_by(t: &Matrix3<f64>, p: [f64; 2]) -> [f64; 2] {
    [t[(0, 0)] * p[0] + t[(0, 2)], t[(1, 1)] * p[1] + t[(1, 2)]]
}

fn send(h: &Vector8, [x, y]: [f64; 2]) -> [f64; 2] {
    let w = h[6] * x + h[7] * y + 1.0;
    [(h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w]
}

fn jacobian(h: &Vector8, p: [f64; 2]) -> (Vector8, Vector8) {
    let [x, y] = p;
    let w = h[6] * x + h[7] * y + 1.0;
    let [u, v] = send(h, p);
    (
        Vector8::from([x / w, y / w, 1.0 / w, 0.0, 0.0, 0.0, -u * x / w, -u * y / w]),
        Vector8::from([0.0, 0.0, 0.0, x / w, y / w, 1.0 / w, -v * x / w, -v * y / w]),
    )
}

fn cost_of(h: &Vector8, points: &[([f64; 2], [f64; 2], f64)]) -> f64 {
    let loss = |t: f64| if t <= HUBER { t * t } else { HUBER * (2.0 * t - HUBER) };
    let sum: f64 = points
        .iter()
        .map(|(p, q, sigma)| {
            let sent = send(h, *p);
            loss((sent[0] - q[0]).hypot(sent[1] - q[1]) / sigma)
        })
        .sum();
    if sum.is_finite() { sum } else { f64::MAX }
}

fn equations(h: &Vector8, points: &[([f64; 2], [f64; 2], f64)]) -> (Matrix8, Vector8, f64) {
    let (mut normal, mut right, mut chi_square) = (Matrix8::zeros(), Vector8::zeros(), 0.0);
    for (p, q, sigma) in points {
        let sent = send(h, *p);
        let (rx, ry) = ((q[0] - sent[0]) / sigma, (q[1] - sent[1]) / sigma);
        let size = rx.hypot(ry);
        let weight = if size <= HUBER { 1.0 } else { HUBER / size };
        let (jx, jy) = jacobian(h, *p);
        let (jx, jy) = (jx / *sigma, jy / *sigma);
        normal += weight * (jx * jx.transpose() + jy * jy.transpose());
        right += weight * (rx * jx + ry * jy);
        chi_square += weight * size * size;
    }
    (normal, right, chi_square)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(k: usize) -> f64 {
        let x = (k as f64 * 78.233).sin() * 43_758.547;
        let y = (k as f64 * 12.9898 + 4.1).sin() * 24_634.633;
        (-2.0 * (x - x.floor()).max(1e-12).ln()).sqrt() * (std::f64::consts::TAU * (y - y.floor())).cos()
    }

    #[test]
    fn the_error_of_the_corner_is_what_its_sigma_says() {
        let truth = Homography([0.96, 0.004, 10.0, -0.003, 0.961, 4.0, 2e-6, 1e-6, 1.0]);
        let (mut squares, mut claimed) = (0.0, 0.0);
        let trials = 60;
        for trial in 0..trials {
            let pairs: Vec<Pair> = (0..100)
                .map(|k| {
                    let p = [300.0 + 40.0 * f64::from(k % 10), 200.0 + 40.0 * f64::from(k / 10)];
                    let q = truth.apply(p);
                    let at = 2 * (trial * 100 + k as usize);
                    (p, [q[0] + 0.05 * noise(at), q[1] + 0.05 * noise(at + 1)])
                })
                .collect();
            let start = dlt::fit(&pairs).expect("a start");
            let refined = refine(&start, &pairs, &[0.05; 100], 1000, 800).expect("refined");
            squares += refined.homography.corner_distance(&truth, 1000, 800).powi(2);
            claimed += refined.corner_sigma;
        }
        let ratio = (squares / trials as f64).sqrt() / (claimed / trials as f64);
        // the largest of four corners, so a little more than one corner's sigma
        assert!((0.8..1.7).contains(&ratio), "{ratio}");
    }

    #[test]
    fn points_on_a_line_cannot_be_refined() {
        let line: Vec<Pair> = (0..20).map(|k| ([f64::from(k), 3.0], [f64::from(k), 3.0])).collect();
        let refined = refine(&Homography::IDENTITY, &line, &[0.1; 20], 100, 100);
        assert!(refined.is_none_or(|r| !r.corner_sigma.is_finite() || r.corner_sigma > 1.0));
    }
}
