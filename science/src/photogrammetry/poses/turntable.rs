//! Pan and tilt of views from where their cameras are, and their deviation from what the turntable was commanded to.
//!
//! In: for each view a unit vector from the centre of the turntable to the camera (or against its optical axis), and
//! the commanded angles. Out: the axis of the turntable, measured angles, residuals, and steps between neighbours.
//!
//! A rotation that fits all commanded directions is the start (Wahba's problem, with weights that bound the pull of
//! outliers). The axis then follows from the rings of equal commanded tilt alone: it is the direction in which the
//! vectors of a ring differ least from their mean. So a constant error of tilt does not turn it. A table that turns the
//! other way than the convention says is tried as well; the better of the two is reported.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::photogrammetry::statistics::median;

/// Rounds of weighting.
const ROUNDS: usize = 20;
/// Robust standard deviations of the residual angle beyond which a view counts less, or is an outlier.
const SIGMAS: f64 = 5.0;
/// Median of the length of a two-dimensional normal residual over its standard deviation.
const MEDIAN_RAYLEIGH: f64 = 1.1774;
/// Residual angle below which no view is an outlier, degrees: rounding of the file.
const LEAST_OUTLIER_DEG: f64 = 0.001;
/// Least views of a ring that has a say in the axis, and the smallest share of the circle that it covers.
const RING_VIEWS: usize = 3;
const RING_SPREAD: f64 = 0.05;
/// Tilt beyond which pan is not measured, degrees.
const POLE_DEG: f64 = 80.0;
/// Angles are equal when they agree to this, degrees.
const SAME_DEG: f64 = 0.01;

/// A view: where its camera is, and what was commanded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Unit vector from the centre of the turntable towards the camera.
    pub vector: [f64; 3],
    /// Commanded pan and tilt, degrees.
    pub commanded_deg: [f64; 2],
}

/// What was measured of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredAngles {
    /// Pan, degrees, from 0 to 360; its zero is that of the commanded pan. `None` near the pole.
    pub pan_deg: Option<f64>,
    /// Tilt, degrees; its zero is that of the commanded tilt.
    pub tilt_deg: f64,
    /// Measured less commanded pan, after one offset per ring; `None` near the pole.
    pub pan_residual_deg: Option<f64>,
    /// Measured less commanded tilt, after one offset for all views.
    pub tilt_residual_deg: f64,
    /// The residual is so large that the view counts for nothing.
    pub is_outlier: bool,
}

/// The angles of all views.
#[derive(Debug, Clone, PartialEq)]
pub struct Turntable {
    /// Axis of the turntable, upwards, in the world of the vectors.
    pub axis: [f64; 3],
    /// Pan grows clockwise, seen from above: against the convention.
    pub is_clockwise: bool,
    /// The views, in the order of the input.
    pub views: Vec<MeasuredAngles>,
    /// Steps of pan between neighbours within a ring.
    pub pan_steps: Option<Steps>,
    /// Steps of tilt between neighbours of equal pan.
    pub tilt_steps: Option<Steps>,
}

/// Differences between neighbouring views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// The commanded step, degrees: the most frequent one.
    pub commanded_deg: f64,
    /// Mean of the measured steps, degrees.
    pub mean_deg: f64,
    /// Standard deviation of the measured steps (n - 1), degrees; 0 for one step.
    pub std_deg: f64,
    /// Number of steps.
    pub count: usize,
}

/// Angle in 0.01 degrees, for comparison; pan is taken modulo 360 degrees.
fn key(degrees: f64) -> i64 {
    (degrees / SAME_DEG).round() as i64
}

fn pan_key(degrees: f64) -> i64 {
    key(degrees).rem_euclid(key(360.0))
}

/// Measures pan and tilt. `None` for fewer than three views, or directions that do not determine an axis.
pub fn measure(views: &[Direction]) -> Option<Turntable> {
    let either = [false, true].map(|is_clockwise| Fit::of(views, is_clockwise));
    let fit = either.into_iter().flatten().min_by(|a, b| a.spread_deg.total_cmp(&b.spread_deg))?;
    Some(fit.turntable(views))
}

/// A commanded direction, with pan in the sense that is tried.
fn commanded(view: &Direction, is_clockwise: bool) -> Vector3<f64> {
    let [pan, tilt] = view.commanded_deg.map(f64::to_radians);
    let pan = if is_clockwise { -pan } else { pan };
    Vector3::new(tilt.cos() * pan.cos(), tilt.cos() * pan.sin(), tilt.sin())
}

/// The world of the vectors, seen from the turntable.
struct Fit {
    is_clockwise: bool,
    /// From the world of the vectors to the turntable.
    rotation: Rotation3<f64>,
    /// Median residual angle, degrees.
    spread_deg: f64,
}

