//! Calibration: from pictures of a dot target, one per slice, to one homography and one gain per slice.
//!
//! Way of the data: the sharpest slice is found and its grid of dots detected blindly; from there the grid is
//! followed outward, slice by slice; all dots of a slice are measured together; the dots that a slice and
//! the reference slice share give the homography (normalised DLT, least median of squares,
//! Levenberg-Marquardt). Each slice is decoded once for this, and up to nine once more to find the sharpest.
//! No pixels are kept: memory does not grow with the number of slices.

mod blobs;
mod centres;
mod chain;
mod dlt;
mod drift;
mod field;
mod lattice;
mod overlay;
pub mod page;
mod rail;
mod refine;
mod report;
mod robust;
mod search;
mod shape;
mod sharpness;
mod sighting;
mod solve;
mod working;

#[cfg(test)]
mod odd_tests;
#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;

pub use drift::drift;
pub use overlay::overlay;

use crate::imaging::Slices;
use crate::model::profile::{CaptureMode, ProfileSlice};
use crate::model::report::CalibrationReport;
use crate::model::request::CalibrationOptions;
use crate::model::{Code, Control, Fault, Stop, Warning};

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
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// One sentence for the technician.
    pub verdict: String,
    /// All of it, for the report that the technician reads.
    pub report: CalibrationReport,
}

/// Measures a stack of a dot target.
///
/// The reference slice is `options.reference_index`, by default the middle one (`count / 2`).
/// Homographies map slice px to reference-slice px; the reference's own is the identity, its gain 1.
///
/// # Errors
/// [`Stop::Cancelled`], or a fault: [`Code::TargetNotFound`] naming the slices when there are too few dots, no
/// grid or a mirrored one; [`Code::SizeMismatch`] when slices differ in size; [`Code::InvalidRequest`] for a
/// reference that does not exist or fewer than two slices; and whatever loading a slice says.
pub fn calibrate(
    slices: &dyn Slices,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Calibration, Stop> {
    let count = slices.count();
    if count < 2 {
        let detail = format!("a calibration needs at least 2 slices of the dot target; the archive has {count}");
        return Err(Fault::new(Code::InvalidRequest, detail).into());
    }
    let reference = options.reference_index.map_or(count / 2, |index| index as usize);
    if reference >= count {
        let detail = format!("reference_index is {reference}; the stack has {count} slices, so 0 to {}", count - 1);
        return Err(Fault::new(Code::InvalidRequest, detail).into());
    }
    let seen = chain::see_all(slices, control)?;
    let solved = solve::solve(slices, &seen, reference, control)?;
    Ok(report::report(slices, options, &seen, solved))
}
