//! The scale of a reconstruction, which has none of its own: from a known radius or a known distance of two views. A
//! known length of the object checks it.

use nalgebra::Vector3;

use super::{
    focal_length::LEAST,
    surface::{Surface, common_tilt},
    types::{KnownLengthReport, LengthUnit, ScaleReport, ScaleSource, SurfaceKind, SurfaceReport},
};
use crate::{
    photogrammetry::poses::{KnownScale, Pose, PoseOptions, view_key},
    types::{Error, ErrorKind, Warning, WarningCode},
};

/// Smallest radius of a ring over that of the sphere. On a smaller ring, an error of the tilt of 0.1 degrees changes
/// the scale by 9 %.
const LEAST_RING: f64 = 0.02;

/// The unit of all lengths of the report.
///
/// # Errors
/// [`ErrorKind::InvalidParameter`] when a view that is to give the scale is not registered, or both are at one place.
pub(super) fn scale(
    poses: &[&Pose],
    options: &PoseOptions,
    surface: Option<&Surface>,
    commanded: &[Option<[f64; 2]>],
    findings: &mut Vec<Warning>,
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
                SurfaceKind::Circle => common_tilt(commanded).map_or(1.0, |tilt| tilt.to_radians().cos().abs()),
            };
            if ring < LEAST_RING {
                findings.push(Warning::new(
                    WarningCode::NoScale,
                    "all views are at a tilt of about 90 degrees, where a ring is too small to give the scale by \
                     radius_mm; give pair_from, pair_to and pair_mm, or add a ring of views at another tilt",
                ));
                return Ok(of_radius(ScaleSource::None));
            }
            let per_file_unit = mm * ring / surface.radius;
            Ok(ScaleReport { unit: LengthUnit::Mm, source: ScaleSource::KnownRadius, per_file_unit })
        }
        (Some(KnownScale::Pair { from, to, mm }), _) => {
            let place = |name: &str, parameter: &str| {
                let key = view_key(name);
                let found = poses.iter().find(|pose| view_key(&pose.name) == key);
                found.map(|pose| Vector3::from(pose.centre)).ok_or_else(|| {
                    let detail = format!(
                        "the view '{name}' is not registered, so it cannot give the scale; name two views that the \
                         file has"
                    );
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

/// A known length of the object against that of the reconstruction, with a finding where they differ by more than 2 %
/// and three standard deviations of the radius.
///
/// With a focal length `k` times too long the cameras are `k` times too far from the object, and the known radius, or
/// distance of two views, scales the object by `1 / k`.
pub(super) fn known_length(
    options: &PoseOptions,
    scale: ScaleReport,
    surface: Option<&SurfaceReport>,
    findings: &mut Vec<Warning>,
) -> Result<Option<KnownLengthReport>, Error> {
    let Some(([from, to], known_mm)) = options.known_length else { return Ok(None) };
    if scale.unit != LengthUnit::Mm {
        let detail = "a known length is compared with a scale: give radius_mm, or pair_from, pair_to and pair_mm";
        return Err(refused("length_mm", detail.to_owned()));
    }
    let reconstruction_mm = (Vector3::from(to) - Vector3::from(from)).norm() * scale.per_file_unit;
    let difference_percent = 100.0 * (reconstruction_mm / known_mm - 1.0);
    let limit = surface.map_or(0.0, |surface| 3.0 * surface.std_percent).max(100.0 * LEAST);
    if difference_percent.abs() > limit {
        let wrong = if difference_percent < 0.0 { "long" } else { "short" };
        let detail = format!(
            "the known length is {known_mm:.3} mm on the object and {reconstruction_mm:.3} mm in the reconstruction: \
             {difference_percent:+.1} %, and {limit:.1} % is allowed; the focal length of the reconstruction is too {wrong} by \
             about as much, or the known radius or distance of views is wrong"
        );
        findings.push(Warning::new(WarningCode::KnownLengthDisagrees, detail));
    }
    Ok(Some(KnownLengthReport { known_mm, reconstruction_mm, difference_percent }))
}

fn refused(parameter: &str, detail: String) -> Error {
    Error::new(ErrorKind::InvalidParameter, detail).in_field(parameter, None)
}
