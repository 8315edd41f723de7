//! What limits a capture.

use super::{capture_plan::CapturePlan, input::PlanInput};
use crate::types::{Warning, WarningCode};

/// An Airy disc larger than so many circles of confusion decides the sharpness.
const AIRY_COC: f64 = 2.0;
/// Pixels per Airy disc beyond which the image has no more detail.
const AIRY_PX: f64 = 6.0;
/// Relative error of the first-order equations beyond which a warning is due.
const FIRST_ORDER: f64 = 0.01;

/// The warnings of a plan.
pub(super) fn of(input: &PlanInput, plan: &CapturePlan) -> Vec<Warning> {
    let mut found = Vec::new();
    let mut warn = |code: WarningCode, detail: String| found.push(Warning::new(code, detail));
    if plan.airy_um > AIRY_COC * plan.coc_um {
        warn(
            WarningCode::DiffractionLimited,
            format!(
                "the Airy disc is {:.1} um wide, the circle of confusion {:.1} um: diffraction decides the sharpness; open \
                 the aperture and take more slices",
                plan.airy_um, plan.coc_um
            ),
        );
    }
    if plan.airy_um > AIRY_PX * input.pixel_pitch_um {
        let pixels = plan.airy_um / input.pixel_pitch_um;
        let detail = format!("the Airy disc covers {pixels:.1} pixels: smaller images would show the same detail");
        warn(WarningCode::Oversampled, detail);
    }
    if input.rail_resolution_um.is_some_and(|resolution| 1e3 * plan.step_mm < resolution) {
        let what = match (plan.slice_count, input.slice_count) {
            (..=2, _) => "the whole object is within one step of the rail, so one slice may do",
            (_, Some(_)) => "take fewer slices",
            (_, None) => "stop down or accept a smaller overlap",
        };
        let detail = format!("the step is {:.1} um, smaller than the rail can make: {what}", 1e3 * plan.step_mm);
        warn(WarningCode::StepBelowRailResolution, detail);
    }
    if plan.step_mm > plan.largest_step_mm * (1.0 + 1e-9) {
        let detail = format!(
            "{} slices are {:.4} mm apart, more than the {:.4} mm that keep an overlap of {:.0} %: parts between them may be \
             out of focus",
            plan.slice_count,
            plan.step_mm,
            plan.largest_step_mm,
            100.0 * input.overlap
        );
        warn(WarningCode::TooFewSlices, detail);
    }
    // near and far limits are d1 c' / (phi_a +- c') with c' = c / M
    let share = 1e-3 * plan.coc_um / plan.magnification * input.f_number / input.focal_mm;
    if share.powi(2) > FIRST_ORDER {
        let detail = format!(
            "the circle of confusion, seen at the object, is {share:.2} of the aperture (c N / (M f)), so depth of \
             field is not symmetrical and the plan is an approximation; open the aperture, use a larger magnification, \
             or take more slices than planned"
        );
        warn(WarningCode::FirstOrder, detail);
    }
    found
}
