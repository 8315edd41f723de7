//! Fusion of a focus stack into one image that is sharp everywhere, in the geometry of the reference slice.
//!
//! In: decoded slices ([`Slices`]) and a [`Plan`] (per slice a homography and a gain; a method). Out: [`Fused`] (the
//! image, the slice index per pixel, the covered area, metrics, warnings).
//!
//! Two passes, common to all methods:
//!
//! 1. *Alignment*, slice by slice, in any order. A slice is decoded, multiplied by its gain, resampled once to the
//!    canvas of the reference slice, and written to a scratch file. A running argmax keeps, per pixel, the largest
//!    focus measure so far and its slice.
//! 2. *Blending*, tile by tile. Each tile reads back the rectangles of the slices that it needs and fuses them.
//!
//! The methods differ in the focus measure of the first pass and in the whole second pass ([`method`] lists the
//! differences):
//!
//! - [`Method::HaloCorrected`], the default: a decision map chooses a slice per pixel. The *defocus spread effect*, the
//!   blur of near parts over far ones (Xu et al., IEEE TCI 2020; Ma et al., IEEE TIP 2020), is removed with the blur
//!   radius that is measured in the stack. Where the decision map is not reliable, the pyramid image is used.
//! - [`Method::Guided`]: guided filtering fusion (Li, Kang & Hu, IEEE TIP 2013), the method of Li & Nguyen (DICTA
//!   2019). Two guided filters smooth the choice of slice into weights for a base and a detail layer.
//! - [`Method::Pyramid`]: Laplacian pyramid fusion (Burt & Adelson, IEEE Trans. Commun. 1983). At each level a slice
//!   counts by the local energy of its detail.
//!
//! If the plan asks for it, a third step measures a height map around the index ([`height`]). Further lights of the
//! same view are fused by the [`Decision`] of the first ([`fuse_further_light`]).
//!
//! Properties of all methods:
//!
//! - Memory ([`Plan::memory_bytes`]) does not grow with the number of slices above 4; the scratch file does
//!   ([`Plan::scratch_bytes`]).
//! - The same input gives the same bytes, for any number of threads and any size of tiles. Pixels that are not shown
//!   ([`FusionRequest::shown`]) may depend on the size of the tiles, and far from those that are shown the index is
//!   less exact: a decision map is refined completely only where it matters.
//! - A pixel that a slice does not cover is never chosen and enters no mean, filter or metric.

mod align;
pub mod crop;
mod further_light;
mod fused;
mod guided;
mod halo_corrected;
pub mod height;
mod in_flight;
mod lock;
pub mod method;
mod metrics;
mod plan;
mod pyramid;
mod resources;
mod run;
mod sample_format;
mod shown;
mod tiles;
mod warped_slice;

#[cfg(test)]
mod tests;

use std::{path::Path, sync::Arc};

use rayon::prelude::*;

pub use further_light::{FusedLight, fuse_further_light};
pub use fused::{Decision, Fused};
pub use in_flight::slices_in_flight;
pub use plan::{FusionRequest, Plan, SlicePlan, UNCOVERED};
pub use warped_slice::warped_slice;

use crate::{
    imaging::{Depth, Plane, Raster, Sample, Slices},
    quality::score::ScoreSums,
    types::{Control, Error, ErrorKind, Interrupted, Warning, WarningCode},
};
use run::Run;
use sample_format::{FormattedSlices, SampleFormat};

#[cfg(doc)]
use crate::types::fusion_options::Method;

/// Fraction of the fused pixels that may be clamped without a warning.
const MAX_CLAMPED_FRACTION: f64 = 0.01;

/// Fuses a stack by the method of `plan`.
///
/// Where no slice shows any detail, the reference slice is used if it covers the pixel, else the first slice that does.
/// The focus measure of a slice counts only where it covers the whole window of the measure; nearer to its border a
/// slice is chosen only if no other can be.
///
/// The result has the bit depth and the channels of the first slice. Grey slices in a stack in colour, and 8-bit slices
/// in a 16-bit stack, are converted; the reverse is refused. The warped slices are kept in an unnamed file in
/// `scratch_dir` until the function returns.
///
/// # Errors
/// [`Interrupted::Cancelled`] if `control` requests it. An error that names the slice if the slice cannot be decoded,
/// has another size or sample format, or has a homography that cannot be inverted. An error if the scratch file cannot
/// be written.
///
/// ```
/// # use pinstack_science::{fusion::{self, FusionRequest, Plan}, imaging::Raster, types::NoControl};
/// // two aligned slices: the first is sharp on the left, the second on the right
/// let slices = [0, 1].map(|half| {
///     let sample = |at: usize| if at % 64 / 32 == half { (at * 7919 % 251) as u8 } else { 125 };
///     Raster::eight(64, 48, 1, (0..64 * 48).map(sample).collect())
/// });
/// let request = FusionRequest { metrics: true, ..FusionRequest::default() };
/// let fused = fusion::fuse(&&slices[..], &Plan::aligned(64, 48, 2), &request, &std::env::temp_dir(), &NoControl)?;
/// assert_eq!((fused.index.at(8, 24), fused.index.at(56, 24)), (0, 1));
/// assert_eq!(fused.quality.expect("the metrics were requested").slices.len(), 2);
/// # Ok::<(), pinstack_science::types::Interrupted>(())
/// ```
pub fn fuse(
    slices: &dyn Slices,
    plan: &Plan,
    request: &FusionRequest<'_>,
    scratch_dir: &Path,
    control: &dyn Control,
) -> Result<Fused, Interrupted> {
    plan.check(slices.count())?;
    request.check(plan)?;
    control.check()?;
    control.progress("aligning", 0, slices.count());
    let slices = FormattedSlices::open(slices, plan)?;
    Run { slices, plan, request, scratch_dir, control, tile: tiles::TILE, decision_map: None }.fuse()
}

