//! The report on the poses of a scan: the quantities of table I of Li and Nguyen (2019), and the residual of each view.

mod axis;
mod findings;
mod focal_length;
mod residuals;
mod scale;
mod surface;
mod types;
mod views;

use self::{
    axis::{of_axes, sense},
    findings::findings_of,
    focal_length::{compared, not_checked, of_reconstruction},
    residuals::view_poses,
    scale::{known_length, scale},
    surface::Surface,
    views::Views,
};
use super::{Commanded, PoseFile, PoseOptions, invalid, turntable::Steps};
use crate::types::Error;
#[cfg(doc)]
use crate::types::error::ErrorKind;

pub use self::types::{
    FocalLengthReport, KnownLengthReport, LengthUnit, PoseReport, ScaleReport, ScaleSource, StepReport, SurfaceKind,
    SurfaceReport, ViewPose,
};

#[cfg(test)]
mod tests;

/// Measures the poses of a file.
///
/// # Errors
/// [`ErrorKind::InvalidParameter`] when a view that is to give the scale is not registered, or a known length has no
/// scale to be compared with;
/// [`ErrorKind::InvalidPoses`] when no view of the file is among the views that should be registered.
///
/// # Example
/// ```
/// use pinstack_science::photogrammetry::poses::{PoseOptions, read, report};
///
/// let row = |pan: i32| {
///     let (y, x) = f64::from(pan).to_radians().sin_cos();
///     format!("pan{pan:03}_tilt00.png,{x},{y},0\n")
/// };
/// let csv: String = ["name,x,y,z\n".into()].into_iter().chain((0..360).step_by(20).map(row)).collect();
/// let report = report(&read(csv.as_bytes(), None)?, &PoseOptions::default())?;
/// assert!((report.pan_steps.expect("steps").mean_deg - 20.0).abs() < 1e-9);
/// # Ok::<(), pinstack_science::types::Error>(())
/// ```
pub fn report(file: &PoseFile, options: &PoseOptions) -> Result<PoseReport, Error> {
    let Views { poses, commanded, not_registered, unknown, duplicates } = Views::of(file, options);
    if !unknown.is_empty() && unknown.len() == poses.len() {
        return Err(of_another_scan(&unknown, &options.commanded));
    }
    let mut findings = Vec::new();
    let surface = Surface::of(&poses, &mut findings);
    let angles = surface.as_ref().and_then(|surface| surface.angles(&poses, &commanded));
    let axes = of_axes(&poses, &commanded);
    let scale = scale(&poses, options, surface.as_ref(), &commanded, &mut findings)?;
    let surface_report = surface.as_ref().map(|surface| surface.report(scale.per_file_unit));
    let known_length = known_length(options, scale, surface_report.as_ref(), &mut findings)?;
    let found = of_reconstruction(file, options, &mut findings);
    let focal_length = compared(found, options.principal_distance, &mut findings);
    let views = view_poses(&poses, &commanded, surface.as_ref(), angles.as_ref(), scale.per_file_unit);
    let steps = |steps: Option<Steps>| steps.map(StepReport::from);
    let turntable = angles.as_ref().map(|(_, turntable)| turntable);
    let sense = angles.as_ref().and_then(|(indices, turntable)| {
        let tilts = indices.iter().filter_map(|at| commanded[*at]).map(|[_, tilt]| tilt);
        let is_sphere = surface.as_ref().is_some_and(|surface| surface.kind == SurfaceKind::Sphere);
        let tells_up = is_sphere && tilts.into_iter().any(|tilt| tilt.abs() > 0.01);
        sense(turntable, &poses, tells_up)
    });
    let expected = options.expected.or_else(|| match options.commanded.len() {
        0 if file.unregistered.is_empty() => None,
        0 => u32::try_from(file.poses.len() + file.unregistered.len()).ok(),
        n => u32::try_from(n).ok(),
    });
    let mut report = PoseReport {
        format: file.format,
        registered: u32::try_from(poses.len() - unknown.len()).unwrap_or(u32::MAX),
        expected,
        not_registered,
        unknown,
        duplicates,
        scale,
        surface: surface_report,
        axis: sense.map(|(axis, _)| axis),
        pan_is_clockwise: sense.map(|(_, is_clockwise)| is_clockwise),
        pan_steps: steps(turntable.and_then(|turntable| turntable.pan_steps)),
        tilt_steps: steps(turntable.and_then(|turntable| turntable.tilt_steps)),
        pan_steps_of_axes: steps(axes.as_ref().and_then(|turntable| turntable.pan_steps)),
        tilt_steps_of_axes: steps(axes.as_ref().and_then(|turntable| turntable.tilt_steps)),
        views,
        findings,
        focal_length,
        known_length,
        not_checked: not_checked(found, options.principal_distance).filter(|_| known_length.is_none()),
    };
    let more = findings_of(&report, turntable.is_some());
    report.findings.extend(more);
    Ok(report)
}

/// The error for poses of which none is of a view of the scan.
fn of_another_scan(unknown: &[String], commanded: &[Commanded]) -> Error {
    let one = |name: Option<&str>| name.unwrap_or_default().to_owned();
    invalid(format!(
        "none of the {} views of the file is a view of this scan: the file has '{}', the scan has '{}'; send the poses of \
         this scan, name the images as the bundle does, or ask for a report without a scan",
        unknown.len(),
        one(unknown.first().map(String::as_str)),
        one(commanded.first().map(|view| view.name.as_str())),
    ))
}
