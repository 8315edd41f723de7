//! The report on the poses of a scan: the quantities of table I of Li and Nguyen (2019), and the residual of each view.

use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{
    Commanded, KnownScale, Pose, PoseFile, PoseFormat, PoseOptions,
    circle::fit_circle,
    sphere::{SphereFitError, fit_sphere},
    turntable::{Direction, MeasuredAngles, Steps, Turntable, measure},
    view_key, without_extension,
};
use crate::types::{
    Error, Warning,
    error::{ErrorKind, ErrorLocation},
    view::ViewAngles,
};

/// Names that a finding lists.
const LISTED: usize = 5;

/// How well the poses of a scan fit a turntable.
///
/// All lengths are in `scale.unit`. Standard deviations have `n - 1` in the denominator unless they say otherwise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PoseReport {
    /// Format of the file.
    pub format: PoseFormat,
    /// Number of registered views.
    pub registered: u32,
    /// Number of views that should be registered; null when it is unknown.
    pub expected: Option<u32>,
    /// Views that should be registered and are not.
    pub not_registered: Vec<String>,
    /// Registered views that the scan does not have.
    pub unknown: Vec<String>,
    /// Names that occur more than once; the first of each counts.
    pub duplicates: Vec<String>,
    /// The unit of all lengths, and where it comes from.
    pub scale: ScaleReport,
    /// The sphere through the centres of projection, or the circle if they are in one plane; null when there is none.
    pub surface: Option<SurfaceReport>,
    /// Axis of the turntable in the world of the file, upwards, a unit vector; null when it is unknown.
    pub axis: Option<[f64; 3]>,
    /// Pan grows clockwise, seen from above; null when it is unknown.
    pub pan_is_clockwise: Option<bool>,
    /// Steps of pan between neighbouring views, from the centres of projection.
    pub pan_steps: Option<StepReport>,
    /// Steps of tilt between neighbouring views, from the centres of projection.
    pub tilt_steps: Option<StepReport>,
    /// Steps of pan from the optical axes, which do not depend on the sphere.
    pub pan_steps_of_axes: Option<StepReport>,
    /// Steps of tilt from the optical axes.
    pub tilt_steps_of_axes: Option<StepReport>,
    /// The registered views.
    pub views: Vec<ViewPose>,
    /// What to consider.
    pub findings: Vec<Warning>,
}

/// The unit of lengths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LengthUnit {
    /// Millimetres.
    Mm,
    /// Shares of the fitted radius: a reconstruction has no scale of its own.
    Radius,
}

/// Where the scale comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ScaleSource {
    /// Nothing: lengths are shares of the radius.
    None,
    /// The known distance from the centre of the turntable to the camera. The reported radius is therefore that
    /// distance, and says nothing about the poses.
    KnownRadius,
    /// The known distance of two views.
    ViewPair,
}

/// The scale of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScaleReport {
    /// Unit of all lengths of the report.
    pub unit: LengthUnit,
    /// Where it comes from.
    pub source: ScaleSource,
    /// Units of the report per unit of the file.
    pub per_file_unit: f64,
}

/// A surface on which the centres of projection lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceKind {
    /// A sphere.
    Sphere,
    /// A circle: all centres are in one plane.
    Circle,
}

/// The fitted sphere or circle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SurfaceReport {
    /// Sphere or circle.
    pub kind: SurfaceKind,
    /// Its centre, in the world and the unit of the file.
    pub centre: [f64; 3],
    /// Its radius.
    pub radius: f64,
    /// Mean distance of the centres of projection from its centre (of a circle: from its axis).
    pub mean_radius: f64,
    /// Standard deviation of that distance.
    pub std: f64,
    /// The same with `n` in the denominator, as the paper computes it.
    pub std_population: f64,
    /// The same as `std`, in percent of the radius.
    pub std_percent: f64,
    /// Root of the mean squared residual.
    pub rms: f64,
    /// Largest residual of a view that was used.
    pub max: f64,
    /// Views that were used.
    pub used: u32,
    /// Views that were rejected: their residual exceeds five robust standard deviations.
    pub rejected: u32,
}

