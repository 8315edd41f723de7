//! The circle through the centres of projection of one ring of views. Centres in a plane lie on many spheres, but on
//! one circle.

use nalgebra::{Matrix3, Vector3};

use crate::photogrammetry::statistics::upper_median;

/// Circles through three centres that are tried as a start.
const STARTS: usize = 300;
/// Robust standard deviations beyond which a centre is rejected.
const SIGMAS: f64 = 5.0;
/// Median absolute deviation of a normal distribution, times this, is its standard deviation.
const MAD_TO_SIGMA: f64 = 1.4826;
/// Rounds of rejecting outliers and fitting again.
const ROUNDS: usize = 10;

/// A circle and the distances of the centres from it, in the unit of the centres.
#[derive(Debug, Clone, PartialEq)]
pub struct CircleFit {
    /// Centre of the circle.
    pub centre: [f64; 3],
    /// Its axis, a unit vector of arbitrary sign.
    pub axis: [f64; 3],
    /// Radius of the circle.
    pub radius: f64,
    /// Distance from the axis less the radius, of every centre, in the order of the input.
    pub residuals: Vec<f64>,
    /// Whether the centre lies within five robust standard deviations of the circle, in the order of the input.
    pub used: Vec<bool>,
}

/// A circle in space.
#[derive(Debug, Clone, Copy)]
struct Circle {
    centre: Vector3<f64>,
    axis: Vector3<f64>,
    radius: f64,
}

impl Circle {
    /// The circle through three points; `None` if they are on a line.
    fn through(a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>) -> Option<Self> {
        let (u, v) = (b - a, c - a);
        let across = u.cross(&v);
        let square = across.norm_squared();
        if square <= 1e-12 * u.norm_squared() * v.norm_squared() || square == 0.0 {
            return None;
        }
        let to_centre = (u.norm_squared() * v.cross(&across) + v.norm_squared() * across.cross(&u)) / (2.0 * square);
        Some(Self { centre: a + to_centre, axis: across / square.sqrt(), radius: to_centre.norm() })
    }

    /// Distance from the axis less the radius, and distance from the plane.
    fn apart(&self, point: &Vector3<f64>) -> (f64, f64) {
        let from = point - self.centre;
        let height = from.dot(&self.axis);
        ((from - height * self.axis).norm() - self.radius, height)
    }

    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let (radial, height) = self.apart(point);
        radial.hypot(height)
    }

    /// The plane of least squared distances through the points, and the circle of least squared distances in it.
    fn fitted(points: &[Vector3<f64>]) -> Option<Self> {
        let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        let scatter: Matrix3<f64> = points.iter().map(|point| (point - mean) * (point - mean).transpose()).sum();
        let eigen = scatter.symmetric_eigen();
        let axis: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let first: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        let second = axis.cross(&first);
        let flat: Vec<[f64; 2]> =
            points.iter().map(|point| [(point - mean).dot(&first), (point - mean).dot(&second)]).collect();
        // in the plane: 2 C . c + k = |C|^2 as a start, then the distances themselves
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for [x, y] in &flat {
            let row = Vector3::new(2.0 * x, 2.0 * y, 1.0);
            normal += row * row.transpose();
            right += row * (x * x + y * y);
        }
        let start = normal.lu().solve(&right)?;
        let mut circle = Vector3::new(start.x, start.y, (start.z + start.x * start.x + start.y * start.y).sqrt());
        for _ in 0..50 {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for [x, y] in &flat {
                let (dx, dy) = (x - circle.x, y - circle.y);
                let length = dx.hypot(dy).max(1e-300);
                let row = Vector3::new(-dx / length, -dy / length, -1.0);
                normal += row * row.transpose();
                right -= (length - circle.z) * row;
            }
            let Some(step) = normal.cholesky().map(|factor| factor.solve(&right)) else { break };
            circle += step;
            if step.norm() <= 1e-14 * circle.norm() {
                break;
            }
        }
        let is_finite = circle.iter().chain(axis.iter()).all(|value| value.is_finite());
        (is_finite && circle.z > 0.0).then(|| Self {
            centre: mean + circle.x * first + circle.y * second,
            axis,
            radius: circle.z,
        })
    }
}

