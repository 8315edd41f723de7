//! Fuses one stack: archive -> back light and silhouette -> front light -> artifacts.
//!
//! In: the zip, a profile, the options. Out: image, preview, mask, fused back light, depth index, height map and
//! metrics. The science does the work; this module decides what is computed, reports the progress, and collects the
//! warnings.

use std::{sync::Arc, time::Instant};

use super::{
    JobContext, JobOutput, ProgressSink, SOFTWARE,
    artifact_writer::ArtifactWriter,
    crop::crop_rect,
    diagnosis,
    input_bits::{self, FullScaleSlices},
    pictures::{self, Pictures},
    requested::{self, height_info, mask_params},
    stages::Phase,
};
use crate::contract::{
    Code, Fault, JobError,
    artifact::StackArtifact,
    options::{HeightMode, MaskMode},
    outcome::{JobOutcome, StackOutcome},
    request::StackRequest,
};
use pinstack_science::{
    archive::{ArchiveLimits, StackArchive},
    fusion::{self, Fused, FusionRequest, Plan},
    imaging::{
        Slices,
        codec::{self, Metadata},
        grey_slices::{GreySlices, GreyValue},
    },
    quality::VERSIONS,
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
    let reading = Phase::new(sink, &[("reading", 1.0)], 0.0, READ);
    reading.progress("reading", 0, 1);
    let archive = requested::checked_archive(Arc::clone(&context.archive), options, limits, &reading)?;
    let [front_slices, back_slices] =
        [archive.front(), archive.back()].map(|slices| FullScaleSlices::of(slices, options.input_bits));
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
    let middle = if with_back { f64::midpoint(READ, FUSED) } else { READ };
    let mut back_light = None;
    let silhouette = if with_back {
        let back = Plan { method: plan.method.for_back_light(), ..plan.clone() };
        let control = Phase::new(sink, back.method.progress_stages(), READ, middle);
        // only brightness counts; green is where the geometry of the profile holds
        let grey_value = if back.lateral_colour.is_some() { GreyValue::Green } else { GreyValue::Luma };
        let grey = GreySlices::of(&back_slices, grey_value);
        let back = fusion::fuse(&grey, &back, &FusionRequest::default(), &context.scratch, &control)?;
        times.end("fusing the back light");
        let phase = Phase::new(sink, &[("masking", 1.0)], middle, middle);
        phase.progress("masking", 0, 1);
        let (silhouette, artifact) = rayon::join(
            || segment(&back.image, &back.valid, &mask_params(options, plan.width, plan.height)),
            || writer.png(StackArtifact::Backlight.name(), &back.image.crop(rect), &Metadata::default()),
        );
        if options.mask == MaskMode::Required {
            require_useful(&silhouette)?;
        }
        written.push(artifact?);
        warnings.extend(back.warnings.into_iter().filter(|w| !IGNORED_FOR_BACK_LIGHT.contains(&w.code)));
        warnings.extend_from_slice(&silhouette.warnings);
        back_light = Some(diagnosis::reduced_back_light(&back.image));
        phase.progress("masking", 1, 1);
        times.end("masking");
        Some(silhouette)
    } else {
        None
    };

    // front light; what the mask hides is not fused
    let plan = match options.height {
        HeightMode::None => plan,
        HeightMode::Auto => plan.with_height_map(&profile.input),
    };
    let control = Phase::new(sink, plan.method.progress_stages(), middle, FUSED);
    let wanted = FusionRequest {
        metrics: true,
        object: silhouette.as_ref().map(|s| &s.mask),
        shown: silhouette.as_ref().filter(|_| !options.under_alpha.is_fused_colour()).map(Silhouette::image_alpha),
    };
    let front = fusion::fuse(&front_slices, &plan, &wanted, &context.scratch, &control)?;
    warnings.extend_from_slice(&front.warnings);
    diagnosis::examine(&front.image, back_light.as_ref(), options.mask, &control, &mut warnings)?;
    warnings.extend(input_bits::warning(&[&front_slices, &back_slices]));
    times.end("fusing");

    // artifacts
    let source = archive.front_bytes(plan.reference).map(|bytes| codec::metadata(&bytes)).unwrap_or_default();
    warnings.extend(pictures::dropped_focal_length(&source, &profile.input));
    let writing = Phase::new(sink, &[("writing", 1.0)], FUSED, 1.0);
    let pictures = Pictures { front: &front, silhouette: silhouette.as_ref(), rect, options, profile: &profile.input };
    let (image, files) = pictures.write(&writer, &writing, &source)?;
    written.extend(files);
    times.end("writing");

    let height = front.height_map.as_ref().map(height_info);
    let metrics = metrics(front, silhouette, times);
    // notes stay in the metrics; only findings of the severity `warning` are warnings of the job
    let serious = metrics.findings.iter().filter(|finding| finding.severity == Severity::Warning);
    warnings.extend(serious.map(|finding| Warning::new(finding.code.clone(), finding.detail.clone())));
    let (artifacts, files) = written.into_iter().unzip();
    let software = Some(SOFTWARE.to_owned());
    let outcome = JobOutcome::Stack(StackOutcome { artifacts, image, height, metrics, software });
    Ok(JobOutput { outcome, warnings: without_repetitions(warnings), profile: None, files })
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

fn metrics(front: Fused, silhouette: Option<Silhouette>, times: Times) -> Metrics {
    let quality = front.quality.unwrap_or_default();
    Metrics {
        fusion: quality.fusion,
        focus: quality.focus,
        slices: quality.slices,
        alignment: quality.alignment,
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

    fn done(self) -> Timing {
        Timing { total: ms(self.start.elapsed()), stages: self.stages }
    }
}

fn ms(duration: std::time::Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