/// Steps of the turntable between commanded neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StepReport {
    /// Commanded step, degrees.
    pub commanded_deg: f64,
    /// Mean measured step, degrees.
    pub mean_deg: f64,
    /// Standard deviation of the measured steps, degrees: `sqrt 2` times that of the angle of one view.
    pub std_deg: f64,
    /// Number of steps.
    pub count: u32,
}

impl From<Steps> for StepReport {
    fn from(Steps { commanded_deg, mean_deg, std_deg, count }: Steps) -> Self {
        Self { commanded_deg, mean_deg, std_deg, count: u32::try_from(count).unwrap_or(u32::MAX) }
    }
}

/// A registered view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewPose {
    /// Its name in the file.
    pub name: String,
    /// Commanded pan, degrees.
    pub commanded_pan_deg: Option<f64>,
    /// Commanded tilt, degrees.
    pub commanded_tilt_deg: Option<f64>,
    /// Measured pan, degrees, with the zero of the commanded pan; null within 10 degrees of the pole.
    pub pan_deg: Option<f64>,
    /// Measured tilt, degrees, with the zero of the commanded tilt.
    pub tilt_deg: Option<f64>,
    /// Distance from the centre less the radius.
    pub radial_residual: Option<f64>,
    /// Measured less commanded pan, after one offset per ring of equal tilt, degrees.
    pub pan_residual_deg: Option<f64>,
    /// Measured less commanded tilt, after one offset for all views, degrees.
    pub tilt_residual_deg: Option<f64>,
    /// The residual of both angles as a length on the surface.
    pub tangential_residual: Option<f64>,
    /// The view does not fit the others, and counts neither for the surface nor for the steps it fails.
    pub is_outlier: bool,
}

/// Measures the poses of a file.
///
/// # Errors
/// [`ErrorKind::InvalidParameter`] when a view that is to give the scale is not registered.
pub fn report(file: &PoseFile, options: &PoseOptions) -> Result<PoseReport, Error> {
    let Views { poses, commanded, not_registered, unknown, duplicates } = Views::of(file, options);
    let mut findings = Vec::new();
    let surface = Surface::of(&poses, &mut findings);
    let angles = surface.as_ref().and_then(|surface| surface.angles(&poses, &commanded));
    let axes = of_axes(&poses, &commanded);
    let scale = scale(&poses, options, surface.as_ref(), &commanded)?;
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
        surface: surface.as_ref().map(|surface| surface.report(scale.per_file_unit)),
        axis: sense.map(|(axis, _)| axis),
        pan_is_clockwise: sense.map(|(_, is_clockwise)| is_clockwise),
        pan_steps: steps(turntable.and_then(|turntable| turntable.pan_steps)),
        tilt_steps: steps(turntable.and_then(|turntable| turntable.tilt_steps)),
        pan_steps_of_axes: steps(axes.as_ref().and_then(|turntable| turntable.pan_steps)),
        tilt_steps_of_axes: steps(axes.as_ref().and_then(|turntable| turntable.tilt_steps)),
        views,
        findings,
    };
    let more = findings_of(&report, turntable.is_some());
    report.findings.extend(more);
    Ok(report)
}

/// The views of a file beside those that were expected.
struct Views<'a> {
    poses: Vec<&'a Pose>,
    commanded: Vec<Option<[f64; 2]>>,
    not_registered: Vec<String>,
    unknown: Vec<String>,
    duplicates: Vec<String>,
}

impl<'a> Views<'a> {
    fn of(file: &'a PoseFile, options: &PoseOptions) -> Self {
        let listed: HashMap<String, &Commanded> =
            options.commanded.iter().map(|view| (view_key(&view.name), view)).collect();
        let mut seen = HashSet::new();
        let (mut poses, mut commanded) = (Vec::new(), Vec::new());
        let (mut unknown, mut duplicates) = (Vec::new(), Vec::new());
        for pose in &file.poses {
            let key = view_key(&pose.name);
            let expected = listed.get(&key);
            if !seen.insert(key) {
                duplicates.push(pose.name.clone());
                continue;
            }
            if expected.is_none() && !listed.is_empty() {
                unknown.push(pose.name.clone());
            }
            poses.push(pose);
            commanded.push(match expected {
                Some(expected) => expected.angles_deg,
                None if listed.is_empty() => pose.commanded_deg.or_else(|| angles_of(&pose.name)),
                // a view of another scan has angles of another scan
                None => None,
            });
        }
        let not_registered = match options.commanded.as_slice() {
            [] => file.unregistered.clone(),
            views => {
                views.iter().map(|view| &view.name).filter(|name| !seen.contains(&view_key(name))).cloned().collect()
            }
        };
        Self { poses, commanded, not_registered, unknown, duplicates }
    }
}

