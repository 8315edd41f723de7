//! Calibration: from pictures of a dot target, one per slice, to one homography and one gain per slice.
//!
//! Way of the data: the grid of dots is detected blindly in the reference slice (or another that shows it); from there
//! it is followed outward, slice by slice; each dot is measured by the phase of the pattern around it, which blur
//! leaves alone; the dots that a slice and the reference slice share give the map (normalised DLT, least median of
//! squares, weighted least squares) in the simplest family that explains them; and the law of the rail helps the slices
//! whose own dots say little. Each slice is decoded once. No pixels are kept: memory does not grow with the number of
//! slices.

mod blobs;
mod blur;
mod camera;
mod capture;
mod coarse_registration;
mod detection;
mod dlt;
mod dot_photometry;
mod drift;
mod findings;
mod flat_field;
mod gains;
mod inpainting;
mod lattice;
mod model_selection;
mod overlay;
mod phase;
mod radial_profile;
mod rail;
mod rail_anomalies;
mod rail_fit;
mod report;
mod robust;
mod solve;
mod target_check;
mod tracking;
mod transform_models;
mod working_image;

#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;

pub use detection::MAX_SAMPLES;
pub use drift::{NO_MOVEMENT_PX, SMALL_MOVEMENT_PX, drift};
pub use overlay::overlay;
pub use target_check::dot_target;

use crate::imaging::Slices;
use crate::types::calibration_options::CalibrationOptions;
use crate::types::profile::{CaptureMode, HomographyModel, ProfileSlice};
use crate::types::report::CalibrationReport;
use crate::types::{Control, Error, ErrorKind, Interrupted, Warning};

/// What became of a dot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DotUse {
    /// Agrees with the homography of its slice.
    Inlier,
    /// Does not agree, and was left out.
    Outlier,
    /// The reference slice does not show it, or the slice's homography was predicted, so it was not needed.
    Unused,
}

/// A dot that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dot {
    /// Column and row in the grid, the same for all slices; which dot is (0, 0) is arbitrary.
    pub label: [i32; 2],
    /// Centre in px of its slice.
    pub at: [f64; 2],
    /// Standard deviation of each coordinate, px.
    pub sigma: f64,
    /// What became of it.
    pub used: DotUse,
}

/// A measured stack.
#[derive(Debug, Clone)]
pub struct Calibration {
    /// Width of every slice, px.
    pub width: u32,
    /// Height of every slice, px.
    pub height: u32,
    /// The slice that all others are mapped to.
    pub reference_index: usize,
    /// One entry per slice: homography, gain, and how good they are.
    pub slices: Vec<ProfileSlice>,
    /// Per slice the dots found.
    pub dots: Vec<Vec<Dot>>,
    /// Distance of neighbouring dots in the reference slice, px.
    pub dot_pitch_px: f64,
    /// Size of the image over size of the target, when both pitches were told.
    pub magnification: Option<f64>,
    /// What moved, when the scales leave no doubt (rail steps being equal).
    pub capture_mode: Option<CaptureMode>,
    /// TransformModel of maps that the homographies belong to.
    pub model: HomographyModel,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// One sentence for the technician.
    pub verdict: String,
    /// All that was found, for the report.
    pub report: CalibrationReport,
}

/// Measures a stack of a dot target.
///
/// The reference slice is `options.reference_index`, by default the middle one (`count / 2`).
/// Homographies map slice px to reference-slice px; the reference's own is the identity, its gain 1.
///
/// # Errors
/// [`Interrupted::Cancelled`], or a fault: [`ErrorKind::TargetNotFound`] naming the slices when there are too few dots, no
/// grid or a mirrored one; [`ErrorKind::SizeMismatch`] when slices differ in size; [`ErrorKind::InvalidParameter`] for a
/// reference that does not exist or fewer than two slices; and whatever loading a slice says.
pub fn calibrate(
    slices: &dyn Slices,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Interrupted> {
    let count = slices.count();
    if count < 2 {
        let detail = format!("a calibration needs at least 2 slices of the dot target; the archive has {count}");
        return Err(Error::new(ErrorKind::InvalidParameter, detail).into());
    }
    let reference = options.reference_index.map_or(count / 2, |index| index as usize);
    if reference >= count {
        let detail = format!("reference_index is {reference}; the stack has {count} slices, so 0 to {}", count - 1);
        return Err(Error::new(ErrorKind::InvalidParameter, detail).into());
    }
    let told = rail_positions(options, count)?;
    let tracked = tracking::track_all(slices, reference, control)?;
    let solved = solve::solve(slices, &tracked, reference, told.as_deref(), options.model, control)?;
    Ok(report::report(slices, options, &tracked, solved, told.is_some()))
}

/// The positions on the rail that the user told, mm.
fn rail_positions(options: &CalibrationOptions, count: usize) -> Result<Option<Vec<f64>>, Error> {
    let wrong = |detail: String| Err(Error::new(ErrorKind::InvalidParameter, detail));
    match (&options.rail_positions_mm, options.rail_step_mm) {
        (Some(_), Some(_)) => wrong("rail_positions_mm and rail_step_mm say the same thing twice: give one".into()),
        (Some(positions), None) => {
            if positions.len() != count {
                return wrong(format!("{} rail positions for {count} slices", positions.len()));
            }
            let (rising, falling) =
                (positions.windows(2).all(|w| w[0] < w[1]), positions.windows(2).all(|w| w[0] > w[1]));
            if !(rising || falling) {
                return wrong("rail_positions_mm must rise or fall from slice to slice".into());
            }
            Ok(Some(positions.clone()))
        }
        (None, Some(step)) => {
            if !step.is_finite() || step == 0.0 {
                return wrong(format!("rail_step_mm is {step}; it must not be zero"));
            }
            Ok(Some((0..count).map(|i| step * i as f64).collect()))
        }
        (None, None) => Ok(None),
    }
}
