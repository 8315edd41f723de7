//! Fusing one stack: archive, back light, silhouette, front light, pictures, numbers.

use std::time::Instant;

use super::{
    JobContext, JobOutput, ProgressSink, SOFTWARE,
    artifact_writer::ArtifactWriter,
    crop::crop_rect,
    diagnosis,
    input_bits::{self, FullScaleSlices},
    pictures::{self, Pictures},
    stages::Phase,
};
use crate::contract::{
    Code, Fault, JobError,
    artifact::StackArtifact,
    input::SliceOrder,
    options::MaskMode,
    outcome::{JobOutcome, StackOutcome},
    request::StackRequest,
};
use pinstack_science::{
    archive::{self, ArchiveLimits, StackArchive},
    fusion::{self, Fused, MetricsRequest, Plan},
    imaging::{
        Slices,
        codec::{self, Metadata},
    },
    quality::VERSIONS,
    segmentation::{Silhouette, segment},
    types::{
        Control, Warning,
        fusion_options::GuidedParams,
        metrics::{Metrics, Severity, StageTime, Timing},
    },
};

/// Where reading ends and where writing begins, as fractions of the job.
const READ: f64 = 0.02;
const FUSED: f64 = 0.9;
/// What the fusion of the back light warns of and what says nothing about the silhouette: its white ground is meant to be
/// white, and what it does not cover the front does not either.
const NOT_OF_THE_BACK: [&str; 2] = ["fusion_overshoot", "canvas_not_covered"];

/// Does the job.
///
/// # Errors
/// [`JobError::Cancelled`]; a fault that names the file when a slice cannot be read; [`Code::MaskFailed`] when a mask is required
/// and none can be made; [`Code::InsufficientStorage`] when the disk is full.
pub fn run(
    context: &JobContext,
    request: &StackRequest,
    limits: &ArchiveLimits,
    sink: &dyn ProgressSink,
) -> Result<JobOutput, JobError> {
    let profile = context.profile.as_ref().ok_or_else(|| Fault::new(Code::ProfileNotFound, "the profile is gone"))?;
    let options = &request.options;
    let mut times = Times::since(context.started);
    let mut warnings = Vec::new();

    let reading = Phase::new(sink, &[("reading", 1.0)], 0.0, READ);
    reading.progress("reading", 0, 1);
    let archive = archive::open(&context.archive, limits)?;
    let archive = match options.order {
        SliceOrder::Name => archive,
        SliceOrder::Reverse => archive.reversed(),
    };
    let [front_slices, back_slices] =
        [archive.front(), archive.back()].map(|slices| FullScaleSlices::of(slices, options.input_bits));
    warnings.extend_from_slice(archive.warnings());
    let rect = crop_rect(options.crop, &profile.input)?;
    let plan = Plan::from_profile(&profile.input, options.method, options.guided());
    warnings.extend(unused_parameters(&plan));
    reading.progress("reading", 1, 1);
    times.end("reading");

    let writer = ArtifactWriter::new(context, sink);
    let mut written = Vec::new();
    let with_back = wants_mask(options.mask, &archive)?;
    let middle = if with_back { f64::midpoint(READ, FUSED) } else { READ };
    let mut back_light = None;
    let silhouette = if with_back {
        let back = Plan { method: plan.method.for_back_light(), ..plan.clone() };
        let control = Phase::new(sink, back.method.progress_stages(), READ, middle);
        let back = fusion::fuse(&back_slices, &back, &MetricsRequest::default(), &context.scratch, &control)?;
        times.end("fusing the back light");
        let phase = Phase::new(sink, &[("masking", 1.0)], middle, middle);
        phase.progress("masking", 0, 1);
        let silhouette = segment(&back.image, &back.valid, &options.mask_params(plan.width, plan.height));
        if options.mask == MaskMode::Required {
            useful(&silhouette)?;
        }
        written.push(writer.png(StackArtifact::Backlight.name(), &back.image.crop(rect), &Metadata::default())?);
        warnings.extend(back.warnings.into_iter().filter(|w| !NOT_OF_THE_BACK.contains(&w.code.as_str())));
        warnings.extend_from_slice(&silhouette.warnings);
        back_light = Some(diagnosis::reduced_back_light(&back.image));
        phase.progress("masking", 1, 1);
        times.end("masking");
        Some(silhouette)
    } else {
        None
    };

    let control = Phase::new(sink, plan.method.progress_stages(), middle, FUSED);
    let metrics_request = MetricsRequest { enabled: true, object: silhouette.as_ref().map(|s| &s.mask) };
    let front = fusion::fuse(&front_slices, &plan, &metrics_request, &context.scratch, &control)?;
    warnings.extend_from_slice(&front.warnings);
    diagnosis::examine(&front.image, back_light.as_ref(), options.mask, &control, &mut warnings)?;
    warnings.extend(input_bits::warning(&[&front_slices, &back_slices]));
    times.end("fusing");

    let source = archive.front_bytes(plan.reference).map(|bytes| codec::metadata(&bytes)).unwrap_or_default();
    warnings.extend(pictures::dropped_focal_length(&source, &profile.input));
    let writing = Phase::new(sink, &[("writing", 1.0)], FUSED, 1.0);
    let order = Pictures { front: &front, silhouette: silhouette.as_ref(), rect, options, profile: &profile.input };
    let (image, files) = order.write(&writer, &writing, &source)?;
    written.extend(files);
    times.end("writing");

    let metrics = metrics(front, silhouette, times);
    // notes wait in the metrics for whoever looks for them
    let serious = metrics.findings.iter().filter(|finding| finding.severity == Severity::Warning);
    warnings.extend(serious.map(|finding| Warning::new(&finding.code, finding.detail.clone())));
    let (artifacts, files) = written.into_iter().unzip();
    let outcome = JobOutcome::Stack(StackOutcome { artifacts, image, metrics, software: Some(SOFTWARE.to_owned()) });
    Ok(JobOutput { outcome, warnings: once(warnings), profile: None, files })
}

/// Who sets parameters of guided filtering expects them to count.
fn unused_parameters(plan: &Plan) -> Option<Warning> {
    let unused = !plan.method.uses_guided_params() && plan.params != GuidedParams::default();
    unused.then(|| {
        Warning::new(
            "unused_parameters",
            "r1, eps1, r2, eps2, average, r_g and sigma_g are parameters of method=guided, and this stack's front light was \
             fused by another method, which does not use them; send method=guided to have them count",
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
            "mask=required, and the archive has no back-light slices; put them into a folder back/, or ask for mask=auto",
        )),
    }
}

/// A mask that was required and holds nothing or everything is none.
fn useful(silhouette: &Silhouette) -> Result<(), Fault> {
    let hopeless = |warning: &&Warning| ["mask_empty", "mask_full"].contains(&warning.code.as_str());
    match silhouette.warnings.iter().find(hopeless) {
        None => Ok(()),
        Some(warning) => {
            let detail = format!("mask=required, and no mask can be made: {}", warning.detail);
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

/// Each warning once, in the order in which they came.
fn once(warnings: Vec<Warning>) -> Vec<Warning> {
    let mut seen = Vec::with_capacity(warnings.len());
    for warning in warnings {
        if !seen.contains(&warning) {
            seen.push(warning);
        }
    }
    seen
}

/// How long each stage took.
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
