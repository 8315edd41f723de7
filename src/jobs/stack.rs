//! Fuses one stack: archive -> back light and silhouette -> front light -> artifacts.
//!
//! In: the zip, a profile, the options. Out: image, preview, mask, fused back light, depth index, height map, further
//! lights and metrics. The science does the work; this module decides what is computed, reports the progress, and
//! collects the warnings.

use std::{sync::Arc, time::Instant};

use super::{
    JobContext, JobOutput, ProgressSink, SOFTWARE,
    artifact_writer::{ArtifactWriter, WrittenArtifact},
    crop::crop_rect,
    diagnosis,
    input_bits::{self, FullScaleSlices},
    lights::{self, Lights, Shared},
    output_form::OutputForm,
    pictures::{self, Pictures},
    requested::{self, height_info, mask_params},
    stages::Phase,
};
use crate::contract::{
    Code, Fault, JobError,
    artifact::StackArtifact,
    options::{HeightMode, MaskMode, StackOptions},
    outcome::{JobOutcome, StackOutcome},
    request::StackRequest,
};
use pinstack_science::{
    archive::{ArchiveLimits, StackArchive},
    fusion::{self, Decision, Fused, FusionRequest, Plan},
    imaging::{
        Raster, Rect, Slices,
        codec::{self, Metadata},
        grey_slices::{GreySlices, GreyValue},
    },
    quality::{StackQuality, VERSIONS},
    segmentation::{Silhouette, segment},
    types::{
        Control, Warning, WarningCode,
        fusion_options::GuidedParams,
        metrics::{Metrics, Severity, StageTime, Timing},
    },
};

/// Fractions of the job at which reading ends and writing begins.
const READ: f64 = 0.02;
const FUSED: f64 = 0.9;
/// Warnings of the back light's fusion that do not concern the silhouette: its white ground is saturated on purpose,
/// and what it does not cover, the front light does not cover either.
const IGNORED_FOR_BACK_LIGHT: [WarningCode; 2] = [WarningCode::FusionOvershoot, WarningCode::CanvasNotCovered];

