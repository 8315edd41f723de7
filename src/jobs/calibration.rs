//! The calibration job: reads the archive of a dot target or of stacks, calibrates, and writes one overlay per slice
//! and the report.

use crate::contract::{Code, Fault, JobError};
use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;

use super::{
    JobContext, JobOutput, ProgressSink,
    artifact_writer::{ArtifactWriter, WrittenArtifact},
    calibrated_profile,
    stages::{Phase, Stage},
    thumbnails::ThumbnailingSlices,
};
use crate::{
    contract::{
        artifact,
        outcome::{CalibrationOutcome, JobOutcome},
        profile::{Profile, ProfileSource},
        request::{CalibrationRequest, StoredStack},
    },
    store::ProfileDraft,
};
use pinstack_science::{
    archive::{self, ArchiveLimits, StackArchive},
    calibration::{self, Calibration, Revision},
    imaging::{Slices, codec::Metadata},
    types::{
        Control, ReadAt, Warning, WarningCode,
        calibration_options::{CalibrationSource, Keep},
    },
};

/// Stages of the measurement with their weights.
const MEASURING: [Stage; 1] = [("detecting", 1.0)];
/// The same of a calibration by stacks.
const REGISTERING: [Stage; 1] = [("registering", 1.0)];
/// Progress, as a fraction of the job, at which reading ends and the measurement begins.
const READ: f64 = 0.02;
/// Progress at which the measurement ends and writing begins.
const MEASURED: f64 = 0.7;

/// Runs the job. The profile revision is returned as a draft; the store saves it together with the end of the job.
///
/// # Errors
/// [`JobError::Cancelled`]; the errors of [`calibration::calibrate`]; an error that names the file when a slice cannot
/// be read.
pub fn run(
    context: &JobContext,
    request: &CalibrationRequest,
    limits: &ArchiveLimits,
    sink: &dyn ProgressSink,
) -> Result<JobOutput, JobError> {
    let reading = Phase::new(sink, &[("reading", 1.0)], 0.0, READ);
    reading.progress("reading", 0, 1);
    let zip = Arc::clone(&context.archive);
    let stacks = match request.options.source {
        CalibrationSource::DotTarget => vec![archive::open_shared(zip, limits)?],
        CalibrationSource::Stacks if request.stacks.is_empty() => archive::open_stacks(zip, limits)?,
        CalibrationSource::Stacks => {
            let zips = std::iter::once(zip).chain(context.others.iter().cloned());
            request.stacks.iter().zip(zips).map(|(stack, zip)| stored(stack, zip, limits)).collect::<Result<_, _>>()?
        }
    };
    reading.progress("reading", 1, 1);
    measure(context, request, &stacks, sink)
}

/// Runs the job on archives that are open: that of a dot target, or those of stacks of one rig.
///
/// # Errors
/// As [`run`].
pub fn measure(
    context: &JobContext,
    request: &CalibrationRequest,
    stacks: &[StackArchive],
    sink: &dyn ProgressSink,
) -> Result<JobOutput, JobError> {
    let none = || Fault::new(Code::InvalidArchive, "there is no stack to calibrate from; add its slices");
    let archive = stacks.first().ok_or_else(none)?;
    let stages = match request.options.source {
        CalibrationSource::DotTarget => &MEASURING,
        CalibrationSource::Stacks => &REGISTERING,
    };
    let control = Phase::new(sink, stages, READ, MEASURED);
    let slices = ThumbnailingSlices::new(archive.front(), &context.scratch);
    let measured = match request.options.source {
        CalibrationSource::DotTarget => {
            let moved: Option<&dyn Slices> = (archive.moved().count() > 0).then_some(archive.moved() as _);
            calibration::calibrate_with_moved(&slices, moved, &request.options, &control)?
        }
        CalibrationSource::Stacks => {
            let others = stacks.iter().skip(1).map(|stack| stack.front() as &dyn Slices);
            let views: Vec<&dyn Slices> = std::iter::once(&slices as &dyn Slices).chain(others).collect();
            by_stacks(context, request, &views, &control)?
        }
    };
    let input = calibrated_profile::numbers(&measured, context.profile.as_ref(), request, archive.layout().orientation);
    input.check()?;

    let writing = Phase::new(sink, &[("writing", 1.0)], MEASURED, 1.0);
    let writer = ArtifactWriter::new(context, sink);
    let mut written = overlays(&slices, &measured, &writer, &writing)?;
    written.push(writer.json(artifact::REPORT, &measured.report)?);
    let (artifacts, files) = written.into_iter().unzip();

    let keep = request.options.keep;
    let draft = keep.admits(measured.report.grade).then(|| ProfileDraft {
        input,
        source: ProfileSource::Calibration,
        calibration_id: Some(context.job.id),
        model: measured.model,
        slices: measured.slices.clone(),
        origin: None,
        warnings: Vec::new(),
    });
    let mut warnings = Vec::new();
    for warning in stacks.iter().flat_map(|stack| stack.warnings()) {
        if !warnings.contains(warning) {
            warnings.push(warning.clone());
        }
    }
    if draft.is_none() {
        warnings.push(Warning::new(WarningCode::ProfileNotKept, not_kept(keep)));
    }
    warnings.extend(measured.warnings);
    let outcome = JobOutcome::Calibration(CalibrationOutcome {
        artifacts,
        // the store assigns these three
        profile_revision: None,
        profile_digest: None,
        profile_optics_digest: None,
        reference_index: u32::try_from(measured.reference_index).unwrap_or(u32::MAX),
        slices: measured.slices,
        dot_pitch_px: Some(measured.dot_pitch_px).filter(|pitch| pitch.is_finite()),
        magnification: measured.magnification,
        verdict: measured.verdict,
        grade: Some(measured.report.grade),
    });
    Ok(JobOutput { outcome, warnings, profile: draft.map(Box::new), files })
}

