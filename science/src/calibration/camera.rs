//! The pinhole camera, as far as a calibration can determine it.
//!
//! The principal distance d2 (lens to sensor in the reference slice) follows in two independent ways: from the rail
//! law, `growth per mm = 1 / d2` with a fixed lens; and from `d2 = f (1 + M)`, with the magnification M from the target
//! pitch. The focal length that a camera writes into its files is neither.

use crate::types::{calibration_options::CalibrationOptions, profile::CaptureMode, report::CameraReport};

/// Measured quantities.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Known {
    /// Image size over target size.
    pub magnification: Option<f64>,
    /// Growth of the image per mm of rail.
    pub growth_per_mm: Option<f64>,
    /// The capture mode.
    pub capture: Option<CaptureMode>,
}

/// Largest relative difference at which the two principal distances agree.
const MAX_DIFFERENCE: f64 = 0.02;

/// The camera from the options and the measured quantities.
pub(super) fn camera(options: &CalibrationOptions, known: Known) -> CameraReport {
    let by_pitch = known.magnification.zip(options.focal_mm).map(|(m, f)| f * (1.0 + m));
    let moving = known.capture == Some(CaptureMode::MovingLens);
    let by_rail = known.growth_per_mm.filter(|g| !moving && g.abs() > 1e-9).map(|g| 1.0 / g.abs());
    let detail = match (by_rail, by_pitch) {
        (Some(rail), Some(pitch)) => {
            let off = 100.0 * (rail / pitch - 1.0);
            let word = if agree(rail, pitch) {
                "agree"
            } else {
                "disagree: check focal length, target pitch, pixel pitch and rail steps"
            };
            format!("from the rail law; focal length and target pitch give {pitch:.2} mm ({off:+.1} %): they {word}")
        }
        (Some(_), None) => {
            "from the rail law; give focal_mm, target_pitch_mm and pixel_pitch_mm for a cross-check".into()
        }
        (None, Some(_)) if moving => {
            "from focal length and target pitch; with a moving lens the rail cannot check it".into()
        }
        (None, Some(_)) => "from focal length and target pitch; give rail_step_mm for a cross-check".into(),
        (None, None) if moving => {
            "not known, because with a moving lens the rail does not tell it: give focal_mm with \
                                   target_pitch_mm and pixel_pitch_mm"
                .into()
        }
        (None, None) => "not known: give rail_step_mm (or rail_positions_mm), or focal_mm with target_pitch_mm and \
                         pixel_pitch_mm"
            .into(),
    };
    let distance = by_rail.or(by_pitch);
    CameraReport {
        principal_distance_mm: distance,
        principal_distance_px: distance.zip(options.pixel_pitch_mm).map(|(d, p)| d / p),
        cross_check_mm: by_rail.and(by_pitch),
        // the fixed point gives the principal point only together with the tilt of the rail, which is unknown
        principal_point_px: None,
        pixel_pitch_mm: options.pixel_pitch_mm,
        focal_mm: options.focal_mm,
        detail,
    }
}

/// True when the two principal distances of a report differ by more than [`MAX_DIFFERENCE`].
pub(super) fn is_contradictory(report: &CameraReport) -> bool {
    let both = report.principal_distance_mm.zip(report.cross_check_mm);
    both.is_some_and(|(rail, pitch)| !agree(rail, pitch))
}

/// True when two principal distances agree.
fn agree(rail: f64, pitch: f64) -> bool {
    (100.0 * (rail / pitch - 1.0)).abs() <= 100.0 * MAX_DIFFERENCE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_principal_distance_is_cross_checked() {
        let options =
            CalibrationOptions { focal_mm: Some(65.0), pixel_pitch_mm: Some(0.004), ..CalibrationOptions::default() };
        let known = Known { magnification: Some(1.0), growth_per_mm: Some(-1.0 / 131.0), capture: None };
        let report = camera(&options, known);
        assert!((report.principal_distance_mm.expect("known") - 131.0).abs() < 1e-9);
        assert_eq!(report.cross_check_mm, Some(130.0));
        assert!((report.principal_distance_px.expect("known") - 32_750.0).abs() < 1e-6);
        assert!(report.detail.contains("they agree"), "{}", report.detail);
        let off = camera(&options, Known { growth_per_mm: Some(1.0 / 150.0), ..known });
        assert!(off.detail.contains("they disagree"), "{}", off.detail);
        assert!(is_contradictory(&off) && !is_contradictory(&report));
    }

    #[test]
    fn unknown_values_stay_none() {
        let report = camera(&CalibrationOptions::default(), Known::default());
        assert_eq!((report.principal_distance_mm, report.principal_distance_px), (None, None));
        assert!(report.detail.contains("rail_step_mm"));
        let moving = Known { growth_per_mm: Some(0.01), capture: Some(CaptureMode::MovingLens), magnification: None };
        let report = camera(&CalibrationOptions::default(), moving);
        assert_eq!(report.principal_distance_mm, None);
        assert!(!report.detail.contains("rail_step_mm") && report.detail.contains("focal_mm"), "{}", report.detail);
        let options = CalibrationOptions { focal_mm: Some(65.0), ..CalibrationOptions::default() };
        let report = camera(&options, Known { magnification: Some(1.0), ..moving });
        assert!(!report.detail.contains("rail_step_mm"), "{}", report.detail);
    }
}