/// Runs the job.
///
/// # Errors
/// [`JobError::Cancelled`]; a fault with the name of the file when a slice cannot be read; [`Code::MaskFailed`] when a
/// required mask cannot be made; [`Code::InsufficientStorage`] when the disk is full.
pub fn run(
    context: &JobContext,
    request: &StackRequest,
    limits: &ArchiveLimits,
    sink: &dyn ProgressSink,
) -> Result<JobOutput, JobError> {
    let profile = context
        .profile
        .as_ref()
        .ok_or_else(|| Fault::new(Code::ProfileNotFound, "the profile revision of this stack is missing; store or calibrate the profile again, then send the stack again"))?;
    let options = &request.options;
    let mut times = Times::since(context.started);
    let mut warnings = Vec::new();

    // archive
    let further_lights = lights::begin(request.layout.lights.len());
    let [read, fused] = [READ, FUSED].map(|at| at * further_lights);
    let reading = Phase::new(sink, &[("reading", 1.0)], 0.0, read);
    reading.progress("reading", 0, 1);
    let archive = requested::checked_archive(Arc::clone(&context.archive), options, limits, &reading)?;
    let full_scale = |slices| FullScaleSlices::of(slices, options.input_bits);
    let (front_slices, back_slices) = (full_scale(archive.front()), full_scale(archive.back()));
    let lights = Lights::of(&archive, options.input_bits);
    warnings.extend_from_slice(archive.warnings());
    let rect = crop_rect(options.crop, &profile.input)?;
    let plan = requested::plan(options, &profile.input);
    warnings.extend(unused_parameters(&plan));
    reading.progress("reading", 1, 1);
    times.end("reading");

    let writer = ArtifactWriter::new(context, sink);
    let mut written = Vec::new();

    // back light and silhouette
    let with_back = wants_mask(options.mask, &archive)?;
    let middle = if with_back { f64::midpoint(read, fused) } else { read };
    let back_light = if with_back {
        let of = BackLight { slices: &back_slices, plan: &plan, rect, options };
        Some(of.fuse(context, &writer, (sink, read, middle), &mut times)?)
    } else {
        None
    };
    let (silhouette, reduced) = match back_light {
        Some(fused) => {
            written.push(fused.file);
            warnings.extend(fused.warnings);
            (Some(fused.silhouette), Some(fused.reduced))
        }
        None => (None, None),
    };

    // front light; what the mask hides is not fused
    let plan = match options.height {
        HeightMode::None => plan,
        HeightMode::Auto => plan.with_height_map(&profile.input),
    };
    let control = Phase::new(sink, plan.method.progress_stages(), middle, fused);
    let wanted = FusionRequest {
        metrics: true,
        object: silhouette.as_ref().map(|s| &s.mask),
        shown: silhouette.as_ref().filter(|_| !options.under_alpha.is_fused_colour()).map(Silhouette::image_alpha),
        decision: lights.slices().next().is_some(),
    };
    let front = fusion::fuse(&front_slices, &plan, &wanted, &context.scratch, &control)?;
    warnings.extend_from_slice(&front.warnings);
    diagnosis::examine(&front.image, reduced.as_ref(), options.mask, &control, &mut warnings)?;
    times.end("fusing");

    // artifacts
    let source = archive.front_bytes(plan.reference).map(|bytes| codec::metadata(&bytes)).unwrap_or_default();
    warnings.extend(pictures::dropped_focal_length(&source, &profile.input));
    let writing = Phase::new(sink, &[("writing", 1.0)], fused, further_lights);
    let form = OutputForm::of(&front.valid, silhouette.as_ref(), rect, options, &profile.input);
    let pictures = Pictures { front: &front, silhouette: silhouette.as_ref(), form: &form };
    let (image, files) = pictures.write(&writer, &writing, &source)?;
    written.extend(files);
    times.end("writing");

    // further lights
    let height = front.height_map.as_ref().map(height_info);
    let (decision, quality) = remaining(front);
    let shared = Shared { plan: &plan, decision: decision.as_ref(), request: &wanted, form: &form };
    let of_lights = lights.write(context, &shared, &writer, sink)?;
    written.extend(of_lights.files);
    warnings.extend(of_lights.warnings);
    times.end_if(wanted.decision, "fusing further lights");
    let loaded: Vec<_> = [&front_slices, &back_slices].into_iter().chain(lights.slices()).collect();
    warnings.extend(input_bits::warning(&loaded));

    let metrics = Metrics { lights: of_lights.metrics, ..metrics(quality, silhouette, times) };
    // notes stay in the metrics; only findings of the severity `warning` are warnings of the job
    let serious = metrics.findings.iter().filter(|finding| finding.severity == Severity::Warning);
    warnings.extend(serious.map(|finding| Warning::new(finding.code.clone(), finding.detail.clone())));
    let (artifacts, files) = written.into_iter().unzip();
    let software = Some(SOFTWARE.to_owned());
    let outcome = JobOutcome::Stack(StackOutcome { artifacts, image, height, metrics, software });
    Ok(JobOutput { outcome, warnings: without_repetitions(warnings), profile: None, files })
}

/// The back light before it is fused.
struct BackLight<'a> {
    slices: &'a FullScaleSlices<'a>,
    plan: &'a Plan,
    /// The part of the canvas that is written.
    rect: Rect,
    options: &'a StackOptions,
}

/// The fused back light.
struct FusedBackLight {
    silhouette: Silhouette,
    /// For the diagnosis.
    reduced: Raster,
    file: WrittenArtifact,
    warnings: Vec<Warning>,
}