/// Calibrates by stacks, or refines the profile that the job has.
fn by_stacks(
    context: &JobContext,
    request: &CalibrationRequest,
    views: &[&dyn Slices],
    control: &Phase<'_>,
) -> Result<Calibration, JobError> {
    let Some(Profile { input, model, .. }) = &context.profile else {
        return Ok(calibration::calibrate_by_stacks(views, &request.options, control)?);
    };
    let revision = request.options.from.map(|revision| format!("revision {revision}"));
    let name = revision.as_deref().unwrap_or("the profile that was given");
    let from = Revision { name, input, model: *model };
    Ok(calibration::refine_by_stacks(views, &from, &request.options, control)?)
}

/// The archive of a stored stack, in the order of the profile.
fn stored(stack: &StoredStack, zip: Arc<dyn ReadAt>, limits: &ArchiveLimits) -> Result<StackArchive, Fault> {
    let archive = archive::open_shared(zip, limits).map_err(|error| {
        let fault = Fault::from(error);
        Fault { detail: format!("stack {}: {}", stack.id, fault.detail), ..fault }
    })?;
    Ok(if stack.reversed { archive.reversed() } else { archive })
}

/// Why the profile has no new revision.
fn not_kept(keep: Keep) -> &'static str {
    match keep {
        Keep::Always => "the calibration was not kept",
        Keep::Usable => {
            "the calibration is poor and keep=usable excludes it, so the profile has no new revision: correct what the \
             report names and calibrate again, or send keep=always to store it"
        }
        Keep::Good => {
            "the calibration is not good and keep=good excludes it, so the profile has no new revision: correct what the \
             report names and calibrate again, or send keep=usable or keep=always to store it"
        }
    }
}