/// Fits a circle to camera centres; at most a minority may be outliers. `None` for fewer than three centres, or centres
/// on a line.
pub fn fit_circle(centres: &[[f64; 3]]) -> Option<CircleFit> {
    let is_finite = centres.iter().flatten().all(|value| value.is_finite() && value.abs() < 1e100);
    if centres.len() < 3 || !is_finite {
        return None;
    }
    let points: Vec<Vector3<f64>> = centres.iter().map(|centre| Vector3::from(*centre)).collect();
    let median_distance = |circle: &Circle| upper_median(points.iter().map(|point| circle.distance(point)).collect());
    let mut circle = samples(&points)
        .filter_map(|[a, b, c]| Circle::through(a, b, c))
        .map(|circle| (median_distance(&circle), circle))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, circle)| circle)?;
    let within = |circle: &Circle| -> Vec<bool> {
        let limit = SIGMAS * (MAD_TO_SIGMA * median_distance(circle)).max(1e-12 * circle.radius);
        points.iter().map(|point| circle.distance(point) <= limit).collect()
    };
    let mut used = within(&circle);
    for _ in 0..ROUNDS {
        let kept: Vec<_> = points.iter().zip(&used).filter(|(_, used)| **used).map(|(point, _)| *point).collect();
        if kept.len() < 3 {
            break;
        }
        circle = Circle::fitted(&kept)?;
        let next = within(&circle);
        if next == used {
            break;
        }
        used = next;
    }
    Some(CircleFit {
        centre: circle.centre.into(),
        axis: circle.axis.into(),
        radius: circle.radius,
        residuals: points.iter().map(|point| circle.apart(point).0).collect(),
        used,
    })
}

/// Triples of points from a fixed sequence.
fn samples(points: &[Vector3<f64>]) -> impl Iterator<Item = [Vector3<f64>; 3]> + '_ {
    let mut state = 1_u64;
    let mut draw = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        points[(state >> 33) as usize % points.len()]
    };
    let first = match points {
        [a, b, c] => Some([*a, *b, *c]),
        _ => None,
    };
    first.into_iter().chain((0..STARTS).map(move |_| [draw(), draw(), draw()]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilted_ring_is_found_among_outliers() {
        let turn = nalgebra::Rotation3::from_euler_angles(0.7, -0.2, 1.0);
        let mut centres: Vec<[f64; 3]> = (0..24)
            .map(|i| {
                let angle = f64::from(i) * 15_f64.to_radians();
                let noise = 0.01 * f64::from(i % 3 - 1);
                let point = Vector3::new((50.0 + noise) * angle.cos(), (50.0 + noise) * angle.sin(), noise);
                (turn * point + Vector3::new(5.0, 6.0, 7.0)).into()
            })
            .collect();
        centres[4] = [400.0, 1.0, 2.0];
        centres[11] = [5.0, 6.0, 7.0];
        let fit = fit_circle(&centres).unwrap();
        assert!((fit.radius - 50.0).abs() < 0.01, "{}", fit.radius);
        let axis = turn * Vector3::z();
        assert!(Vector3::from(fit.axis).cross(&axis).norm() < 1e-3);
        assert_eq!((fit.used[4], fit.used[11], fit.used[0]), (false, false, true));
        assert!(fit.residuals.iter().zip(&fit.used).all(|(r, used)| !used || r.abs() < 0.03));
    }

    #[test]
    fn what_is_on_no_circle_is_refused() {
        assert_eq!(fit_circle(&[[0.0; 3]; 2]), None);
        assert_eq!(fit_circle(&[[1.0; 3]; 6]), None);
        let line: Vec<[f64; 3]> = (0..6).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        assert_eq!(fit_circle(&line), None);
        assert_eq!(fit_circle(&[[f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), None);
    }
}
