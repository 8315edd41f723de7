//! The capture plan: how many slices an object needs, and where the rail stops for each.
//!
//! The lens is that of [`crate::types::lens`], with f-number `N` and effective f-number `N_eff`; circle of confusion
//! `c`; wavelength `lambda`.
//!
//! | quantity | formula | source |
//! |---|---|---|
//! | geometric depth of focus | `2 c N_eff` | Li and Nguyen 2019, equations 1 to 3 |
//! | geometric depth of field | `2 c N_eff / M^2` | equations 4 to 6; the last form of 6 as printed swaps `f` and `d1 - f`, which is wrong by `M^2` |
//! | wave-optical depth of focus | `4 lambda N_eff^2` | `lambda / NA'^2` with `NA' = 1 / (2 N_eff)`, on the side of the sensor |
//! | wave-optical depth of field | `4 lambda N_eff^2 / M^2` | `lambda / NA^2` with `NA = M / (2 N_eff)`, on the side of the object |
//! | diameter of the Airy disc | `2.44 lambda N_eff` | |
//!
//! The step is `1 - overlap` times the sum of the geometric and the wave-optical depth, which is what is seen: with a
//! moving lens of the depth of field, with a fixed lens of the depth of focus, because there the sensor moves. Of a
//! stack, the slice with the smallest depth decides. What the step costs is `contrast_between_slices`: the transfer
//! function of a defocused lens (Hopkins 1955) halfway between two slices, over that in focus.

mod capture_plan;
mod input;
mod lens;
mod path;
mod warnings;

pub use capture_plan::{CapturePlan, DepthRange, PlannedSlice};
pub use input::PlanInput;

use super::refused;
use crate::types::{
    Error,
    profile::{CaptureMode, MAX_SLICES},
};

use lens::Lens;
use path::Path;

/// Plans a capture.
///
/// # Errors
/// [`crate::types::ErrorKind::InvalidParameter`] with the parameter: a number outside its range, both or neither of
/// magnification and object distance, an object that reaches the lens, or more than 1000 slices.
///
/// # Example
/// ```
/// use pinstack_science::optics::{advice::advice, plan::{PlanInput, plan}};
///
/// let input: PlanInput = serde_json::from_str(
///     r#"{ "focal_mm": 65, "f_number": 5.6, "magnification": 1, "pixel_pitch_um": 4.14, "object_depth_mm": 5,
///          "mode": "fixed_lens", "image_width": 6000, "image_height": 4000 }"#,
/// )?;
/// let plan = plan(&input)?;
/// assert_eq!(plan.rail_positions_mm.len(), plan.slice_count as usize);
/// assert!(advice(&plan).pitch_mm > 0.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn plan(input: &PlanInput) -> Result<CapturePlan, Error> {
    input.check()?;
    let lens = Lens::of(input);
    let magnification = input.magnification()?;
    let path = Path::of(input, &lens, magnification)?;
    let slice_count = slice_count(input, &path)?;
    let steps = f64::from(slice_count - 1);
    let rail: Vec<f64> = (0..slice_count).map(|i| path.travel * f64::from(i) / steps).collect();
    let reference = path.reference(&rail, &lens, magnification);
    let slices: Vec<PlannedSlice> = (0..rail.len()).map(|i| path.slice(&rail, i, reference, &lens)).collect();
    let reference_magnification = path.magnification(rail[reference], &lens);
    let principal_distance = lens.at(reference_magnification).principal_distance();
    let effective = lens.effective_f_number(magnification);
    let smallest = slices.iter().map(|slice| slice.magnification).fold(f64::INFINITY, f64::min);
    let size = input.image_width.zip(input.image_height);
    let mut plan = CapturePlan {
        magnification,
        reference_magnification,
        object_distance_mm: lens.at(magnification).object_distance(),
        principal_distance_mm: principal_distance,
        principal_distance_px: principal_distance / lens.pixel,
        effective_f_number: effective,
        numerical_aperture: magnification / (2.0 * effective),
        airy_um: 2.44e3 * lens.wavelength * effective,
        coc_um: 1e3 * lens.coc,
        depth_of_focus_mm: lens.depth_of_focus(magnification),
        depth_of_field_mm: lens.depth_of_field(magnification),
        field_of_view_mm: size.map(|(w, h)| [w, h].map(|side| f64::from(side) * lens.pixel / magnification)),
        slice_count,
        reference_index: u32::try_from(reference).unwrap_or(u32::MAX),
        step_mm: path.travel / steps,
        largest_step_mm: path.largest_step,
        contrast_between_slices: lens.contrast(smallest, path.defocus(path.travel / steps)),
        travel_mm: path.travel,
        rail_positions_mm: rail,
        common_field: match input.mode {
            CaptureMode::FixedLens => Some(slices.iter().map(|slice| slice.scale).fold(1.0, f64::min)),
            CaptureMode::MovingLens | CaptureMode::LensAlone => None,
        },
        slices,
        warnings: Vec::new(),
    };
    plan.warnings = warnings::of(input, &plan);
    Ok(plan)
}

fn slice_count(input: &PlanInput, path: &Path) -> Result<u32, Error> {
    if let Some(count) = input.slice_count {
        return Ok(count);
    }
    let count = (path.travel / path.largest_step).ceil() + 1.0;
    if count > MAX_SLICES as f64 {
        let detail = format!(
            "object_depth_mm is {}, which needs {count} slices of {:.4} mm; a stack has at most {MAX_SLICES}: stop down, \
             accept a smaller overlap, or use a smaller magnification",
            input.object_depth_mm, path.largest_step
        );
        return Err(refused("object_depth_mm", detail));
    }
    Ok((count as u32).max(2))
}

#[cfg(test)]
mod tests;
