//! Whether the focal length of a reconstruction is right, which its poses do not show.
//!
//! In: the focal length, and the principal distance of the camera. Out: both compared, a finding where they differ, and
//! a sentence where nothing checks the focal length. A principal distance whose uncertainty is unknown checks nothing.

use super::types::FocalLengthReport;
use crate::{
    photogrammetry::poses::{Distance, PoseFile, PoseOptions},
    types::{Warning, WarningCode},
};

/// Relative difference that is always allowed: a bundle adjustment of a whole scan finds the focal length to 0.6 %.
pub(super) const LEAST: f64 = 0.02;
/// Relative difference up to which two focal lengths are the same number.
const SAME: f64 = 1e-5;

const POSES: &str = "the poses do not check the focal length: with a wrong one, a bundle adjustment puts the cameras at \
     another distance, they fit a sphere and steps nearly as well, and a known radius or pair of views takes the error up";

/// The focal length of the reconstruction: as it was given, or the median over the views of the file, with a finding
/// where these differ.
pub(super) fn of_reconstruction(
    file: &PoseFile,
    options: &PoseOptions,
    findings: &mut Vec<Warning>,
) -> Option<Distance> {
    if options.focal_length.is_some() {
        return options.focal_length;
    }
    let mut all = file.focal_px.clone();
    all.sort_by(f64::total_cmp);
    let (least, px, most) = (*all.first()?, all[all.len() / 2], *all.last()?);
    if most / least - 1.0 > SAME {
        let detail = format!(
            "the cameras of the file have focal lengths of {least:.1} to {most:.1} px, of which the median over the views, \
             {px:.1} px, is compared; a scan has one camera: let the program refine one for all images"
        );
        findings.push(Warning::new(WarningCode::SeveralCameras, detail));
    }
    Some(Distance { px, sigma_px: None })
}

/// The comparison, if both are known, with a finding where they differ.
pub(super) fn compared(
    found: Option<Distance>,
    camera: Option<Distance>,
    findings: &mut Vec<Warning>,
) -> Option<FocalLengthReport> {
    let (found, camera) = found.zip(camera)?;
    let difference = found.px / camera.px - 1.0;
    let sigma = |distance: Distance| distance.relative_sigma().unwrap_or_default();
    let limit = LEAST.max(3.0 * sigma(found).hypot(sigma(camera)));
    if difference.abs() > limit {
        let detail = format!(
            "the focal length of the reconstruction is {:.1} px and the principal distance of the camera {:.1} px: {:+.1} %, \
             and {:.1} % is allowed; let the program refine the focal length, and if it stays the same, check the \
             calibration",
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

/// Why the comparison does not check the focal length; `None` where it does.
pub(super) fn not_checked(found: Option<Distance>, camera: Option<Distance>) -> Option<String> {
    let known = "or compare a known length of the object (length_from, length_to, length_mm)";
    let why = match (found, camera) {
        (Some(found), Some(camera)) if (found.px / camera.px - 1.0).abs() < SAME => format!(
            "that of the reconstruction is the principal distance of the camera, which the program did not change; let it \
             refine the focal length, {known}"
        ),
        (Some(_), Some(camera)) => match camera.relative_sigma() {
            Some(sigma) if sigma <= LEAST => return None,
            Some(sigma) => format!(
                "the principal distance of the camera is known to {:.0} % only; measure it with a moved target, {known}",
                100.0 * sigma
            ),
            None => format!(
                "the uncertainty of the principal distance of the camera is unknown, so {:.0} % are allowed; measure it \
                 with a moved target, {known}",
                100.0 * LEAST
            ),
        },
        (None, Some(camera)) => format!(
            "give the focal length that the program found (focal_px; of COLMAP, send a zip of the folder of the model), to \
             compare it with the principal distance of the camera, {:.1} px, {known}",
            camera.px
        ),
        (_, None) => format!(
            "the principal distance of the camera is not known here; compare the focal length that the program found with \
             that of the calibration, {known}"
        ),
    };
    Some(format!("{POSES}; {why}"))
}
