//! Whether the focal length of a reconstruction is right, which its poses do not show.
//!
//! In: the focal length, and the principal distance of the camera. Out: both compared, a finding where they differ, and
//! a sentence where nothing checks the focal length.

use super::types::FocalLengthReport;
use crate::{
    photogrammetry::poses::PoseOptions,
    types::{Warning, WarningCode},
};

/// Relative difference that is always allowed: a bundle adjustment of a whole scan finds the focal length to 0.6 %.
const LEAST: f64 = 0.02;
/// Relative difference up to which two focal lengths are the same number.
const SAME: f64 = 1e-5;

const POSES: &str = "the poses do not check the focal length: with a wrong one, a bundle adjustment puts the cameras at \
     another distance, they fit a sphere and steps nearly as well, and a known radius or pair of views takes the error up";

/// The comparison, if both numbers are known, with a finding where they differ.
pub(super) fn compared(options: &PoseOptions, findings: &mut Vec<Warning>) -> Option<FocalLengthReport> {
    let (found, camera) = options.focal_length.zip(options.principal_distance)?;
    let difference = found.px / camera.px - 1.0;
    let limit = LEAST.max(3.0 * found.relative_sigma().hypot(camera.relative_sigma()));
    if difference.abs() > limit {
        let detail = format!(
            "the focal length of the reconstruction is {:.1} px and the principal distance of the camera {:.1} px: {:+.1} %, \
             and {:.1} % is the most that their uncertainties allow; let the program refine the focal length, and if it \
             stays the same, check the calibration",
            found.px,
            camera.px,
            100.0 * difference,
            100.0 * limit
        );
        findings.push(Warning::new(WarningCode::FocalLengthDisagrees, detail));
    }
    Some(FocalLengthReport {
        reconstruction_px: found.px,
        reconstruction_sigma_px: found.sigma_px,
        camera_px: camera.px,
        camera_sigma_px: camera.sigma_px,
        difference_percent: 100.0 * difference,
    })
}

/// Why nothing checks the focal length; `None` where the comparison does.
pub(super) fn not_checked(options: &PoseOptions) -> Option<String> {
    let known = "or compare a known length of the object with the reconstruction";
    let why = match (options.focal_length, options.principal_distance) {
        (Some(found), Some(camera)) if (found.px / camera.px - 1.0).abs() < SAME => format!(
            "that of the reconstruction is the principal distance of the camera, which the program did not change; let it \
             refine the focal length, {known}"
        ),
        (Some(_), Some(camera)) if camera.relative_sigma() > LEAST => format!(
            "the principal distance of the camera is known to {:.0} % only; measure it with a moved target, {known}",
            100.0 * camera.relative_sigma()
        ),
        (Some(_), Some(_)) => return None,
        (None, Some(camera)) => format!(
            "give the focal length that the program found (focal_px), to compare it with the principal distance of the \
             camera, {:.1} px, {known}",
            camera.px
        ),
        (_, None) => format!(
            "the principal distance of the camera is not known here; compare the focal length that the program found with \
             that of the calibration, {known}"
        ),
    };
    Some(format!("{POSES}; {why}"))
}
