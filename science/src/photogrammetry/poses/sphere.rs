//! The sphere through the centres of projection of a scan.
//!
//! In: centres of cameras, in any unit. Out: centre and radius of the sphere, and how far the centres lie from it. A
//! camera on an arm of constant length moves on a sphere, so the spread of the radius measures the poses without any
//! knowledge of the commanded angles. The fit minimises the geometric distance `r_i = |C_i - c| - R` with Huber's loss,
//! because a few wrong poses must not move the sphere. Huber's loss bounds the pull of an outlier, but does not end it;
//! the fit is therefore repeated without the centres that it rejects.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Vector3, Vector4};

use crate::photogrammetry::statistics::upper_median;

/// Standard deviations of the residual at which Huber's loss becomes linear.
const HUBER_SIGMAS: f64 = 3.0;
/// Standard deviations of the residual beyond which a centre is rejected. Of 10,000 normal residuals none is.
const REJECT_SIGMAS: f64 = 5.0;
/// Median absolute deviation of a normal distribution, times this, is its standard deviation.
const MAD_TO_SIGMA: f64 = 1.4826;
/// Centres whose spread across their plane is less than this share of their spread along it lie on one ring.
const MIN_FLATNESS: f64 = 0.01;
/// Samples of four centres that are tried as a start.
const STARTS: usize = 200;
const ITERATIONS: usize = 50;
/// Rounds of rejecting outliers and fitting again.
const REJECTIONS: usize = 10;

/// A sphere and the distances of the centres from it, in the unit of the centres.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereFit {
    /// Centre of the sphere.
    pub centre: [f64; 3],
    /// Radius of the sphere.
    pub radius: f64,
    /// `|C_i - c| - R` of every centre, in the order of the input.
    pub residuals: Vec<f64>,
    /// Whether the centre lies within five robust standard deviations of the sphere, in the order of the input.
    pub used: Vec<bool>,
}

/// Why no sphere can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SphereFitError {
    /// Fewer centres than unknowns.
    #[error("a sphere needs at least 4 camera centres, and there are {0}: register more views")]
    TooFew(usize),
    /// A coordinate is infinite or not a number.
    #[error("camera centre {0} (counted from 0) is not finite: export the poses again")]
    NotFinite(usize),
    /// All centres lie in a plane.
    #[error("the camera centres lie in one plane, which fits many spheres: add a ring of views at another tilt")]
    Coplanar,
}

/// Fits a sphere to camera centres; at most a minority may be outliers.
///
/// # Errors
/// Fewer than four centres, a coordinate that is not finite, or centres in one plane (one ring).
pub fn fit_sphere(centres: &[[f64; 3]]) -> Result<SphereFit, SphereFitError> {
    if centres.len() < 4 {
        return Err(SphereFitError::TooFew(centres.len()));
    }
    if let Some(at) = centres.iter().position(|centre| !centre.iter().all(|x| x.is_finite() && x.abs() < 1e100)) {
        return Err(SphereFitError::NotFinite(at));
    }
    let origin = component_median(centres);
    let shifted: Vec<Vector3<f64>> = centres.iter().map(|c| Vector3::from(*c) - origin).collect();
    let unit = upper_median(shifted.iter().map(Vector3::norm).collect());
    if unit <= 0.0 {
        return Err(SphereFitError::Coplanar);
    }
    let points: Vec<Vector3<f64>> = shifted.iter().map(|point| point / unit).collect();
    let start = start(&points).ok_or(SphereFitError::Coplanar)?;
    let mut sphere = refine(&points, start);
    let mut used = within_limit(&points, &sphere);
    for _ in 0..REJECTIONS {
        let kept: Vec<Vector3<f64>> = points.iter().zip(&used).filter(|(_, used)| **used).map(|(p, _)| *p).collect();
        if is_flat(&kept) {
            return Err(SphereFitError::Coplanar);
        }
        sphere = refine(&kept, sphere);
        let next = within_limit(&points, &sphere);
        if next == used {
            break;
        }
        used = next;
    }
    if !sphere.iter().all(|x| x.is_finite()) {
        return Err(SphereFitError::Coplanar);
    }
    let residuals = residuals(&points, &sphere);
    let centre = sphere.xyz() * unit + origin;
    Ok(SphereFit {
        centre: centre.into(),
        radius: sphere.w * unit,
        residuals: residuals.iter().map(|r| r * unit).collect(),
        used,
    })
}

