//! The dot pitch of the moved target, from slices that were taken beside those of a calibration.
//!
//! In: one slice, taken with the rail where it was for the reference slice, or a slice for each position. Out: the dot
//! pitch at the reference, from which the distance of the entrance pupil follows ([`super::camera`]). The other slices
//! help only to find dots that are blurred at the reference.

use super::{distortion, tracking};
use crate::imaging::Slices;
use crate::types::{Cancelled, Control, Error, ErrorKind, Interrupted, distortion::Distortion};

/// The distance of neighbouring dots in the slice of `moved` that was taken at the reference, px, without `distortion`.
///
/// # Errors
/// [`ErrorKind::TargetNotFound`] when that slice does not show the dots, and as [`tracking::track_all`].
pub(super) fn dot_pitch(
    moved: &dyn Slices,
    reference: usize,
    distortion: Option<&Distortion>,
    control: &dyn Control,
) -> Result<f64, Interrupted> {
    let at = if moved.count() == 1 { 0 } else { reference };
    let mut tracked = tracking::track_all(moved, at, &WithoutProgress(control))?;
    if let Some(distortion) = distortion {
        tracked = distortion::straightened(tracked, distortion);
    }
    let detection = tracked.detections.into_iter().nth(at).flatten();
    detection.map(|detection| detection.pitch).ok_or_else(|| {
        let name = moved.name(at);
        let detail = format!(
            "{name} is the picture of the moved target at the reference, and shows no grid of dots: move the target \
             less, so that it is sharper"
        );
        Error::new(ErrorKind::TargetNotFound, detail).in_file(name, u32::try_from(at).ok()).into()
    })
}

/// Cancels as the other control does. Progress is that of the slices of the calibration alone.
struct WithoutProgress<'a>(&'a dyn Control);

impl Control for WithoutProgress<'_> {
    fn progress(&self, _stage: &'static str, _completed: usize, _total: usize) {}

    fn check(&self) -> Result<(), Cancelled> {
        self.0.check()
    }
}
