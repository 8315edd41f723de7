//! Further lights of a fused view: each is fused by the [`Decision`] of the front light.
//!
//! In: the slices of a further light, the plan and the decision of the front light. Out: a picture in which each pixel
//! shows the same slices as in the front light's, and how well the slices are aligned. Photometric stereo,
//! fluorescence and polarisation compare the lights pixel by pixel, so they must not choose slices by their own
//! detail: a light that shows no detail would choose at random.
//!
//! The first pass is that of [`Method::Guided`], which keeps least in memory; what it finds sharpest is not used.

use std::path::Path;

use super::{
    align,
    fused::Decision,
    method, metrics,
    plan::{FusionRequest, Plan},
    run::Run,
    sample_format::{FormattedSlices, SampleFormat},
    tiles,
};
use crate::{
    imaging::{Depth, Raster, Sample, Slices},
    types::{Control, Error, ErrorKind, Interrupted, fusion_options::Method, metrics::AlignmentMetrics},
};

/// A fused further light.
#[derive(Debug, Clone, PartialEq)]
pub struct FusedLight {
    /// The picture, on the canvas of the front light, in the bit depth and the channels of the first slice of this
    /// light. Black where no slice covers the canvas.
    pub image: Raster,
    /// The residual shifts between the slices of this light, if the metrics were requested.
    pub alignment: Option<AlignmentMetrics>,
}

impl Plan {
    /// The plan by which a further light is aligned: the same geometry and gains, without a height map.
    #[must_use]
    pub fn for_further_light(&self) -> Self {
        Self { method: Method::Guided, height_map: None, ..self.clone() }
    }
}

/// Fuses a further light by the `decision` that [`fuse`](super::fuse) made for the front light with `plan`; `request`
/// is that of the front light. Memory: [`Plan::memory_bytes`] of [`Plan::for_further_light`], and the decision.
///
/// Slices that flicker are equalised as in [`fuse`](super::fuse). The gains of the plan are those of the camera, so
/// they apply to all lights.
///
/// # Errors
/// As [`fuse`](super::fuse); [`ErrorKind::Internal`] for a decision of another canvas or number of slices.
///
/// ```
/// # use pinstack_science::{fusion::{self, FusionRequest, Plan}, imaging::Raster, types::NoControl};
/// // two slices: the first is sharp on the left, the second on the right
/// let front = [0, 1].map(|half| {
///     let sample = |at: usize| if at % 64 / 32 == half { (at * 7919 % 251) as u8 } else { 125 };
///     Raster::eight(64, 48, 1, (0..64 * 48).map(sample).collect())
/// });
/// // another light shows no detail, but it is brighter in the second slice
/// let left = [60, 90].map(|grey| Raster::eight(64, 48, 1, vec![grey; 64 * 48]));
/// let (plan, folder) = (Plan::aligned(64, 48, 2), std::env::temp_dir());
/// let request = FusionRequest { decision: true, ..FusionRequest::default() };
/// let fused = fusion::fuse(&&front[..], &plan, &request, &folder, &NoControl)?;
/// let decision = fused.decision.expect("it was requested");
/// let light = fusion::fuse_further_light(&&left[..], &plan, &decision, &request, &folder, &NoControl)?;
/// assert_eq!((light.image.luma().at(8, 24), light.image.luma().at(56, 24)), (60.0, 90.0));
/// # Ok::<(), pinstack_science::types::Interrupted>(())
/// ```
pub fn fuse_further_light(
    slices: &dyn Slices,
    plan: &Plan,
    decision: &Decision,
    request: &FusionRequest<'_>,
    scratch_dir: &Path,
    control: &dyn Control,
) -> Result<FusedLight, Interrupted> {
    plan.check(slices.count())?;
    request.check(plan)?;
    if decision.size() != (plan.width, plan.height) || decision.slices() != plan.slices.len() {
        return Err(Error::new(ErrorKind::Internal, "the decision of the front light is of another stack").into());
    }
    control.check()?;
    control.progress("aligning", 0, slices.count());
    let plan = &plan.for_further_light();
    let slices = FormattedSlices::open(slices, plan)?;
    let run = Run { slices, plan, request, scratch_dir, control, tile: tiles::TILE, decision_map: None };
    match run.slices.format() {
        SampleFormat { depth: Depth::Eight, channels: 1 } => fuse_as::<u8, 1>(&run, decision),
        SampleFormat { depth: Depth::Eight, .. } => fuse_as::<u8, 3>(&run, decision),
        SampleFormat { depth: Depth::Sixteen, channels: 1 } => fuse_as::<u16, 1>(&run, decision),
        SampleFormat { depth: Depth::Sixteen, .. } => fuse_as::<u16, 3>(&run, decision),
    }
}

fn fuse_as<S: Sample, const C: usize>(run: &Run<'_>, decision: &Decision) -> Result<FusedLight, Interrupted> {
    let aligned = align::align::<S, C>(run, method::focus_measure(run.plan), None)?;
    let alignment = run.request.metrics.then(|| metrics::alignment::<S>(run, &aligned)).transpose()?;
    let pixels = decision.blend::<S, C>(run, &aligned)?.pixels;
    let (width, height) = (run.plan.width, run.plan.height);
    let image = Raster { width, height, channels: C, samples: S::wrap(pixels) };
    Ok(FusedLight { image, alignment: alignment.map(|alignment| alignment.metrics) })
}
