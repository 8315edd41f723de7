//! From measured dots to homographies: inliers, transform model, rail law, gains, and the uncertainty of each slice.
//!
//! | stage | module | what it makes |
//! |---|---|---|
//! | inliers | `inliers` | per slice the dots that agree with one homography |
//! | rail | `rail_state` | positions, irregular steps and jumps, by the similarity estimates of the slices |
//! | model | `selection`, `estimates` | the transform model, and the estimate of each slice under it |
//! | slices alone | `alone` | slices that contradict the model at the corners |
//! | check | `missing` | an error that names the slices that can neither be measured nor predicted |
//! | solution | `solution` | homography, gain and dots of each slice |

mod alone;
mod estimates;
mod inliers;
mod missing;
mod rail_state;
mod selection;
mod solution;

pub(super) use inliers::find_inliers;
pub(super) use solution::{Solution, Solved};

use estimates::{Estimate, Setting, floors};
use inliers::{Inliers, drop_mistaken_grids, own_estimates};
use missing::{reference_without_grid, unmeasured_slices};
use rail_state::{RailState, nominal_positions};
use selection::select;

use super::transform_models::{Frame, TransformModel};
use super::{
    capture, detected::Detection, gains, lost::Loss, rail::EstimateSource, size_law::ScaleSample, tracked::Tracked,
};
use crate::imaging::Slices;
use crate::types::calibration_options::CalibrationOptions;
use crate::types::{Cancelled, Control, Error, ErrorKind, Interrupted};

/// Largest corner uncertainty of a predicted slice, px.
const MAX_PREDICTED_SIGMA: f64 = 1.5;

/// Solves every slice. `given`: rail positions that the user specified.
///
/// # Errors
/// An error that names the slices that can neither be measured nor predicted.
pub(super) fn solve(
    slices: &dyn Slices,
    tracked: &Tracked,
    reference: usize,
    given: Option<&[f64]>,
    options: &CalibrationOptions,
    control: &dyn Control,
) -> Result<Solution, Interrupted> {
    let Some(base) = tracked.detections[reference].as_ref() else {
        return Err(reference_without_grid(slices, reference, Loss::of(tracked, reference)).into());
    };
    let frame = Frame::new(tracked.width, tracked.height);
    let mut inliers = all_inliers(tracked, base, reference, &frame, control)?;
    // the similarity model decides about the rail, whichever model is selected in the end
    let similar =
        |inliers: &[Inliers]| own_estimates(TransformModel::Similarity, inliers, reference, &frame, tracked.size());
    let first = similar(&inliers);
    drop_mistaken_grids(&mut inliers, &first, &nominal_positions(given, first.len()), tracked, base);
    let capture = |sizes: &[ScaleSample], is_even: bool| {
        let magnification = options.magnification(base.pitch);
        capture::decide(sizes, given.is_some(), is_even, options.capture_mode, magnification)
            .found
            .or(options.capture_mode)
    };
    let mut rail = RailState::of(&similar(&inliers), given, reference, frame.half, &capture);
    let mut setting = Setting::new(frame, tracked.size(), reference, &rail, floors(tracked, base.pitch));
    let (selection, estimates) = select(&inliers, &mut setting, options.model);
    let alone = std::mem::take(&mut setting.alone);
    rail.differ(&alone);
    require_all(slices, tracked, &estimates, reference)?;
    let gains = gains::of(tracked, reference, &rail.positions);
    let solved = estimates.into_iter().zip(&inliers).zip(gains).enumerate();
    let solved = solved.map(|(index, ((estimate, inliers), gain))| match estimate {
        Some(estimate) if index != reference => {
            Solved::estimated(estimate, inliers, tracked.detections[index].as_ref(), base, gain)
        }
        _ => Solved::reference(base, gain),
    });
    let solved: Vec<Solved> = solved.collect();
    require_plausible(slices, &solved, tracked.size())?;
    Ok(Solution { reference, slices: solved, selection, rail })
}

/// The inliers of each slice; empty for the reference slice and where there are too few.
fn all_inliers(
    tracked: &Tracked,
    base: &Detection,
    reference: usize,
    frame: &Frame,
    control: &dyn Control,
) -> Result<Vec<Inliers>, Cancelled> {
    let of_slice = |(index, detection): (usize, &Option<Detection>)| {
        control.check()?;
        let other = detection.as_ref().filter(|_| index != reference);
        Ok(other.and_then(|s| find_inliers(s, base, frame)).unwrap_or_default())
    };
    tracked.detections.iter().enumerate().map(of_slice).collect()
}

/// Checks that every slice but the reference was measured, or can be predicted accurately enough.
fn require_all(
    slices: &dyn Slices,
    tracked: &Tracked,
    estimates: &[Option<Estimate>],
    reference: usize,
) -> Result<(), Error> {
    let is_lost = |m: &Option<Estimate>| {
        m.as_ref().is_none_or(|m| m.source == EstimateSource::Law && m.sigma > MAX_PREDICTED_SIGMA)
    };
    let lost: Vec<usize> = (0..estimates.len()).filter(|&i| i != reference && is_lost(&estimates[i])).collect();
    if lost.is_empty() {
        return Ok(());
    }
    let worst = lost.iter().filter_map(|&i| estimates[i].as_ref().map(|m| m.sigma)).fold(0.0, f64::max);
    let why = if worst > 0.0 {
        format!(
            ", and a prediction from the other slices would leave their image corners uncertain by {worst:.1} px (the \
             limit is {MAX_PREDICTED_SIGMA} px)"
        )
    } else {
        ", and too few other slices were measured to predict them".to_owned()
    };
    Err(unmeasured_slices(slices, &lost, |i| Loss::of(tracked, i), &why))
}

/// Checks that no homography is implausible (mirrored, for example).
fn require_plausible(slices: &dyn Slices, solved: &[Solved], [width, height]: [u32; 2]) -> Result<(), Error> {
    let violation =
        |(index, slice): (usize, &Solved)| Some((index, slice.estimate.homography.violation(width, height)?));
    let Some((index, why)) = solved.iter().enumerate().find_map(violation) else { return Ok(()) };
    let name = slices.name(index);
    let detail = format!(
        "the homography of {name} (slice {index}) {why}: check that it shows the same target as the reference slice"
    );
    Err(Error::new(ErrorKind::TargetNotFound, detail).in_file(name, Some(index as u32)))
}
