//! Diagnoses of a stack as a whole, made on its fused pictures: exchanged lights, a dot target sent as a stack.

use crate::contract::{Code, Fault, JobError, options::MaskMode};
use pinstack_science::{
    calibration,
    imaging::{Raster, thumbnail},
    segmentation,
    types::{Cancelled, Control, Warning, WarningCode},
};

/// Longer side of the reduced pictures that are examined, px. That of the back light is kept until the front light is
/// fused.
const SIDE: usize = 1_200;

/// Warnings that a mask made from the wrong light causes. They are removed when the lights are found to be exchanged.
const CAUSED_BY_EXCHANGED_LIGHTS: [WarningCode; 5] = [
    WarningCode::MaskTranslucent,
    WarningCode::MaskLowSeparability,
    WarningCode::MaskUnevenLight,
    WarningCode::MaskInverted,
    WarningCode::MaskTouchesBorder,
];

/// The reduced back light that [`examine`] needs.
pub(super) fn reduced_back_light(back: &Raster) -> Raster {
    thumbnail::luma(back, SIDE)
}

/// Examines the fused front light and the reduced back light. Adds warnings, and removes those that follow from them.
///
/// # Errors
/// [`Code::MaskFailed`] when a mask is required and the lights are exchanged; [`JobError::Cancelled`].
pub(super) fn examine(
    front: &Raster,
    back: Option<&Raster>,
    mode: MaskMode,
    control: &dyn Control,
    warnings: &mut Vec<Warning>,
) -> Result<(), JobError> {
    let front = thumbnail::luma(front, SIDE);
    if back.is_some_and(|back| segmentation::lights_exchanged(&front, back)) {
        let detail = "the front-light slices show a silhouette and the back-light slices a lit object: front/ and \
                      back/ seem to be exchanged; swap the folders and send the stack again";
        if mode == MaskMode::Required {
            return Err(Fault::new(Code::MaskFailed, format!("mask=required, but {detail}")).into());
        }
        warnings.retain(|warning| !CAUSED_BY_EXCHANGED_LIGHTS.contains(&warning.code));
        warnings.push(Warning::new(WarningCode::LightsExchanged, detail));
    }
    warnings.extend(dot_target(&front, control)?);
    Ok(())
}

/// The warning that the stack shows a dot target, which belongs to a calibration.
fn dot_target(front: &Raster, control: &dyn Control) -> Result<Option<Warning>, Cancelled> {
    let dots = calibration::dot_target(front, control)?;
    Ok(dots.map(|dots| {
        let detail = format!(
            "the stack shows a dot target (a grid of {dots} dots): to calibrate with it, send the zip to \
             POST /v1/profiles/{{rig}}/{{lens}}/calibrations"
        );
        Warning::new(WarningCode::DotTarget, detail)
    }))
}

#[cfg(test)]
mod tests;
