//! Calibration of a rig: from a stack of a dot target to one homography and one gain per slice.
//!
//! Input: the slices and [`CalibrationOptions`]. Output: a [`Calibration`] with homographies, gains, their
//! uncertainties, findings and a report.
//!
//! | step | module | what it does |
//! |---|---|---|
//! | detection | `detection`, `blobs`, `grid_indexing` | finds the grid in the reference slice, or in another one |
//! | tracking | `tracking`, `coarse_registration` | follows the grid from slice to slice in both directions |
//! | code | `code` | recognises a coded target, on which every dot is unique |
//! | identity | `identity` | checks that the same label is the same dot in all slices, and corrects it |
//! | measurement | `phase`, `inpainting`, `radial_profile`, `flat_field` | measures each dot by the phase of the pattern |
//! | distortion | `distortion` | measures lens distortion that stays with the sensor |
//! | inliers | `solve`, `robust`, `dlt` | finds the dots that agree with one homography to the reference slice |
//! | model | `transform_models`, `rail_fit`, `model_selection` | fits the transform models and selects one |
//! | rail law | `rail`, `rail_anomalies` | improves blurred slices, predicts missing ones, finds irregular steps |
//! | order | `rail_order`, `rail_jumps` | finds slices out of order, jumps of the image, and single displaced slices |
//! | gains | `dot_photometry`, `gains`, `tint` | compares the brightness and the tint of the target |
//! | colour | `lateral_colour` | measures the scale of red and blue relative to green |
//! | banding | `banding` | finds stripes of a flickering lamp |
//! | uneven light | `falloff` | what light that falls off before the blur does to blurred slices |
//! | lost slices | `lost` | says why a slice was not measured |
//! | report | `report`, `findings`, `grade`, `capture`, `size_law`, `camera`, `moved_target` | capture mode, camera, findings, grade |
//!
//! [`calibrate_by_stacks`] needs no target (`stacks`).
//!
//! The stages hand on `detected` (the dots of a slice), `tracked` (all slices) and `result`.
//!
//! Each slice is decoded once (twice where the grid was searched for in vain at first). Of its pixels only a
//! fingerprint is kept, and with its dots at most about 1 MB ([`SLICE_BYTES`]). The method is described in
//! `docs/METHOD.md`.

mod banding;
mod blobs;
mod blur;
mod camera;
mod capture;
mod coarse_registration;
mod code;
mod detected;
mod detection;
mod distortion;
mod dlt;
mod dot_photometry;
mod drift;
mod falloff;
mod findings;
mod flat_field;
mod gains;
mod grade;
mod grid_indexing;
mod identity;
mod inpainting;
mod later_camera;
mod lateral_colour;
mod lattice;
mod line_fit;
mod lost;
mod model_selection;
mod moved_target;
mod names;
mod overlay;
mod phase;
mod radial_profile;
mod rail;
mod rail_anomalies;
mod rail_fit;
mod rail_jumps;
mod rail_order;
mod report;
mod result;
mod robust;
mod size_law;
mod solve;
mod stacks;
mod statistics;
mod surface;
mod target_check;
mod tint;
mod tracked;
mod tracking;
mod transform_models;
mod working_image;

#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;

pub use detected::SLICE_BYTES;
pub use detection::MAX_SAMPLES;
pub use drift::{NO_MOVEMENT_PX, SMALL_MOVEMENT_PX, drift};
pub use later_camera::add_camera;
pub use overlay::overlay;
pub use result::{Calibration, Dot, DotUse};
pub use stacks::{Revision, STACKS_BYTES, calibrate_by_stacks, refine_by_stacks};
pub use target_check::dot_target;

use crate::imaging::Slices;
use crate::types::calibration_options::CalibrationOptions;
use crate::types::{Control, Error, ErrorKind, Interrupted};