/// The angles that a name contains, with or without its folders.
fn angles_of(name: &str) -> Option<[f64; 2]> {
    let whole = without_extension(name);
    let last = whole.rsplit(['/', '\\']).next().unwrap_or(whole);
    let ViewAngles { pan_deg, tilt_deg } = ViewAngles::of_name(last).or_else(|| ViewAngles::of_name(whole))?;
    Some([pan_deg, tilt_deg])
}

/// A fitted sphere or circle, in the unit of the file.
struct Surface {
    kind: SurfaceKind,
    centre: [f64; 3],
    radius: f64,
    residuals: Vec<f64>,
    used: Vec<bool>,
}

impl Surface {
    fn of(poses: &[&Pose], findings: &mut Vec<Warning>) -> Option<Self> {
        let centres: Vec<[f64; 3]> = poses.iter().map(|pose| pose.centre).collect();
        let refused = match fit_sphere(&centres) {
            Ok(fit) => {
                let (centre, radius) = (fit.centre, fit.radius);
                return Some(Self {
                    kind: SurfaceKind::Sphere,
                    centre,
                    radius,
                    residuals: fit.residuals,
                    used: fit.used,
                });
            }
            Err(refused) => refused,
        };
        let fit = match refused {
            SphereFitError::Coplanar | SphereFitError::TooFew(_) => fit_circle(&centres),
            SphereFitError::NotFinite(_) => None,
        };
        let Some(fit) = fit else {
            findings.push(Warning::new("no_surface", refused.to_string()));
            return None;
        };
        findings.push(Warning::new(
            "one_ring",
            "all cameras are in one plane: a circle is fitted instead of a sphere, and tilt cannot be measured; add a ring \
             of views at another tilt",
        ));
        let (centre, radius) = (fit.centre, fit.radius);
        Some(Self { kind: SurfaceKind::Circle, centre, radius, residuals: fit.residuals, used: fit.used })
    }

