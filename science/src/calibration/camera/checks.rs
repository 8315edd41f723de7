//! What contradicts the measured camera: specified numbers, each with the value that would agree.

use super::measured::{Known, Measured, PRINT, RATIO};
use crate::types::{WarningCode, calibration_options::CalibrationOptions, lens::PLAUSIBLE_PUPIL_RATIOS};

/// Relative difference from which a specified number contradicts a measurement, where the standard deviations are
/// smaller: numbers are rounded.
const ROUNDED: f64 = 0.03;

/// A specified number that contradicts what was measured.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::calibration) struct Contradiction {
    /// The code of the finding.
    pub code: WarningCode,
    /// The sentence of the finding.
    pub detail: String,
    /// Relative error of the principal distance, if that rests on the wrong one of two numbers.
    pub doubt: f64,
    /// The number implies a pupil ratio that no macro lens has.
    pub is_implausible: bool,
}

/// What to check, whichever number is contradicted.
const CHECK: &str = "check target_pitch_mm, pixel_pitch_mm and the rail steps too";

/// All contradictions.
pub(super) fn contradictions(options: &CalibrationOptions, known: Known, measured: &Measured) -> Vec<Contradiction> {
    [target_advance(options, known, measured), pupil_ratio(options, measured), focal_length(options, measured)]
        .into_iter()
        .flatten()
        .collect()
}

fn contradiction(code: WarningCode, detail: String) -> Contradiction {
    Contradiction { code, detail, doubt: 0.0, is_implausible: false }
}

/// The moved target against itself, and against a rail that measures the same distance.
fn target_advance(options: &CalibrationOptions, known: Known, measured: &Measured) -> Option<Contradiction> {
    let (advance, moved) = (options.target_advance_mm?, options.moved_target_pitch_px?);
    let Some(by_target) = measured.by_target else {
        let detail = format!(
            "target_advance_mm is {advance}, but the dots are {:.3} px apart and those of the moved target {moved:.3} px: a \
             target that is nearer must be clearly larger; check the sign and the size of the advance",
            known.pitch_px[0]
        );
        return Some(contradiction(WarningCode::TargetAdvanceDisagrees, detail));
    };
    let by_rail = measured.entrance?;
    let ratio = by_target.value / by_rail.value;
    let limit = ROUNDED.max(3.0 * by_target.sigma.hypot(by_rail.sigma));
    ((ratio - 1.0).abs() > limit).then(|| {
        let detail = format!(
            "target_advance_mm is {advance}, but by the rail {:.3} mm would agree: check it and the rail steps",
            advance / ratio
        );
        contradiction(WarningCode::TargetAdvanceDisagrees, detail)
    })
}

/// The specified pupil ratio against both pupils.
fn pupil_ratio(options: &CalibrationOptions, measured: &Measured) -> Option<Contradiction> {
    let (given, found) = (options.pupil_ratio?, measured.ratio()?);
    ((given / found.value - 1.0).abs() > ROUNDED.max(3.0 * found.sigma)).then(|| {
        let detail = format!(
            "pupil_ratio is {given}, but the measured pupils give {:.3}: correct it; {CHECK}, and target_advance_mm",
            found.value
        );
        contradiction(WarningCode::PupilRatioDisagrees, detail)
    })
}

/// The specified focal length against the lens that was measured, or else against all plausible lenses.
fn focal_length(options: &CalibrationOptions, measured: &Measured) -> Option<Contradiction> {
    let given = options.focal_mm?;
    let code = WarningCode::FocalLengthDisagrees;
    if let Some((ratio, ratio_sigma, whose)) = measured
        .ratio()
        .map(|ratio| (ratio.value, ratio.sigma, "the measured pupils give"))
        .or(options.pupil_ratio.map(|ratio| (ratio, RATIO, "with pupil_ratio as specified the rail gives")))
    {
        let lens = measured.lens(ratio)?;
        // how much of an error of the ratio goes into the focal length
        let step = 1e-4;
        let slope = (measured.lens(ratio * (1.0 + step))?.focal_mm / lens.focal_mm - 1.0) / step;
        let distance = measured.depth().or(measured.exit).or(measured.growth);
        let sigma = distance.map_or(0.0, |distance| distance.sigma).hypot(PRINT).hypot(slope * ratio_sigma);
        if (given / lens.focal_mm - 1.0).abs() <= ROUNDED.max(3.0 * sigma) {
            return None;
        }
        let other = measured.ratio_of(given).map(|ratio| (lens.pupil_ratio / ratio - 1.0).abs());
        let detail = format!(
            "focal_mm is {given}, but {whose} {:.2} mm: correct it (a lens that focuses internally is shorter at close \
             range than engraved); {CHECK}, and pupil_ratio",
            lens.focal_mm
        );
        return Some(Contradiction { doubt: other.unwrap_or(1.0).min(1.0), ..contradiction(code, detail) });
    }
    let implied = measured.ratio_of(given)?;
    let [low, high] = PLAUSIBLE_PUPIL_RATIOS;
    let [a, b] = [measured.lens(low)?.focal_mm, measured.lens(high)?.focal_mm];
    // near a magnification of 1 a lens that moves alone has the same growth with any ratio
    let spread = (a / b - 1.0).abs();
    if (low..=high).contains(&implied) || (spread < ROUNDED && (given / a - 1.0).abs() < ROUNDED) {
        return None;
    }
    let detail = format!(
        "focal_mm is {given}, which implies pupils that no macro lens has (ratio {}; usual are {low} to {high}); {:.1} to \
         {:.1} mm would agree with the rail: correct it; {CHECK}",
        if implied > 0.0 { format!("{implied:.2}") } else { "below 0".to_owned() },
        a.min(b),
        a.max(b)
    );
    Some(Contradiction { is_implausible: true, ..contradiction(code, detail) })
}
