//! The sphere through the centres of projection, or the circle if they are in one plane.

use nalgebra::Vector3;

use super::types::{SurfaceKind, SurfaceReport};
use crate::{
    photogrammetry::poses::{
        Pose,
        circle::{CircleFit, fit_circle},
        sphere::{SphereFit, SphereFitError, fit_sphere},
        turntable::{Direction, Turntable, measure},
    },
    types::{Warning, WarningCode},
};

/// A fitted sphere or circle, in the unit of the file.
pub(super) struct Surface {
    pub kind: SurfaceKind,
    pub centre: [f64; 3],
    pub radius: f64,
    pub residuals: Vec<f64>,
    pub used: Vec<bool>,
}

impl Surface {
    pub(super) fn of(poses: &[&Pose], findings: &mut Vec<Warning>) -> Option<Self> {
        let centres: Vec<[f64; 3]> = poses.iter().map(|pose| pose.centre).collect();
        let refused = match fit_sphere(&centres) {
            Ok(SphereFit { centre, radius, residuals, used }) => {
                return Some(Self { kind: SurfaceKind::Sphere, centre, radius, residuals, used });
            }
            Err(refused) => refused,
        };
        let fit = match refused {
            SphereFitError::Coplanar | SphereFitError::TooFew(_) => fit_circle(&centres),
            SphereFitError::NotFinite(_) => None,
        };
        let Some(CircleFit { centre, radius, residuals, used, .. }) = fit else {
            let detail = match refused {
                SphereFitError::TooFew(0..=2) | SphereFitError::NotFinite(_) => refused.to_string(),
                SphereFitError::Coplanar | SphereFitError::TooFew(_) => {
                    "the camera centres lie on one line or at one point, so neither a sphere nor a circle can be \
                     fitted: register views from other directions"
                        .to_owned()
                }
            };
            findings.push(Warning::new(WarningCode::NoSurface, detail));
            return None;
        };
        let detail = match refused {
            SphereFitError::TooFew(n) => {
                format!(
                    "only {n} views are registered, so a circle is fitted instead of a sphere: register at least 4 \
                     views"
                )
            }
            SphereFitError::Coplanar | SphereFitError::NotFinite(_) => {
                "all cameras are in one plane: a circle is fitted instead of a sphere, and tilt cannot be measured; \
                 add a ring of views at another tilt"
                    .to_owned()
            }
        };
        findings.push(Warning::new(WarningCode::OneRing, detail));
        Some(Self { kind: SurfaceKind::Circle, centre, radius, residuals, used })
    }

    /// Pan and tilt of the views whose commanded angles are known, and their indices. `None` for a circle through views
    /// of several tilts: the directions from its centre are not those from the centre of the turntable.
    pub(super) fn angles(&self, poses: &[&Pose], commanded: &[Option<[f64; 2]>]) -> Option<(Vec<usize>, Turntable)> {
        if self.kind == SurfaceKind::Circle && !have_one_tilt(commanded) {
            return None;
        }
        let centre = Vector3::from(self.centre);
        let mut indices = Vec::new();
        let mut directions = Vec::new();
        for (at, (pose, angles)) in poses.iter().zip(commanded).enumerate() {
            let apart = Vector3::from(pose.centre) - centre;
            let length = apart.norm();
            if let Some([pan, tilt]) = angles.filter(|_| length > 1e-9 * self.radius) {
                // on a circle around the centre of that circle, there is no tilt
                let tilt = if self.kind == SurfaceKind::Circle { 0.0 } else { tilt };
                indices.push(at);
                directions.push(Direction { vector: (apart / length).into(), commanded_deg: [pan, tilt] });
            }
        }
        measure(&directions).map(|turntable| (indices, turntable))
    }

    pub(super) fn report(&self, unit: f64) -> SurfaceReport {
        let used: Vec<f64> = self
            .residuals
            .iter()
            .zip(&self.used)
            .filter(|(_, used)| **used)
            .map(|(residual, _)| residual * unit)
            .collect();
        let count = used.len().max(1) as f64;
        let mean = used.iter().sum::<f64>() / count;
        let squares: f64 = used.iter().map(|residual| (residual - mean).powi(2)).sum();
        let std = if used.len() > 1 { (squares / (count - 1.0)).sqrt() } else { 0.0 };
        let radius = self.radius * unit;
        let number = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        SurfaceReport {
            kind: self.kind,
            centre: self.centre,
            radius,
            mean_radius: radius + mean,
            std,
            std_population: (squares / count).sqrt(),
            std_percent: 100.0 * std / radius,
            rms: (used.iter().map(|residual| residual * residual).sum::<f64>() / count).sqrt(),
            max: used.iter().fold(0.0, |most, residual| most.max(residual.abs())),
            used: number(used.len()),
            rejected: number(self.residuals.len() - used.len()),
        }
    }
}

/// Whether all commanded tilts that are known are equal.
fn have_one_tilt(commanded: &[Option<[f64; 2]>]) -> bool {
    common_tilt(commanded).is_some() || commanded.iter().all(Option::is_none)
}

/// The tilt that all views with angles have, degrees.
pub(super) fn common_tilt(commanded: &[Option<[f64; 2]>]) -> Option<f64> {
    let mut tilts = commanded.iter().flatten().map(|[_, tilt]| *tilt);
    let first = tilts.next()?;
    tilts.all(|tilt| (tilt - first).abs() < 0.01).then_some(first)
}