/// [`fuse`] by [`Method::HaloCorrected`](crate::types::fusion_options::Method::HaloCorrected) with a given decision map
/// instead of the one that is found in the stack; other methods ignore it.
///
/// For benches: with the true decision map the result tells how much a better decision map can gain.
/// `decision_map` is of the size of the canvas and contains 0-based indices of slices. Where that slice does not cover
/// the pixel, or is not in the stack, the sharpest slice is used.
///
/// # Errors
/// As [`fuse`], and if the size of the decision map is not that of the canvas.
#[doc(hidden)]
pub fn fuse_by_decision_map(
    slices: &dyn Slices,
    plan: &Plan,
    decision_map: &Plane<u16>,
    scratch_dir: &Path,
    control: &dyn Control,
) -> Result<Fused, Interrupted> {
    let request = &FusionRequest::default();
    plan.check(slices.count())?;
    if (decision_map.width, decision_map.height) != (plan.width, plan.height) {
        return Err(Error::new(ErrorKind::Internal, "the decision map does not have the size of the canvas").into());
    }
    let slices = FormattedSlices::open(slices, plan)?;
    let decision_map = Some(decision_map);
    Run { slices, plan, request, scratch_dir, control, tile: tiles::TILE, decision_map }.fuse()
}

impl Run<'_> {
    fn fuse(&self) -> Result<Fused, Interrupted> {
        match self.slices.format() {
            SampleFormat { depth: Depth::Eight, channels: 1 } => self.fuse_as::<u8, 1>(),
            SampleFormat { depth: Depth::Eight, .. } => self.fuse_as::<u8, 3>(),
            SampleFormat { depth: Depth::Sixteen, channels: 1 } => self.fuse_as::<u16, 1>(),
            SampleFormat { depth: Depth::Sixteen, .. } => self.fuse_as::<u16, 3>(),
        }
    }

    /// Fuses slices of `C` channels of kind `S`.
    fn fuse_as<S: Sample, const C: usize>(&self) -> Result<Fused, Interrupted> {
        let meter = metrics::slice_meter(self);
        let mut aligned = align::align::<S, C>(self, method::focus_measure(self.plan), meter.as_ref())?;
        let alignment = metrics::alignment::<S>(self, &aligned)?;
        let (blended, decision) = method::second_pass::<S, C>(self, &mut aligned)?;
        let decision = Some(decision).filter(|_| self.request.decision);
        let height_map = height::measure::<S, C>(self, &aligned)?;
        let scores = match &meter {
            Some(meter) => metrics::score::<S, C>(self, &aligned, meter.blocks(), &blended.pixels)?,
            None => ScoreSums::default(),
        };

        let valid = aligned.index.par_map(|slice| if slice == UNCOVERED { 0 } else { 255 });
        let quality = metrics::finish(self, meter.as_ref(), aligned.measurements, &scores, alignment, &aligned.index);
        let (width, height) = (self.plan.width, self.plan.height);
        let covered = valid.data.par_iter().filter(|&&v| v != 0).count();
        let image = Raster { width, height, channels: C, samples: S::wrap(blended.pixels) };
        let mut warnings = warnings(width * height, covered, blended.clamped);
        warnings.extend(blended.contradicts_profile.then(|| depth_order_disagrees(self.plan)));
        let index = Arc::unwrap_or_clone(aligned.index);
        Ok(Fused { image, index, height_map, valid, quality, decision, warnings })
    }
}

/// The warning about a stack whose depth steps contradict the near end of the plan.
fn depth_order_disagrees(plan: &Plan) -> Warning {
    let (near, other) = if plan.near_first == Some(true) { ("first", "last") } else { ("last", "first") };
    let detail = format!(
        "by the profile the {near} slice is focused nearest to the camera, but the outlines in the stack show that the \
         {other} one is; if halos beside outlines are worse than with method=pyramid, set or correct \
         capture_mode in the profile, or the order of the slices"
    );
    Warning::new(WarningCode::DepthOrderDisagrees, detail)
}

/// The warnings about a canvas of `pixels` px, of which `covered` are covered, and whose fused pixels have a clamped
/// sample in the fraction `clamped`.
fn warnings(pixels: usize, covered: usize, clamped: f64) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if covered < pixels {
        let percent = 100.0 * (pixels - covered) as f64 / pixels as f64;
        warnings.push(Warning::new(
            WarningCode::CanvasNotCovered,
            format!(
                "{percent:.2} % of the canvas is covered by no slice and is transparent; use crop=valid to cut \
                 it off"
            ),
        ));
    }
    if clamped > MAX_CLAMPED_FRACTION {
        warnings.push(Warning::new(
            WarningCode::FusionOvershoot,
            format!(
                "{:.1} % of the fused pixels were outside the range of their bit depth and were clamped; check the \
                 image for halos, or expose the slices so that fewer pixels are near black or white",
                100.0 * clamped
            ),
        ));
    }
    warnings
}