/// The start with the smallest median distance: all centres together, or four of them from a fixed sequence.
fn start(points: &[Vector3<f64>]) -> Option<Vector4<f64>> {
    let mut state = 1_u64;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        points[(state >> 33) as usize % points.len()]
    };
    let samples: Vec<[Vector3<f64>; 4]> = (0..STARTS).map(|_| [draw(), draw(), draw(), draw()]).collect();
    let spheres = std::iter::once(algebraic(points)).chain(samples.iter().map(|sample| algebraic(sample)));
    spheres
        .flatten()
        .map(|sphere| (upper_median(residuals(points, &sphere).iter().map(|r| r.abs()).collect()), sphere))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, sphere)| sphere)
}

/// Coope's linear fit: `2 C . c + k = |C|^2` with `R^2 = k + |c|^2`.
fn algebraic(points: &[Vector3<f64>]) -> Option<Vector4<f64>> {
    let rows = DMatrix::from_fn(points.len(), 4, |i, j| if j < 3 { 2.0 * points[i][j] } else { 1.0 });
    let right = DVector::from_fn(points.len(), |i, _| points[i].norm_squared());
    let solution = rows.svd(true, true).solve(&right, 1e-9).ok()?;
    let centre = Vector3::new(solution[0], solution[1], solution[2]);
    let square = solution[3] + centre.norm_squared();
    (square.is_finite() && square > 0.0).then(|| centre.push(square.sqrt()))
}

/// Gauss and Newton's iteration with Huber's weights; stops when a step no longer changes the sphere.
fn refine(points: &[Vector3<f64>], start: Vector4<f64>) -> Vector4<f64> {
    let mut sphere = start;
    for _ in 0..ITERATIONS {
        let residuals = residuals(points, &sphere);
        let delta = HUBER_SIGMAS * scale(&residuals);
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for (point, residual) in points.iter().zip(&residuals) {
            let away = point - sphere.xyz();
            let row = (-away / away.norm().max(1e-12)).push(-1.0);
            let weight = if residual.abs() <= delta { 1.0 } else { delta / residual.abs() };
            normal += weight * row * row.transpose();
            right -= weight * *residual * row;
        }
        let Some(step) = normal.cholesky().map(|factor| factor.solve(&right)) else { break };
        sphere += step;
        if step.norm() < 1e-13 * sphere.norm() {
            break;
        }
    }
    sphere
}

fn within_limit(points: &[Vector3<f64>], sphere: &Vector4<f64>) -> Vec<bool> {
    let residuals = residuals(points, sphere);
    let limit = REJECT_SIGMAS * scale(&residuals);
    residuals.iter().map(|residual| residual.abs() <= limit).collect()
}

fn residuals(points: &[Vector3<f64>], sphere: &Vector4<f64>) -> Vec<f64> {
    points.iter().map(|point| (point - sphere.xyz()).norm() - sphere.w).collect()
}

/// Robust standard deviation of residuals, never quite zero, so that exact centres are kept.
fn scale(residuals: &[f64]) -> f64 {
    (MAD_TO_SIGMA * upper_median(residuals.iter().map(|r| r.abs()).collect())).max(1e-12)
}

fn is_flat(points: &[Vector3<f64>]) -> bool {
    let mean = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    let scatter: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    let spread = scatter.symmetric_eigenvalues();
    points.len() < 4 || spread.min() < MIN_FLATNESS * MIN_FLATNESS * spread.max()
}

