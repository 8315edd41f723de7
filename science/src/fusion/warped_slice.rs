//! One slice as the fusion sees it.

use super::Plan;
use crate::{
    imaging::{Raster, Samples, Slices},
    types::{Error, ErrorKind},
};

/// Slice `index` in the geometry of the reference slice, with its gain: what [`fuse`](super::fuse) takes its pixels
/// from. 0 where the slice does not cover the canvas. The raster has the channels and the bits of the file.
///
/// # Errors
/// [`ErrorKind::SliceCountMismatch`] when the stack or the plan has no such slice; [`ErrorKind::SizeMismatch`] when its
/// size is not that of the plan; [`ErrorKind::InvalidProfile`] when the geometry of the plan cannot be applied to it;
/// those of [`Slices::load`].
///
/// ```
/// # use pinstack_science::{fusion::{Plan, SlicePlan, warped_slice}, imaging::Raster, types::Homography};
/// let slice = [Raster::eight(40, 30, 1, (0..40 * 30).map(|at| (at % 200) as u8).collect())];
/// let moved = SlicePlan { homography: Homography::similarity(1.0, [4.0, 2.0]), ..SlicePlan::ALIGNED };
/// let plan = Plan { slices: vec![moved], ..Plan::aligned(40, 30, 1) };
/// let warped = warped_slice(&&slice[..], &plan, 0)?.luma();
/// assert!((warped.at(24, 12) - slice[0].luma().at(20, 10)).abs() < 1.0);
/// assert_eq!(warped.at(0, 0), 0.0, "not covered");
/// # Ok::<(), pinstack_science::types::Error>(())
/// ```
pub fn warped_slice(slices: &dyn Slices, plan: &Plan, index: usize) -> Result<Raster, Error> {
    let (count, planned) = (slices.count(), plan.slices.len());
    let both = count.min(planned);
    if index >= both {
        let mut detail = format!("there is no slice {index}: the stack has {count} slices and its profile {planned}");
        if let Some(last) = both.checked_sub(1) {
            detail.push_str(&format!("; use an index from 0 to {last}"));
        }
        return Err(Error::new(ErrorKind::SliceCountMismatch, detail));
    }
    let Raster { width, height, channels, samples } = slices.load(index)?;
    if (width, height) != (plan.width, plan.height) {
        let detail = format!(
            "slice {index} is {width} x {height} px and the profile is for {} x {} px; use the image size of the \
             calibration",
            plan.width, plan.height
        );
        return Err(Error::new(ErrorKind::SizeMismatch, detail).in_file(slices.name(index), u32::try_from(index).ok()));
    }
    let warp = plan.warp(index)?;
    let samples = match samples {
        Samples::Eight(samples) => Samples::Eight(warp.apply(samples, channels)),
        Samples::Sixteen(samples) => Samples::Sixteen(warp.apply(samples, channels)),
    };
    Ok(Raster { width, height, channels, samples })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{fusion::SlicePlan, types::Homography};

    fn slices() -> [Raster; 2] {
        let ramp = |step: usize| (0..40 * 30).map(|i| (i * step % 200) as u8).collect();
        [Raster::eight(40, 30, 1, ramp(1)), Raster::eight(40, 30, 1, ramp(3))]
    }

    #[test]
    fn a_slice_is_moved_by_its_homography_and_multiplied_by_its_gain() {
        let slices = slices();
        let moved = SlicePlan { homography: Homography::similarity(1.0, [4.0, 2.0]), gain: 0.5, rail_mm: None };
        let plan = Plan { slices: vec![SlicePlan::ALIGNED, moved], ..Plan::aligned(40, 30, 2) };
        assert_eq!(warped_slice(&&slices[..], &plan, 0).expect("a slice"), slices[0], "the reference stays as it is");
        let warped = warped_slice(&&slices[..], &plan, 1).expect("a slice");
        let (Samples::Eight(from), Samples::Eight(to)) = (&slices[1].samples, &warped.samples) else {
            panic!("8 bits")
        };
        for (x, y) in [(10, 10), (39, 29), (20, 15)] {
            let expected = f64::from(from[(y - 2) * 40 + x - 4]) / 2.0;
            assert!((f64::from(to[y * 40 + x]) - expected).abs() <= 0.51, "({x}, {y})");
        }
        assert_eq!(to[0], 0, "outside of the slice");
    }

    #[test]
    fn what_the_stack_does_not_have_is_refused() {
        let slices = slices();
        let refused = |plan: &Plan, index, kind| {
            let error = warped_slice(&&slices[..], plan, index).expect_err("refused");
            assert_eq!(error.kind, kind);
            error.detail
        };
        let missing = |planned| refused(&Plan::aligned(40, 30, planned), 2, ErrorKind::SliceCountMismatch);
        for (planned, last) in [(2, 1), (3, 1), (1, 0)] {
            let what = format!("the stack has 2 slices and its profile {planned}; use an index from 0 to {last}");
            assert_eq!(missing(planned), format!("there is no slice 2: {what}"));
        }
        let size = refused(&Plan::aligned(41, 30, 2), 1, ErrorKind::SizeMismatch);
        assert!(size.ends_with("; use the image size of the calibration"), "{size}");
        let singular = SlicePlan { homography: Homography([0.0; 9]), ..SlicePlan::ALIGNED };
        let plan = Plan { slices: vec![singular; 2], ..Plan::aligned(40, 30, 2) };
        refused(&plan, 1, ErrorKind::InvalidProfile);
    }
}
