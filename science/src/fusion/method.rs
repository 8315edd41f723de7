//! What the methods differ in: one row per method. The compiler asks for the row of a new one.

use super::{
    align::{Aligned, focus_measure::FocusMeasure},
    guided,
    halo_corrected::{self, Decision},
    plan::Plan,
    pyramid,
    run::Run,
    shown,
    tiles::Blended,
};
use crate::{
    imaging::Sample,
    types::{
        Interrupted,
        fusion_options::{GuidedParams, Method},
    },
};

/// A stage of progress as [`Control::progress`](crate::types::Control::progress) reports it, and its share of the time.
pub type ProgressStage = (&'static str, f64);

/// What a method is, for samples of kind `S`.
struct Row<S> {
    name: &'static str,
    title: &'static str,
    progress_stages: &'static [ProgressStage],
    back_light: Method,
    uses_guided_params: bool,
    /// The focus measure by which the first pass compares slices.
    focus_measure: fn(&Plan) -> FocusMeasure,
    /// Whether that is the focus energy, with the coarse focus.
    has_coarse_focus: bool,
    refines_the_index: bool,
    /// Bytes per pixel of the canvas that the second pass holds beside the index and the fused image, for pixels of as
    /// many bytes.
    extra_bytes_per_pixel: fn(u64) -> u64,
    /// Where a method refines the index, this replaces that of the first pass.
    second_pass: SecondPass<S>,
}

/// A second pass: gives the image, and what further lights are fused by.
type SecondPass<S> = fn(&Run<'_>, &mut Aligned) -> Result<(Blended<S>, Decision), Interrupted>;

fn row<S: Sample, const C: usize>(method: Method) -> Row<S> {
    match method {
        Method::Guided => Row {
            name: "guided",
            title: "guided filter (paper)",
            progress_stages: &[("aligning", 3.0), ("fusing", 2.0)],
            back_light: Method::Guided,
            uses_guided_params: true,
            focus_measure: |plan| FocusMeasure::saliency(&plan.params),
            has_coarse_focus: false,
            refines_the_index: false,
            extra_bytes_per_pixel: |_| 0,
            second_pass: |run, aligned| Ok((guided::blend::<S, C>(run, aligned)?, by_sharpest(aligned))),
        },
        Method::Pyramid => Row {
            name: "pyramid",
            title: "pyramid",
            progress_stages: &[("aligning", 3.0), ("fusing", 2.0)],
            back_light: Method::Pyramid,
            uses_guided_params: false,
            focus_measure: |_| FocusMeasure::saliency(&GuidedParams::default()),
            has_coarse_focus: false,
            refines_the_index: false,
            extra_bytes_per_pixel: |_| 0,
            second_pass: |run, aligned| {
                Ok((pyramid::blend::<S, C>(run, aligned, None, shown::MARGIN)?, by_sharpest(aligned)))
            },
        },
        Method::HaloCorrected => Row {
            name: "halo_corrected",
            title: "halo corrected",
            progress_stages: &[("aligning", 3.0), ("fusing", 3.0), ("correcting halos", 3.0)],
            back_light: Method::Pyramid,
            uses_guided_params: false,
            focus_measure: |plan| FocusMeasure::energy(plan.width, plan.height, plan.slices.len()),
            has_coarse_focus: true,
            refines_the_index: true,
            // decision map and pyramid image
            extra_bytes_per_pixel: |pixel| 10 + pixel,
            second_pass: halo_corrected::fuse::<S, C>,
        },
    }
}

impl Method {
    /// The row of the method as far as it is the same for all samples.
    fn row(self) -> Row<u8> {
        row::<u8, 1>(self)
    }

    /// The name of the method in requests and reports.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The name of the method on pages for people.
    pub fn title(self) -> &'static str {
        self.row().title
    }

    /// The stages of progress that [`fuse`](super::fuse) reports, in order.
    pub fn progress_stages(self) -> &'static [ProgressStage] {
        self.row().progress_stages
    }

    /// The method that fuses the back light of a stack whose front light is fused by this one.
    ///
    /// The method of Li & Nguyen (2019) fuses both lights by guided filtering. Otherwise pyramids are used: they keep
    /// more of the hairs of a silhouette, and black against white has no halo to correct.
    #[must_use]
    pub fn for_back_light(self) -> Self {
        self.row().back_light
    }

    /// Whether the parameters of guided filtering are parameters of this method.
    pub fn uses_guided_params(self) -> bool {
        self.row().uses_guided_params
    }

    /// Whether [`Fused::index`](super::Fused::index) is a refined decision map; otherwise it is the slice with the
    /// largest focus measure.
    pub(super) fn refines_the_index(self) -> bool {
        self.row().refines_the_index
    }

    /// Whether the first pass measures the coarse focus.
    pub(super) fn has_coarse_focus(self) -> bool {
        self.row().has_coarse_focus
    }

    /// Bytes per pixel of the canvas that the second pass holds beside the index and the fused image, for pixels of
    /// `pixel` bytes.
    pub(super) fn extra_bytes_per_pixel(self, pixel: u64) -> u64 {
        (self.row().extra_bytes_per_pixel)(pixel)
    }
}

/// What the further lights of a method without a decision map are fused by.
fn by_sharpest(aligned: &Aligned) -> Decision {
    Decision::by_sharpest(&aligned.index, aligned.coverages.len())
}

/// The focus measure by which the first pass compares slices.
pub(super) fn focus_measure(plan: &Plan) -> FocusMeasure {
    (plan.method.row().focus_measure)(plan)
}

/// Runs the second pass; returns the image, and what further lights are fused by. Where a method refines the index,
/// `aligned.index` is replaced.
pub(super) fn second_pass<S: Sample, const C: usize>(
    run: &Run<'_>,
    aligned: &mut Aligned,
) -> Result<(Blended<S>, Decision), Interrupted> {
    (row::<S, C>(run.plan.method).second_pass)(run, aligned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_methods_are_listed_by_the_names_that_requests_have() {
        let parsed = |name: &str| serde_json::from_value::<Method>(name.into());
        for method in Method::ALL {
            assert_eq!(parsed(method.name()).expect("a method"), method);
        }
        // the error lists the names of all methods in backticks
        let error = parsed("").expect_err("no method has an empty name").to_string();
        let known: Vec<Method> = error.split('`').filter_map(|word| parsed(word).ok()).collect();
        assert!(known.len() >= Method::ALL.len() && known.iter().all(|method| Method::ALL.contains(method)), "{error}");
    }
}
