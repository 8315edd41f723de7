//! How far each registered view is from the surface, and from its commanded angles.

use std::collections::HashMap;

use super::{
    surface::Surface,
    types::{SurfaceKind, ViewPose},
};
use crate::photogrammetry::poses::{
    Pose,
    turntable::{MeasuredAngles, Turntable},
};

/// The registered views with their residuals. `unit`: units of the report per unit of the file.
pub(super) fn view_poses(
    poses: &[&Pose],
    commanded: &[Option<[f64; 2]>],
    surface: Option<&Surface>,
    angles: Option<&(Vec<usize>, Turntable)>,
    unit: f64,
) -> Vec<ViewPose> {
    let measured: HashMap<usize, &MeasuredAngles> =
        angles.map(|(indices, turntable)| indices.iter().copied().zip(&turntable.views).collect()).unwrap_or_default();
    let is_sphere = surface.is_some_and(|surface| surface.kind == SurfaceKind::Sphere);
    let view = |(at, (pose, angles)): (usize, (&&Pose, &Option<[f64; 2]>))| {
        let measured = measured.get(&at);
        let tangential = measured.zip(surface).map(|(measured, surface)| {
            let tilt = measured.tilt_deg.to_radians();
            let across = measured.pan_residual_deg.unwrap_or(0.0).to_radians() * tilt.cos();
            let along = if is_sphere { measured.tilt_residual_deg.to_radians() } else { 0.0 };
            across.hypot(along) * surface.radius * unit
        });
        ViewPose {
            name: pose.name.clone(),
            commanded_pan_deg: angles.map(|[pan, _]| pan),
            commanded_tilt_deg: angles.map(|[_, tilt]| tilt),
            pan_deg: measured.and_then(|measured| measured.pan_deg),
            tilt_deg: measured.filter(|_| is_sphere).map(|measured| measured.tilt_deg),
            radial_residual: surface.and_then(|surface| surface.residuals.get(at)).map(|residual| residual * unit),
            pan_residual_deg: measured.and_then(|measured| measured.pan_residual_deg),
            tilt_residual_deg: measured.filter(|_| is_sphere).map(|measured| measured.tilt_residual_deg),
            tangential_residual: tangential,
            is_outlier: measured.is_some_and(|measured| measured.is_outlier)
                || surface.is_some_and(|surface| surface.used.get(at) == Some(&false)),
        }
    };
    poses.iter().zip(commanded).enumerate().map(view).collect()
}