fn component_median(centres: &[[f64; 3]]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| upper_median(centres.iter().map(|centre| centre[axis]).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::view::ViewAngles;

    /// Rings at the tilts given, 18 views each, radius 141, on uniform noise of standard deviation `sigma` per axis.
    fn rings(tilts: &[f64], sigma: f64) -> Vec<[f64; 3]> {
        let mut state = 7_u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12_f64.sqrt() * sigma
        };
        let views = tilts.iter().flat_map(|&tilt_deg| {
            (0..18).map(move |i| ViewAngles { pan_deg: 20.0 * f64::from(i), tilt_deg }.direction())
        });
        views.map(|direction| direction.map(|x| 141.0 * x + noise())).collect()
    }

    const TILTS: [f64; 5] = [0.0, 6.0, 12.0, 18.0, 24.0];

    #[test]
    fn the_spread_of_the_radius_is_the_noise_of_the_centres() {
        for sigma in [0.112, 0.266] {
            let fit = fit_sphere(&rings(&TILTS, sigma)).unwrap();
            let spread = (fit.residuals.iter().map(|r| r * r).sum::<f64>() / 86.0).sqrt();
            assert!((fit.radius - 141.0).abs() < 3.0 * sigma, "{}", fit.radius);
            assert!((spread / sigma - 1.0).abs() < 0.2, "{spread} for {sigma}");
        }
    }

    #[test]
    fn outliers_are_rejected_and_do_not_move_the_sphere() {
        let mut centres = rings(&TILTS, 0.01);
        for (i, at) in [3, 20, 41, 60, 77].into_iter().enumerate() {
            centres[at] = [900.0, -50.0 * i as f64, 700.0];
        }
        let fit = fit_sphere(&centres).unwrap();
        assert!((fit.radius - 141.0).abs() < 0.05 && fit.centre.iter().all(|x| x.abs() < 0.05), "{fit:?}");
        let inliers: Vec<[f64; 3]> = (0..90).filter(|at| fit.used[*at]).map(|at| centres[at]).collect();
        let alone = fit_sphere(&inliers).unwrap();
        assert!((fit.radius - alone.radius).abs() < 0.002, "outliers still pull: {} {}", fit.radius, alone.radius);
        assert!([3, 20, 41, 60, 77].iter().all(|&at| !fit.used[at]));
        assert!(fit.used.iter().filter(|used| **used).count() >= 83);
    }

    #[test]
    fn a_similarity_transform_changes_the_unit_alone() {
        let centres = rings(&TILTS, 0.112);
        let turn = nalgebra::Rotation3::from_euler_angles(0.4, -1.1, 2.0);
        let moved: Vec<[f64; 3]> =
            centres.iter().map(|c| (turn * Vector3::from(*c) * 0.003 + Vector3::new(12.0, -7.0, 3.0)).into()).collect();
        let (a, b) = (fit_sphere(&centres).unwrap(), fit_sphere(&moved).unwrap());
        assert!((a.radius * 0.003 / b.radius - 1.0).abs() < 1e-6, "{} {}", a.radius, b.radius);
        assert_eq!(a.used, b.used);
    }

    #[test]
    fn what_fits_many_spheres_is_refused() {
        assert_eq!(fit_sphere(&rings(&[12.0], 0.112)), Err(SphereFitError::Coplanar));
        assert_eq!(fit_sphere(&[[1.0; 3]; 6]), Err(SphereFitError::Coplanar));
        assert_eq!(fit_sphere(&[[0.0; 3]; 2]), Err(SphereFitError::TooFew(2)));
        let mut centres = rings(&TILTS, 0.0);
        centres[5][1] = f64::NAN;
        assert_eq!(fit_sphere(&centres), Err(SphereFitError::NotFinite(5)));
    }
}