/// Writes one overlay per slice, at most 1600 px long, in parallel; returns them in the order of the slices.
fn overlays(
    slices: &ThumbnailingSlices<'_>,
    measured: &Calibration,
    writer: &ArtifactWriter<'_>,
    control: &Phase<'_>,
) -> Result<Vec<WrittenArtifact>, JobError> {
    let count = slices.count();
    let done = AtomicUsize::new(0);
    control.progress("writing", 0, count);
    (0..count)
        .into_par_iter()
        .map(|index| {
            control.check()?;
            let picture = calibration::overlay(&slices.thumbnail(index)?, measured, index);
            let written = writer.png(&artifact::overlay_name(index), &picture, &Metadata::default())?;
            control.progress("writing", done.fetch_add(1, Ordering::Relaxed) + 1, count);
            Ok(written)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        contract::{Code, request::JobRequest},
        jobs::testkit::{Recorder, TestJob, front_zip, members, picture, png, rig, target_zip, zip},
    };
    use pinstack_science::{
        synth::{DotTarget, Rig, target_stack},
        types::{
            Homography,
            calibration_options::CalibrationOptions,
            pupils::PrincipalDistanceSource,
            report::{CalibrationReport, Grade},
        },
    };

    fn run_with(job: &TestJob, sink: &dyn ProgressSink) -> Result<JobOutput, JobError> {
        let JobRequest::Calibration(request) = &job.context.job.request else { panic!("a calibration") };
        run(&job.context, request, &ArchiveLimits::default(), sink)
    }

    #[test]
    fn a_target_gives_the_true_homographies_and_an_overlay_per_slice() {
        let asked = CalibrationOptions { note: Some("spring".into()), ..CalibrationOptions::default() };
        let job = TestJob::calibration(&target_zip(), asked);
        let recorder = Recorder::default();
        let output = run_with(&job, &recorder).expect("the calibration");
        let draft = output.profile.as_ref().expect("a profile");
        assert_eq!((draft.input.note.as_deref(), draft.calibration_id), (Some("spring"), Some(job.context.job.id)));
        assert_eq!(draft.input.orientation, Some(1));
        for (i, homography) in draft.input.homographies.iter().enumerate() {
            let error = homography.corner_distance(&rig().homography(i), 240, 180);
            assert!(error < 0.3, "slice {i} is {error} px off");
        }
        assert_eq!(draft.input.homographies[rig().reference], Homography::IDENTITY);
        for i in 0..rig().slices() {
            let (artifact, overlay) = picture(&output, &format!("overlay-{i}"));
            assert_eq!((overlay.width, overlay.height, artifact.media_type.as_str()), (240, 180, "image/png"));
        }
        let report =
            output.outcome.artifacts().iter().zip(&output.files).find(|(artifact, _)| artifact.name == "report");
        let (artifact, file) = report.expect("a report");
        assert_eq!(artifact.media_type, "application/json");
        let report: CalibrationReport =
            serde_json::from_slice(&std::fs::read(&file.path).expect("its file")).expect("a report");
        assert_eq!((report.slices.len(), report.reference_index as usize), (rig().slices(), rig().reference));
        assert!(
            report.slices.iter().all(|slice| slice.dots.len() == slice.dots_found as usize && !slice.name.is_empty())
        );
        let reports = recorder.reports.into_inner().unwrap();
        assert_eq!(reports.last().map(|progress| progress.fraction), Some(1.0));
    }

    #[test]
    fn one_picture_of_the_moved_target_in_the_zip_makes_the_camera_known() {
        let rig = Rig { pupil_ratio: 1.6, noise: 0.5, ..rig() }.ideal();
        let target = DotTarget::for_rig(&rig, 12);
        let near = DotTarget { depth: Some(-0.5), ..target.clone() };
        let advance = rig.object_distance(0.5) - rig.object_distance(-0.5);
        let asked = CalibrationOptions {
            target_pitch_mm: Some(target.pitch_mm),
            pixel_pitch_mm: Some(rig.pixel_pitch_mm),
            rail_positions_mm: Some(rig.rail_mm.iter().map(|z| -z).collect()),
            target_advance_mm: Some(advance),
            ..CalibrationOptions::default()
        };
        let mut files = members("front", &target_stack(&rig, &target));
        files.push(("moved/near.png".into(), png(&target_stack(&rig, &near)[rig.reference])));
        let job = TestJob::calibration(&zip(files), asked);
        let output = run_with(&job, &Recorder::default()).expect("the calibration");
        let input = output.profile.expect("a profile").input;
        assert_eq!(input.principal_distance_source, Some(PrincipalDistanceSource::MovedTarget));
        let (found, truth) = (input.principal_distance_mm.expect("known"), rig.lens().principal_distance());
        assert!((found / truth - 1.0).abs() < 0.01, "{found} for {truth}");
    }

    #[test]
    fn lateral_colour_of_the_target_becomes_that_of_the_profile() {
        let mut target = DotTarget::for_rig(&rig(), 12);
        target.flaws.faults.lateral = [0.008, 0.0, -0.008];
        let zip = zip(members("front", &target_stack(&rig(), &target)));
        let job = TestJob::calibration(&zip, CalibrationOptions::default());
        let output = run_with(&job, &Recorder::default()).expect("the calibration");
        let found = output.profile.expect("a profile").input.lateral_colour.expect("measured");
        // 150 px from the middle to a corner
        for (colour, truth) in [(found.red, 0.008), (found.blue, -0.008)] {
            assert!(150.0 * (colour.scale - truth).abs() < 0.1, "{found:?}");
        }
        assert!(output.warnings.iter().any(|warning| warning.code == "lateral_colour"), "{:?}", output.warnings);
    }

    #[test]
    fn a_calibration_below_the_grade_of_keep_makes_no_revision() {
        // few dots far from the corners, in noise
        let noisy = Rig { noise: 20.0, ..rig() };
        let small = DotTarget { columns: 5, rows: 5, ..DotTarget::for_rig(&noisy, 12) };
        let zip = zip(members("front", &target_stack(&noisy, &small)));
        for (keep, kept) in [(Keep::Always, true), (Keep::Good, false)] {
            let job = TestJob::calibration(&zip, CalibrationOptions { keep, ..CalibrationOptions::default() });
            let output = run_with(&job, &Recorder::default()).expect("a result");
            let JobOutcome::Calibration(outcome) = &output.outcome else { panic!("a calibration") };
            assert_ne!(outcome.grade, Some(Grade::Good), "{}", outcome.verdict);
            assert_eq!(output.profile.is_some(), kept);
            assert_eq!(output.warnings.iter().any(|warning| warning.code == "profile_not_kept"), !kept);
            assert!(outcome.artifacts.iter().any(|artifact| artifact.name == "report"));
        }
        let options = CalibrationOptions { keep: Keep::Good, ..CalibrationOptions::default() };
        let good = run_with(&TestJob::calibration(&target_zip(), options), &Recorder::default()).expect("a result");
        assert!(good.profile.is_some());
    }

    #[test]
    fn slices_without_dots_are_refused() {
        let job = TestJob::calibration(&front_zip(), CalibrationOptions::default());
        let Err(JobError::Failed(fault)) = run_with(&job, &Recorder::default()) else { panic!("must fail") };
        assert_eq!(fault.code, Code::TargetNotFound);
    }

    #[test]
    fn a_cancelled_calibration_stops() {
        for stop_at in [0.0, 0.3, 0.8] {
            let job = TestJob::calibration(&target_zip(), CalibrationOptions::default());
            let recorder = Recorder { stop_at: Some(stop_at), ..Recorder::default() };
            assert!(matches!(run_with(&job, &recorder), Err(JobError::Cancelled(_))), "at {stop_at}");
        }
    }
}