impl BackLight<'_> {
    /// Fuses, segments and writes it, from one fraction of the job to another.
    fn fuse(
        &self,
        context: &JobContext,
        writer: &ArtifactWriter<'_>,
        (sink, from, to): (&dyn ProgressSink, f64, f64),
        times: &mut Times,
    ) -> Result<FusedBackLight, JobError> {
        let &Self { slices, plan, rect, options } = self;
        let plan = Plan { method: plan.method.for_back_light(), ..plan.clone() };
        let control = Phase::new(sink, plan.method.progress_stages(), from, to);
        // only brightness counts; green is where the geometry of the profile holds
        let grey_value = if plan.lateral_colour.is_some() { GreyValue::Green } else { GreyValue::Luma };
        let grey = GreySlices::of(slices, grey_value);
        let back = fusion::fuse(&grey, &plan, &FusionRequest::default(), &context.scratch, &control)?;
        times.end("fusing the back light");
        let phase = Phase::new(sink, &[("masking", 1.0)], to, to);
        phase.progress("masking", 0, 1);
        let (silhouette, file) = rayon::join(
            || segment(&back.image, &back.valid, &mask_params(options, plan.width, plan.height)),
            || writer.png(StackArtifact::Backlight.name(), &back.image.crop(rect), &Metadata::default()),
        );
        if options.mask == MaskMode::Required {
            require_useful(&silhouette)?;
        }
        let reduced = diagnosis::reduced_back_light(&back.image);
        let mut warnings = back.warnings;
        warnings.retain(|warning| !IGNORED_FOR_BACK_LIGHT.contains(&warning.code));
        warnings.extend_from_slice(&silhouette.warnings);
        phase.progress("masking", 1, 1);
        times.end("masking");
        Ok(FusedBackLight { silhouette, reduced, file: file?, warnings })
    }
}

/// The warning that parameters of guided filtering were set for another method, where they have no effect.
fn unused_parameters(plan: &Plan) -> Option<Warning> {
    let unused = !plan.method.uses_guided_params() && plan.params != GuidedParams::default();
    unused.then(|| {
        Warning::new(
            WarningCode::UnusedParameters,
            "r1, eps1, r2, eps2, average, r_g and sigma_g are parameters of method=guided and have no effect on the method \
             of this stack; send method=guided to use them",
        )
    })
}

fn wants_mask(mode: MaskMode, archive: &StackArchive) -> Result<bool, Fault> {
    let has_back = archive.back().count() > 0;
    match mode {
        MaskMode::None => Ok(false),
        MaskMode::Auto => Ok(has_back),
        MaskMode::Required if has_back => Ok(true),
        MaskMode::Required => Err(Fault::new(
            Code::MaskFailed,
            "mask=required, but the archive has no back-light slices; put them into a folder back/, or send mask=auto",
        )),
    }
}

/// Refuses an empty or full mask where a mask is required.
fn require_useful(silhouette: &Silhouette) -> Result<(), Fault> {
    let is_fatal = |warning: &&Warning| matches!(warning.code, WarningCode::MaskEmpty | WarningCode::MaskFull);
    match silhouette.warnings.iter().find(is_fatal) {
        None => Ok(()),
        Some(warning) => {
            let detail = format!("mask=required, but no mask can be made: {}", warning.detail);
            Err(Fault::new(Code::MaskFailed, detail))
        }
    }
}

/// What is needed of the front light once it is written; the rest is freed.
fn remaining(front: Fused) -> (Option<Decision>, StackQuality) {
    (front.decision, front.quality.unwrap_or_default())
}

fn metrics(quality: StackQuality, silhouette: Option<Silhouette>, times: Times) -> Metrics {
    Metrics {
        fusion: quality.fusion,
        focus: quality.focus,
        slices: quality.slices,
        alignment: quality.alignment,
        lights: Vec::new(),
        mask: silhouette.map(|silhouette| silhouette.metrics),
        findings: quality.findings,
        versions: VERSIONS.map(str::to_owned).to_vec(),
        timing_ms: times.done(),
    }
}

/// Each warning once, in the order of its first occurrence.
fn without_repetitions(warnings: Vec<Warning>) -> Vec<Warning> {
    let mut seen = Vec::with_capacity(warnings.len());
    for warning in warnings {
        if !seen.contains(&warning) {
            seen.push(warning);
        }
    }
    seen
}

/// Measures how long each stage takes.
struct Times {
    start: Instant,
    last: Instant,
    stages: Vec<StageTime>,
}

impl Times {
    fn since(start: Instant) -> Self {
        Self { start, last: Instant::now(), stages: Vec::new() }
    }

    fn end(&mut self, stage: &str) {
        let now = Instant::now();
        self.stages.push(StageTime { stage: stage.to_owned(), ms: ms(now - self.last) });
        self.last = now;
    }

    /// As [`Self::end`], for a stage that not every stack has.
    fn end_if(&mut self, has_stage: bool, stage: &str) {
        if has_stage {
            self.end(stage);
        }
    }

    fn done(self) -> Timing {
        Timing { total: ms(self.start.elapsed()), stages: self.stages }
    }
}

fn ms(duration: std::time::Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
