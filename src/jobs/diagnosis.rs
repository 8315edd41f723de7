//! What is wrong with a stack as a whole: told from its fused pictures.

use crate::contract::{Code, Fault, JobError, options::MaskMode};
use pinstack_science::{
    calibration,
    imaging::{Raster, reduced::reduced},
    segmentation,
    types::{Cancelled, Control, Warning},
};

/// Longer side of the copies that are looked at, px: one of the back light is kept until the front light is fused.
const SIDE: usize = 1_200;

/// What a mask made of the wrong light complains of, none of which is the cause.
const OF_A_WRONG_LIGHT: [&str; 5] =
    ["mask_translucent", "mask_low_separability", "mask_uneven_light", "mask_inverted", "mask_touches_border"];

/// What is kept of the fused back light.
pub(super) fn remembered(back: &Raster) -> Raster {
    reduced(back, SIDE)
}

/// Looks at the fused front light, and at what is kept of the back light: adds warnings, and takes away those that
/// follow from what is named.
///
/// # Errors
/// [`Code::MaskFailed`] when a mask is required and the lights are exchanged; [`JobError::Cancelled`].
pub(super) fn look(
    front: &Raster,
    back: Option<&Raster>,
    mode: MaskMode,
    control: &dyn Control,
    warnings: &mut Vec<Warning>,
) -> Result<(), JobError> {
    let front = reduced(front, SIDE);
    if back.is_some_and(|back| segmentation::exchanged(&front, back)) {
        let detail = "the front-light slices show a silhouette and the back-light slices a lit object: front/ and \
                      back/ seem to be exchanged; exchange the folders, and send the stack again";
        if mode == MaskMode::Required {
            return Err(Fault::new(Code::MaskFailed, format!("mask=required, but {detail}")).into());
        }
        warnings.retain(|warning| !OF_A_WRONG_LIGHT.contains(&warning.code.as_str()));
        warnings.push(Warning::new("lights_exchanged", detail));
    }
    warnings.extend(target(&front, control)?);
    Ok(())
}

/// A dot target is measured, not fused.
fn target(front: &Raster, control: &dyn Control) -> Result<Option<Warning>, Cancelled> {
    let dots = calibration::dot_target(front, control)?;
    Ok(dots.map(|dots| {
        let detail = format!(
            "the stack shows a dot target (a grid of {dots} dots): to calibrate with it, send the zip to \
             POST /v1/profiles/{{rig}}/{{lens}}/calibrations"
        );
        Warning::new("dot_target", detail)
    }))
}

#[cfg(test)]
#[path = "diagnosis_tests.rs"]
mod tests;
