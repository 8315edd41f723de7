//! The further lights of a stack: each is fused by the decision of the front light and written like the image.
//!
//! In: the slices of the further lights, and what the front light's fusion left. Out: a file and the metrics of each.
//! One light is in memory at a time.

use super::{
    JobContext, ProgressSink,
    artifact_writer::{ArtifactWriter, WrittenArtifact},
    input_bits::FullScaleSlices,
    output_form::OutputForm,
    stages::Phase,
};
use crate::contract::{JobError, artifact, input::InputBits};
use pinstack_science::{
    archive::{ArchivedSlices, StackArchive},
    fusion::{self, Decision, FusedLight, FusionRequest, Plan},
    imaging::codec,
    quality,
    types::{
        Warning, WarningCode,
        metrics::{AlignmentMetrics, LightMetrics},
    },
};

/// Time that a further light takes, as a share of that of a stack without any.
const SHARE: f64 = 0.5;

/// The further lights of an archive: names, files, and slices scaled to full scale.
pub(super) struct Lights<'a>(Vec<(&'a str, &'a ArchivedSlices, FullScaleSlices<'a>)>);

/// What all further lights are fused and written with.
pub(super) struct Shared<'a> {
    /// The plan of the front light.
    pub plan: &'a Plan,
    /// What the front light's fusion decided; none without further lights.
    pub decision: Option<&'a Decision>,
    /// What the front light was fused with.
    pub request: &'a FusionRequest<'a>,
    /// How the image was written.
    pub form: &'a OutputForm<'a>,
}

/// What the further lights gave.
#[derive(Default)]
pub(super) struct Written {
    pub files: Vec<WrittenArtifact>,
    pub metrics: Vec<LightMetrics>,
    pub warnings: Vec<Warning>,
}

/// The fraction of a job with `lights` further lights at which they begin.
pub(super) fn begin(lights: usize) -> f64 {
    1.0 / (1.0 + SHARE * lights as f64)
}

impl<'a> Lights<'a> {
    /// The further lights of `archive`; 16-bit files use `bits` bits.
    pub(super) fn of(archive: &'a StackArchive, bits: InputBits) -> Self {
        let light =
            |(name, slices): &'a (String, ArchivedSlices)| (name.as_str(), slices, FullScaleSlices::of(slices, bits));
        Self(archive.lights().iter().map(light).collect())
    }

    /// Their slices.
    pub(super) fn slices(&self) -> impl Iterator<Item = &FullScaleSlices<'a>> {
        self.0.iter().map(|(.., slices)| slices)
    }

    /// Fuses and writes all.
    ///
    /// # Errors
    /// [`JobError::Cancelled`]; a fault when a slice cannot be read or a file cannot be written.
    pub(super) fn write(
        &self,
        context: &JobContext,
        shared: &Shared<'_>,
        writer: &ArtifactWriter<'_>,
        sink: &dyn ProgressSink,
    ) -> Result<Written, JobError> {
        let (mut written, count) = (Written::default(), self.0.len());
        let Shared { plan, request, form, .. } = *shared;
        let Some(decision) = shared.decision else { return Ok(written) };
        let at = |done: usize| {
            let begin = begin(count);
            begin + (1.0 - begin) * done as f64 / count as f64
        };
        let stages = plan.for_further_light().method.progress_stages();
        for (done, (name, slices, scaled)) in self.0.iter().enumerate() {
            let control = Phase::new(sink, stages, at(done), at(done + 1));
            let fused = fusion::fuse_further_light(scaled, plan, decision, request, &context.scratch, &control)?;
            let FusedLight { image, alignment } = fused;
            let alignment = alignment.unwrap_or_default();
            written.warnings.extend(misfit(name, &alignment));
            let source = slices.bytes(plan.reference).map(|bytes| codec::metadata(&bytes)).unwrap_or_default();
            let (picture, metadata) = (form.picture(&image), form.metadata(&source));
            drop(image);
            let file = writer.picture(&artifact::light_name(name), form.encoding(), &picture, &metadata)?;
            written.files.push(file);
            written.metrics.push(LightMetrics { name: (*name).to_owned(), alignment });
        }
        Ok(written)
    }
}

/// The warning that the slices of a further light are not where the profile says.
fn misfit(name: &str, alignment: &AlignmentMetrics) -> Option<Warning> {
    let residual = alignment.similarity.as_ref().filter(|residual| quality::is_misfit(residual))?;
    let detail = format!(
        "the slices of the further light {name} do not fit the profile: from the first to the last the corners drift by \
         {:.1} px (+/- {:.1} px), so its picture does not lie on the image; take all lights of a view without touching \
         camera, lens and rail, at the same rail positions and in the same order",
        residual.corner_drift_px,
        2.0 * residual.corner_drift_sigma_px,
    );
    Some(Warning::new(WarningCode::LightMisfit, detail))
}