impl Fit {
    fn of(views: &[Direction], is_clockwise: bool) -> Option<Self> {
        if views.len() < 3 {
            return None;
        }
        let pairs: Vec<(Vector3<f64>, Vector3<f64>)> =
            views.iter().map(|view| (Vector3::from(view.vector), commanded(view, is_clockwise))).collect();
        let mut weights = vec![1.0; pairs.len()];
        let mut rotation = Rotation3::identity();
        let mut spread_deg = f64::INFINITY;
        for _ in 0..ROUNDS {
            rotation = wahba(&pairs, &weights)?;
            let angles: Vec<f64> = pairs.iter().map(|(from, to)| (rotation * from).angle(to).to_degrees()).collect();
            spread_deg = median(angles.clone());
            // Cauchy's weights: a far outlier has no pull
            let scale = (spread_deg / MEDIAN_RAYLEIGH).max(LEAST_OUTLIER_DEG);
            weights = angles.iter().map(|angle| 1.0 / (1.0 + (angle / (2.0 * scale)).powi(2))).collect();
        }
        let axis = ring_axis(views, &weights).map_or(rotation.inverse() * Vector3::z(), |axis| {
            let up = rotation.inverse() * Vector3::z();
            if axis.dot(&up) < 0.0 { -axis } else { axis }
        });
        // the smallest turn that brings the axis upright keeps the zero of pan
        let upright = Rotation3::rotation_between(&(rotation * axis), &Vector3::z())?;
        Some(Self { is_clockwise, rotation: upright * rotation, spread_deg })
    }

    fn turntable(&self, views: &[Direction]) -> Turntable {
        let sign = if self.is_clockwise { -1.0 } else { 1.0 };
        let raw: Vec<[f64; 2]> = views
            .iter()
            .map(|view| {
                let place = self.rotation * Vector3::from(view.vector);
                [sign * place.y.atan2(place.x).to_degrees(), place.z.clamp(-1.0, 1.0).asin().to_degrees()]
            })
            .collect();
        let has_pan: Vec<bool> = views.iter().map(|view| view.commanded_deg[1].abs() < POLE_DEG).collect();
        let differences: Vec<[f64; 2]> = views
            .iter()
            .zip(&raw)
            .map(|(view, [pan, tilt])| [wrapped(pan - view.commanded_deg[0]), tilt - view.commanded_deg[1]])
            .collect();
        let tilt_offset = median(differences.iter().map(|difference| difference[1]).collect());
        let mut rings: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
        for (at, view) in views.iter().enumerate() {
            rings.entry(key(view.commanded_deg[1])).or_default().push(at);
        }
        let mut pan_offsets = vec![0.0; views.len()];
        for ring in rings.values() {
            let offset = circular_median(ring.iter().map(|at| differences[*at][0]).collect());
            ring.iter().for_each(|at| pan_offsets[*at] = offset);
        }
        let residual = |at: usize| {
            let [pan, tilt] = differences[at];
            (wrapped(pan - pan_offsets[at]), tilt - tilt_offset)
        };
        let sizes: Vec<f64> = (0..views.len())
            .map(|at| {
                let (pan, tilt) = residual(at);
                let across = if has_pan[at] { pan * views[at].commanded_deg[1].to_radians().cos() } else { 0.0 };
                across.hypot(tilt)
            })
            .collect();
        let limit = (SIGMAS * median(sizes.clone()) / MEDIAN_RAYLEIGH).max(LEAST_OUTLIER_DEG);
        let measured: Vec<MeasuredAngles> = (0..views.len())
            .map(|at| {
                let (pan_residual, tilt_residual) = residual(at);
                let [pan, tilt] = views[at].commanded_deg;
                MeasuredAngles {
                    pan_deg: has_pan[at].then(|| (pan + pan_residual).rem_euclid(360.0)),
                    tilt_deg: tilt + tilt_residual,
                    pan_residual_deg: has_pan[at].then_some(pan_residual),
                    tilt_residual_deg: tilt_residual,
                    is_outlier: sizes[at] > limit,
                }
            })
            .collect();
        let good: Vec<usize> = (0..views.len()).filter(|at| !measured[*at].is_outlier).collect();
        Turntable {
            axis: (self.rotation.inverse() * Vector3::z()).into(),
            is_clockwise: self.is_clockwise,
            pan_steps: pan_steps(views, &measured, &good),
            tilt_steps: tilt_steps(views, &measured, &good),
            views: measured,
        }
    }
}

/// The rotation of least weighted squared distances from the first to the second vectors.
fn wahba(pairs: &[(Vector3<f64>, Vector3<f64>)], weights: &[f64]) -> Option<Rotation3<f64>> {
    let together: Matrix3<f64> =
        pairs.iter().zip(weights).map(|((from, to), weight)| *weight * to * from.transpose()).sum();
    let svd = together.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut values: Vec<f64> = svd.singular_values.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    // vectors along one line leave the turn about it open
    if values[1] <= 1e-9 * values[2] {
        return None;
    }
    let handed = (u * v_t).determinant();
    let order = svd.singular_values.imin();
    let mut flip = Matrix3::identity();
    flip[(order, order)] = handed.signum();
    Some(Rotation3::from_matrix_unchecked(u * flip * v_t))
}