/// Calibrates a rig from a stack of a dot target.
///
/// The reference slice is `options.reference_index`, by default the middle one (`count / 2`). Homographies map slice px
/// to reference-slice px. The homography of the reference slice is the identity and its gain is 1.
///
/// # Errors
/// - [`Interrupted::Cancelled`] when `control` cancels the work.
/// - [`ErrorKind::TargetNotFound`], with the slices, when there is no grid, there are too few dots, or a homography is
///   implausible (mirrored, for example).
/// - [`ErrorKind::SizeMismatch`] when slices differ in size.
/// - [`ErrorKind::InvalidParameter`] for fewer than two slices, a `reference_index` beyond the stack, or invalid rail
///   positions.
/// - Errors of [`Slices::load`].
///
/// # Example
/// ```
/// use pinstack_science::calibration::calibrate;
/// use pinstack_science::synth::{DotTarget, Rendered, Rig};
/// use pinstack_science::types::{NoControl, calibration_options::CalibrationOptions};
///
/// let rig = Rig::sized(300, 200, 3);
/// let slices = Rendered::target(&rig, &DotTarget::for_rig(&rig, 12));
/// let calibration = calibrate(&slices, &CalibrationOptions::default(), &NoControl)?;
/// let error_px = calibration.slices[0].homography.corner_distance(&rig.homography(0), 300, 200);
/// assert!(calibration.reference_index == 1 && error_px < 0.3);
/// # Ok::<(), pinstack_science::types::Interrupted>(())
/// ```
pub fn calibrate(
    slices: &dyn Slices,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Interrupted> {
    calibrate_with_moved(slices, None, options, control)
}

/// As [`calibrate`], with slices of the same target after it was moved by `options.target_advance_mm`: one, taken with
/// the rail where it was for the reference slice, or as many as `slices`. They give
/// [`CalibrationOptions::moved_target_pitch_px`].
///
/// # Errors
/// As [`calibrate`], and [`ErrorKind::TargetNotFound`] when the moved target is not seen at the reference.
pub fn calibrate_with_moved(
    slices: &dyn Slices,
    moved: Option<&dyn Slices>,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Interrupted> {
    let count = slices.count();
    if count < 2 {
        let detail = format!("a calibration needs at least 2 slices of the dot target, but the archive has {count}");
        return Err(Error::new(ErrorKind::InvalidParameter, detail).into());
    }
    let reference = options.reference_index.map_or(count / 2, |index| index as usize);
    if reference >= count {
        let detail = format!(
            "reference_index is {reference}, but the stack has {count} slices: use an index from 0 to {}",
            count - 1
        );
        return Err(Error::new(ErrorKind::InvalidParameter, detail).into());
    }
    let given = rail_positions(options, count)?;
    let mut tracked = tracking::track_all(slices, reference, control)?;
    falloff::doubt_uneven_light(&mut tracked);
    let lens = distortion::analyse(&tracked, reference, control)?;
    if let Some(distortion) = &lens.distortion {
        tracked = distortion::straightened(tracked, distortion);
    }
    let mut options = options.clone();
    if let Some(moved) = moved {
        let pitch = moved_target::dot_pitch(moved, reference, lens.distortion.as_ref(), control)?;
        options.moved_target_pitch_px = Some(pitch);
    }
    let solved = solve::solve(slices, &tracked, reference, given.as_deref(), &options, control)?;
    Ok(report::report(slices, &options, &tracked, solved, given.is_some(), &lens))
}

/// The rail positions that the user specified, mm.
fn rail_positions(options: &CalibrationOptions, count: usize) -> Result<Option<Vec<f64>>, Error> {
    let wrong = |detail: String| Err(Error::new(ErrorKind::InvalidParameter, detail));
    match (&options.rail_positions_mm, options.rail_step_mm) {
        (Some(_), Some(_)) => wrong("rail_positions_mm and rail_step_mm are both given: give one of them".into()),
        (Some(positions), None) => {
            if positions.len() != count {
                return wrong(format!(
                    "rail_positions_mm has {} positions for {count} slices: give one position per slice",
                    positions.len()
                ));
            }
            let (rising, falling) =
                (positions.windows(2).all(|w| w[0] < w[1]), positions.windows(2).all(|w| w[0] > w[1]));
            if !(rising || falling) {
                return wrong("rail_positions_mm must be strictly increasing or strictly decreasing".into());
            }
            Ok(Some(positions.clone()))
        }
        (None, Some(step)) => {
            if !step.is_finite() || step == 0.0 {
                return wrong(format!("rail_step_mm is {step}: it must be a finite number other than 0"));
            }
            Ok(Some((0..count).map(|i| step * i as f64).collect()))
        }
        (None, None) => Ok(None),
    }
}
