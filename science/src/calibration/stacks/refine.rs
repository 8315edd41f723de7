//! Refinement: the profile that stacks start from, and how far the rig has moved since.
//!
//! A profile of a dot target knows the rig better than stacks do. So stacks are only asked for what changed:
//! similarities that are added to its homographies. Where these move no corner by more than their own uncertainty, the
//! homographies stay as they are.

use super::matched::Pair;
use super::model::NetworkModel;
use super::network::NetworkFit;
use super::transform::of_homography;
use crate::calibration::transform_models::{Frame, Parameters};
use crate::imaging::Slices;
use crate::types::profile::{CaptureMode, HomographyModel, ProfileInput};
use crate::types::{Error, ErrorKind, Homography};

/// Standard deviations by which an image corner moves if the rig has drifted. Without a drift, errors are at most 2.5
/// of them (`cargo bench --bench calibration_stacks`).
const DRIFTED: f64 = 3.0;

/// A profile that a refinement starts from.
#[derive(Debug, Clone, Copy)]
pub struct Revision<'a> {
    /// What sentences call it, for example "revision 3".
    pub name: &'a str,
    /// Its numbers.
    pub input: &'a ProfileInput,
    /// The transform model of its homographies.
    pub model: HomographyModel,
}

/// The largest movement of an image corner since a revision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Movement {
    /// Px.
    pub px: f64,
    /// Its standard deviation, px.
    pub sigma: f64,
    /// Index of the slice.
    pub slice: usize,
    /// Whether a corner of any slice moved by more than its uncertainty.
    pub is_drift: bool,
}

impl Revision<'_> {
    /// Checks that it is for stacks of so many slices.
    pub(super) fn check_count(&self, slices: &dyn Slices) -> Result<(), Error> {
        let (count, expected) = (slices.count(), self.input.homographies.len());
        if count == expected {
            return Ok(());
        }
        let detail = format!(
            "the stack of {} has {count} slices, but {} has {expected}: homographies can be refined with stacks of the same \
             rail positions only; name another revision, or calibrate without one",
            slices.name(0),
            self.name
        );
        Err(Error::new(ErrorKind::SliceCountMismatch, detail))
    }

    /// Checks that it is for slices of this size, px.
    pub(super) fn check_size(&self, [width, height]: [usize; 2]) -> Result<(), Error> {
        let expected = [self.input.image_width, self.input.image_height];
        if expected.map(|v| v as usize) == [width, height] {
            return Ok(());
        }
        let detail = format!(
            "the slices have {width} x {height} px, but {} is for {} x {} px: restore the setting of the camera, name another \
             revision, or calibrate without one",
            self.name, expected[0], expected[1]
        );
        Err(Error::new(ErrorKind::SizeMismatch, detail))
    }

    /// Its transforms reference slice -> slice.
    pub(super) fn transforms(&self, frame: &Frame) -> Result<Vec<Parameters>, Error> {
        let singular = || {
            let detail = format!("{} has a homography that is singular: name another revision", self.name);
            Error::new(ErrorKind::InvalidProfile, detail)
        };
        let homographies = self.input.homographies.iter();
        homographies.map(|homography| of_homography(homography, frame).ok_or_else(singular)).collect()
    }

    /// Replaces the places of all windows by those in slices without its lens distortion.
    pub(super) fn undistort(&self, pairs: &mut [Pair], frame: &Frame) {
        let Some(distortion) = self.input.distortion else { return };
        for window in pairs.iter_mut().flat_map(|pair| &mut pair.windows) {
            let ideal = |at: [f64; 2]| frame.unit(distortion.undistort(frame.pixel(at)));
            (window.first, window.second) = (ideal(window.first), ideal(window.second));
        }
    }

    /// Whether near and far parts may grow differently from slice to slice.
    pub(super) fn has_parallax(&self) -> bool {
        self.input.capture_mode != Some(CaptureMode::FixedLens)
    }
}

/// Growth per unit of the rail of transforms at `offsets` from the reference slice.
pub(super) fn growth(transforms: &[Parameters], offsets: &[f64]) -> f64 {
    let (product, square) = offsets
        .iter()
        .zip(transforms)
        .fold((0.0, 0.0), |(product, square), (z, p)| (product + z * p[0], square + z * z));
    product / f64::max(square, 1e-30)
}

/// The fit to use of those of a refinement, by its index: `chosen` if the rig has drifted, else the first, which keeps
/// the transforms as they were and gets the uncertainty of the other; and the movement that decides it.
pub(super) fn changed(
    fits: &mut [(NetworkModel, NetworkFit)],
    chosen: usize,
    start: &[Parameters],
    frame: &Frame,
    size: [u32; 2],
) -> (usize, Movement) {
    let moved = movement(start, &fits[chosen].1, frame, size);
    if moved.is_drift || fits[0].0 != NetworkModel::Unchanged {
        return (chosen, moved);
    }
    fits[0].1.corner_sigma = fits[chosen].1.corner_sigma.clone();
    (0, moved)
}

/// How far `fit` is from the transforms it started from.
fn movement(start: &[Parameters], fit: &NetworkFit, frame: &Frame, size: [u32; 2]) -> Movement {
    let mut worst = Movement { px: 0.0, sigma: f64::INFINITY, slice: 0, is_drift: false };
    for (slice, (old, new)) in start.iter().zip(&fit.parameters).enumerate() {
        let [old, new] = [old, new].map(|p| frame.homography(p).unwrap_or(Homography([f64::NAN; 9])));
        let px = new.corner_distance(&old, size[0], size[1]);
        let sigma = fit.stated_sigma(slice);
        worst.is_drift |= px > DRIFTED * sigma;
        if px >= worst.px {
            (worst.px, worst.sigma, worst.slice) = (px, sigma, slice);
        }
    }
    worst
}
