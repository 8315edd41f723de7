//! The profile that follows from a calibration.

use crate::contract::{profile::Profile, request::CalibrationRequest};
use pinstack_science::{calibration::Calibration, types::profile::ProfileInput};

/// The numbers of the profile: all of them measured, or those of the revision `from` with other homographies.
/// `orientation`: EXIF orientation of the slices.
pub(super) fn numbers(
    measured: &Calibration,
    from: Option<&Profile>,
    request: &CalibrationRequest,
    orientation: u8,
) -> ProfileInput {
    match from {
        Some(from) => refined(measured, request, &from.input),
        None => measured_profile(measured, request, orientation),
    }
}

/// A profile with other homographies than `from`.
fn refined(measured: &Calibration, request: &CalibrationRequest, from: &ProfileInput) -> ProfileInput {
    ProfileInput {
        homographies: measured.slices.iter().map(|slice| slice.homography).collect(),
        note: request.options.note.clone(),
        ..from.clone()
    }
}

fn measured_profile(measured: &Calibration, request: &CalibrationRequest, orientation: u8) -> ProfileInput {
    ProfileInput {
        image_width: measured.width,
        image_height: measured.height,
        reference_index: u32::try_from(measured.reference_index).unwrap_or(u32::MAX),
        homographies: measured.slices.iter().map(|slice| slice.homography).collect(),
        rail_positions_mm: measured.report.rail.as_ref().filter(|rail| rail.in_mm).map(|rail| rail.positions.clone()),
        gains: Some(measured.slices.iter().map(|slice| slice.gain).collect()),
        pixel_pitch_mm: request.options.pixel_pitch_mm,
        capture_mode: measured.capture_mode,
        note: request.options.note.clone(),
        principal_distance_mm: measured.report.camera.principal_distance_mm,
        principal_distance_source: Some(measured.report.camera.source),
        pupils: measured.report.camera.pupils,
        magnification: measured.magnification,
        distortion: measured.distortion,
        lateral_colour: measured.lateral_colour,
        orientation: Some(orientation),
        ..ProfileInput::default()
    }
}