    /// Pan and tilt of the views whose commanded angles are known, and their indices.
    fn angles(&self, poses: &[&Pose], commanded: &[Option<[f64; 2]>]) -> Option<(Vec<usize>, Turntable)> {
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

    fn report(&self, unit: f64) -> SurfaceReport {
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

/// The axis, upwards, and whether pan grows clockwise around it. From centres in one plane alone, a table that turns
/// one way cannot be told from one that turns the other way upside down: then the cameras tell, whose images are
/// upright. `None` without rotations.
fn sense(turntable: &Turntable, poses: &[&Pose], tells_up: bool) -> Option<([f64; 3], bool)> {
    let Turntable { axis, is_clockwise, .. } = *turntable;
    if tells_up {
        return Some((axis, is_clockwise));
    }
    let downs = poses.iter().filter_map(|pose| pose.rotation).map(|[_, down, _]| Vector3::from(down));
    let along = downs.sum::<Vector3<f64>>().dot(&Vector3::from(axis));
    if along > 0.0 {
        return Some((axis.map(|value| -value), !is_clockwise));
    }
    (along < 0.0).then_some((axis, is_clockwise))
}

/// Steps from the optical axes: a camera on a turntable looks at its centre.
fn of_axes(poses: &[&Pose], commanded: &[Option<[f64; 2]>]) -> Option<Turntable> {
    let directions: Vec<Direction> = poses
        .iter()
        .zip(commanded)
        .filter_map(|(pose, angles)| {
            let [_, _, forward] = pose.rotation?;
            Some(Direction { vector: forward.map(|value| -value), commanded_deg: (*angles)? })
        })
        .collect();
    measure(&directions)
}

fn scale(
    poses: &[&Pose],
    options: &PoseOptions,
    surface: Option<&Surface>,
    commanded: &[Option<[f64; 2]>],
) -> Result<ScaleReport, Error> {
    let of_radius = |source: ScaleSource| {
        let per_file_unit = surface.map_or(1.0, |surface| 1.0 / surface.radius);
        ScaleReport { unit: LengthUnit::Radius, source, per_file_unit }
    };
    match (&options.scale, surface) {
        (None, _) | (Some(KnownScale::Radius { .. }), None) => Ok(of_radius(ScaleSource::None)),
        (Some(KnownScale::Radius { mm }), Some(surface)) => {
            // a ring at a tilt is smaller than the sphere
            let ring = match surface.kind {
                SurfaceKind::Sphere => 1.0,
                SurfaceKind::Circle => common_tilt(commanded).map_or(1.0, |tilt| tilt.to_radians().cos()),
            };
            let per_file_unit = mm * ring / surface.radius;
            Ok(ScaleReport { unit: LengthUnit::Mm, source: ScaleSource::KnownRadius, per_file_unit })
        }
        (Some(KnownScale::Pair { from, to, mm }), _) => {
            let place = |name: &str, parameter: &str| {
                let key = view_key(name);
                let found = poses.iter().find(|pose| view_key(&pose.name) == key);
                found.map(|pose| Vector3::from(pose.centre)).ok_or_else(|| {
                    let detail = format!("the view '{name}' is not registered, so it cannot give the scale");
                    refused(parameter, detail)
                })
            };
            let apart = (place(from, "pair_from")? - place(to, "pair_to")?).norm();
            if apart <= 0.0 {
                return Err(refused("pair_to", format!("the views '{from}' and '{to}' are at the same place")));
            }
            Ok(ScaleReport { unit: LengthUnit::Mm, source: ScaleSource::ViewPair, per_file_unit: mm / apart })
        }
    }
}

fn refused(parameter: &str, detail: String) -> Error {
    let place =
        ErrorLocation { detail: detail.clone(), pointer: Some(parameter.to_owned()), ..ErrorLocation::default() };
    Error::new(ErrorKind::InvalidParameter, detail).at(place)
}

/// The tilt that all views with angles have, degrees.
fn common_tilt(commanded: &[Option<[f64; 2]>]) -> Option<f64> {
    let mut tilts = commanded.iter().flatten().map(|[_, tilt]| *tilt);
    let first = tilts.next()?;
    tilts.all(|tilt| (tilt - first).abs() < 0.01).then_some(first)
}

fn view_poses(
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

fn findings_of(report: &PoseReport, has_steps: bool) -> Vec<Warning> {
    let mut findings = Vec::new();
    let mut names = |code: &str, names: &[String], what: &str| {
        if !names.is_empty() {
            findings.push(Warning::new(code, format!("{} {what}: {}", names.len(), listed(names))));
        }
    };
    names("not_registered", &report.not_registered, "views are not registered");
    names("unknown_views", &report.unknown, "registered views are not views of this scan");
    names("duplicate_views", &report.duplicates, "names occur more than once; the first of each counts");
    let outliers: Vec<String> =
        report.views.iter().filter(|view| view.is_outlier).map(|view| view.name.clone()).collect();
    names("outliers", &outliers, "views do not fit the others");
    let with_angles = report.views.iter().filter(|view| view.commanded_pan_deg.is_some()).count();
    if with_angles == 0 {
        findings.push(Warning::new(
            "no_angles",
            "the commanded angles are unknown, so steps of pan and tilt are not measured; name the views as in \
             pan020_tilt06, or give a CSV file the columns pan_deg and tilt_deg",
        ));
    } else if !has_steps {
        findings.push(Warning::new("no_axis", "too few views have angles, or all on one line: the axis is unknown"));
    } else if report.pan_is_clockwise.is_none() {
        findings.push(Warning::new(
            "no_sense",
            "the centres of one level ring look the same from above and from below, and the file has no rotations: which way \
             pan grows is unknown",
        ));
    }
    if report.pan_is_clockwise == Some(true) {
        findings.push(Warning::new(
            "clockwise",
            "pan grows clockwise, seen from above, against the convention: set pan_direction of the scan to clockwise, so \
             that bundles place the cameras as they were",
        ));
    }
    findings
}

fn listed(names: &[String]) -> String {
    let shown: Vec<&str> = names.iter().take(LISTED).map(String::as_str).collect();
    match names.len().checked_sub(LISTED) {
        None | Some(0) => shown.join(", "),
        Some(more) => format!("{} and {more} more", shown.join(", ")),
    }
}