/// The axis about which all rings turn; `None` when no ring has enough views.
fn ring_axis(views: &[Direction], weights: &[f64]) -> Option<Vector3<f64>> {
    let mut rings: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    for (at, view) in views.iter().enumerate() {
        // what counts for little is left out: a ring has few views, and an outlier would turn its plane
        if weights[at] > 0.1 {
            rings.entry(key(view.commanded_deg[1])).or_default().push(at);
        }
    }
    let mut scatter = Matrix3::zeros();
    for ring in rings.values().filter(|ring| ring.len() >= RING_VIEWS) {
        let mean = ring.iter().map(|at| Vector3::from(views[*at].vector)).sum::<Vector3<f64>>() / ring.len() as f64;
        for at in ring {
            let apart = Vector3::from(views[*at].vector) - mean;
            scatter += weights[*at] * apart * apart.transpose();
        }
    }
    let eigen = scatter.symmetric_eigen();
    let mut values: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    values.sort_by(f64::total_cmp);
    // a short arc is almost a line
    if values[1] <= RING_SPREAD * RING_SPREAD * values[2] || values[2] <= 0.0 {
        return None;
    }
    Some(eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned())
}

/// Steps of pan between commanded neighbours of a ring, around the circle.
fn pan_steps(views: &[Direction], measured: &[MeasuredAngles], good: &[usize]) -> Option<Steps> {
    let mut rings: BTreeMap<i64, BTreeMap<i64, usize>> = BTreeMap::new();
    for &at in good.iter().filter(|at| measured[**at].pan_deg.is_some()) {
        let [pan, tilt] = views[at].commanded_deg;
        rings.entry(key(tilt)).or_default().entry(pan_key(pan)).or_insert(at);
    }
    let mut found = Vec::new();
    for ring in rings.values().filter(|ring| ring.len() > 1) {
        let around = ring.iter().zip(ring.iter().cycle().skip(1)).take(ring.len());
        for ((pan, from), (next, to)) in around {
            let commanded = (next - pan).rem_euclid(key(360.0));
            // two views on opposite sides are neighbours in both directions
            let turned = measured[*to].pan_residual_deg.zip(measured[*from].pan_residual_deg);
            if let Some((to, from)) = turned.filter(|_| commanded > 0) {
                found.push((commanded, commanded as f64 * SAME_DEG + to - from));
            }
        }
    }
    steps(found)
}

/// Steps of tilt between views of equal commanded pan in neighbouring rings.
fn tilt_steps(views: &[Direction], measured: &[MeasuredAngles], good: &[usize]) -> Option<Steps> {
    let mut columns: BTreeMap<i64, BTreeMap<i64, usize>> = BTreeMap::new();
    for &at in good {
        let [pan, tilt] = views[at].commanded_deg;
        columns.entry(pan_key(pan)).or_default().entry(key(tilt)).or_insert(at);
    }
    let mut found = Vec::new();
    for column in columns.values() {
        for ((tilt, from), (next, to)) in column.iter().zip(column.iter().skip(1)) {
            found.push((next - tilt, measured[*to].tilt_deg - measured[*from].tilt_deg));
        }
    }
    steps(found)
}

/// Mean and standard deviation of the steps whose commanded step is the most frequent one: across a missing view the
/// commanded step is larger.
fn steps(found: Vec<(i64, f64)>) -> Option<Steps> {
    let mut counts: BTreeMap<i64, usize> = BTreeMap::new();
    found.iter().for_each(|(commanded, _)| *counts.entry(*commanded).or_default() += 1);
    let (usual, _) = counts.iter().max_by_key(|(step, count)| (**count, -**step))?;
    let steps: Vec<f64> = found.iter().filter(|(commanded, _)| commanded == usual).map(|(_, step)| *step).collect();
    let count = steps.len();
    let mean_deg = steps.iter().sum::<f64>() / count as f64;
    let square: f64 = steps.iter().map(|step| (step - mean_deg).powi(2)).sum();
    let std_deg = if count > 1 { (square / (count - 1) as f64).sqrt() } else { 0.0 };
    Some(Steps { commanded_deg: *usual as f64 * SAME_DEG, mean_deg, std_deg, count })
}

/// An angle from -180 to 180 degrees.
fn wrapped(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

/// The median of angles about their mean direction.
fn circular_median(angles: Vec<f64>) -> f64 {
    let sum = |of: fn(f64) -> f64| angles.iter().map(|angle| of(angle.to_radians())).sum::<f64>();
    let mean = sum(f64::sin).atan2(sum(f64::cos)).to_degrees();
    wrapped(mean + median(angles.iter().map(|angle| wrapped(angle - mean)).collect()))
}
