//! What the methods differ in: one exhaustive `match` per question, so that the compiler lists what a new method must
//! answer.
//!
//! | question | guided | pyramid | halo-corrected |
//! |---|---|---|---|
//! | focus measure of the first pass | saliency | saliency | focus energy, with the coarse focus |
//! | second pass | `guided` | `pyramid` | `halo_corrected`, which fuses by pyramids too |
//! | meaning of [`Fused::index`](super::Fused::index) | largest saliency | largest saliency | decision map |
//! | extra memory of the second pass | none | none | decision map and pyramid image |
//! | method of the back light | guided | pyramid | pyramid |

use super::{
    align::{Aligned, focus_measure::FocusMeasure},
    guided, halo_corrected,
    plan::Plan,
    pyramid,
    run::Run,
    shown,
    tiles::Blended,
};
use crate::{
    imaging::Sample,
    types::{
        Error, ErrorKind, Interrupted,
        fusion_options::{GuidedParams, Method},
    },
};

/// A stage of progress as [`Control::progress`](crate::types::Control::progress) reports it, and its share of the time.
pub type ProgressStage = (&'static str, f64);

impl Method {
    /// The stages of progress that [`fuse`](super::fuse) reports, in order.
    pub fn progress_stages(self) -> &'static [ProgressStage] {
        match self {
            Self::Guided | Self::Pyramid => &[("aligning", 3.0), ("fusing", 2.0)],
            Self::HaloCorrected => &[("aligning", 3.0), ("fusing", 3.0), ("correcting halos", 3.0)],
        }
    }

    /// The method that fuses the back light of a stack whose front light is fused by this one.
    ///
    /// The method of Li & Nguyen (2019) fuses both lights by guided filtering. Otherwise pyramids are used: they keep
    /// more of the hairs of a silhouette, and black against white has no halo to correct.
    #[must_use]
    pub fn for_back_light(self) -> Self {
        match self {
            Self::Guided => Self::Guided,
            Self::Pyramid | Self::HaloCorrected => Self::Pyramid,
        }
    }

    /// Whether the parameters of guided filtering are parameters of this method.
    pub fn uses_guided_params(self) -> bool {
        match self {
            Self::Guided => true,
            Self::Pyramid | Self::HaloCorrected => false,
        }
    }

    /// Whether [`Fused::index`](super::Fused::index) is a refined decision map; otherwise it is the slice with the
    /// largest focus measure.
    pub(super) fn refines_the_index(self) -> bool {
        match self {
            Self::Guided | Self::Pyramid => false,
            Self::HaloCorrected => true,
        }
    }
}

/// The focus measure by which the first pass compares slices.
pub(super) fn focus_measure(plan: &Plan) -> FocusMeasure {
    match plan.method {
        Method::Guided => FocusMeasure::saliency(&plan.params),
        // the parameters are those of guided filtering alone
        Method::Pyramid => FocusMeasure::saliency(&GuidedParams::default()),
        Method::HaloCorrected => FocusMeasure::energy(plan.width, plan.height, plan.slices.len()),
    }
}

/// Whether the first pass measures the coarse focus.
pub(super) fn has_coarse_focus(method: Method) -> bool {
    match method {
        Method::Guided | Method::Pyramid => false,
        Method::HaloCorrected => true,
    }
}

/// Bytes per pixel of the canvas that the second pass holds beside the index and the fused image, for pixels of `pixel`
/// bytes.
pub(super) fn extra_bytes_per_pixel(method: Method, pixel: u64) -> u64 {
    match method {
        Method::Guided | Method::Pyramid => 0,
        Method::HaloCorrected => 10 + pixel,
    }
}

/// Runs the second pass. Where a method refines the index, `aligned.index` is replaced.
pub(super) fn second_pass<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &mut Aligned,
) -> Result<Blended<S>, Interrupted> {
    match run.plan.method {
        Method::Guided => guided::blend::<S, C>(run, aligned),
        Method::Pyramid => pyramid::blend::<S, C>(run, aligned, None, shown::MARGIN),
        Method::HaloCorrected => {
            let no_energy = || Error::new(ErrorKind::Internal, "the first pass has not measured the focus energy");
            let energy = aligned.energy.take().ok_or_else(no_energy)?;
            halo_corrected::fuse::<S, C>(run, aligned, energy)
        }
    }
}
