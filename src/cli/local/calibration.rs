//! A calibration from folders: the profile, its report as a page, and a picture per slice.

use std::{fs, io, path::Path};

use anyhow::{Context, Result, anyhow, bail};
use serde::Serialize;

use super::{
    input::View,
    progress::Bar,
    run::{context, fitting, no_upload, unnamed},
};
use crate::{
    contract::{
        JobError,
        artifact::{REPORT, overlay_name},
        outcome::{CalibrationOutcome, JobOutcome},
        profile::Profile,
        request::JobRequest,
    },
    http::{
        ingest::submission::calibration::CalibrationSubmission,
        pages::calibration_report::{self, Subject, SubjectProfile},
    },
    jobs::{JobOutput, OutputFile},
    store::ProfileDraft,
};
use pinstack_science::{
    archive::StackArchive,
    types::{
        Warning,
        calibration_options::{CalibrationOptions, CalibrationSource},
        report::CalibrationReport,
    },
};

/// What a calibration made.
pub(in crate::cli) struct Calibrated {
    /// The profile.
    pub draft: ProfileDraft,
    /// What was measured.
    pub outcome: CalibrationOutcome,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    note: Option<String>,
    files: Vec<OutputFile>,
}

/// Calibrates from the pictures of `views`: of a dot target, or of stacks of one rig, which may refine the profile
/// `from`. `scratch` is an empty folder.
///
/// # Errors
/// What the service refuses too; when the machine is too small for the job.
pub(in crate::cli) fn calibrate(
    views: &[View],
    options: CalibrationOptions,
    from: Option<Profile>,
    bar: &Bar,
    scratch: &Path,
) -> Result<Calibrated> {
    let first = views.first().context("there is nothing to calibrate from")?;
    if views.len() > 1 && options.source == CalibrationSource::DotTarget {
        bail!("{} stacks are given; a dot target is one: give its folder alone", views.len());
    }
    let refused = |error: JobError| match error {
        JobError::Cancelled(cancelled) => anyhow!(cancelled),
        JobError::Failed(fault) => anyhow!(first.told(&fault.detail)),
    };
    let stacks = opened(views, bar)?;
    let layout = stacks.first().map(|stack| stack.layout().clone()).context("there is nothing to calibrate from")?;
    let archive = first.zip(scratch, bar).map_err(refused)?;
    let submission = CalibrationSubmission::new(unnamed()?, unnamed()?, options)?;
    let (request, mut warnings) =
        submission.to_request(no_upload(&*archive), layout).map_err(|fault| refused(fault.into()))?;
    let job = JobRequest::Calibration(request.clone());
    let runner = fitting(&job, scratch)?;
    let context = context(job, from, archive, scratch)?;
    let output = runner.measure(&context, &request, &stacks, bar).map_err(refused)?;
    let JobOutput { outcome: JobOutcome::Calibration(outcome), profile: Some(draft), files, .. } = output else {
        bail!("the calibration made no profile");
    };
    warnings.extend(output.warnings);
    Ok(Calibrated { draft: *draft, outcome, warnings, note: request.options.note, files })
}

/// The stacks of all views.
fn opened(views: &[View], bar: &Bar) -> Result<Vec<StackArchive>> {
    let stack = |view: &View| view.stack(bar).map_err(|error| anyhow!(view.told(&error.to_string())));
    views.iter().map(stack).collect()
}

/// Writes the report of a calibration as a page at `page`, and the pictures that it links to into a folder beside it.
///
/// # Errors
/// When a file cannot be read or written.
pub(in crate::cli) fn write_report(calibrated: &Calibrated, profile: &str, page: &Path) -> Result<()> {
    let named = |name: &str| {
        let found =
            calibrated.outcome.artifacts.iter().zip(&calibrated.files).find(|(artifact, _)| artifact.name == name);
        found.map(|(_, file)| file.path.as_path()).with_context(|| format!("the calibration made no {name}"))
    };
    let report: CalibrationReport = serde_json::from_slice(&fs::read(named(REPORT)?)?)?;
    let pictures = page.with_extension("overlays");
    match fs::remove_dir_all(&pictures) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            return Err(error).with_context(|| cannot_write(&pictures));
        }
        _ => fs::create_dir(&pictures).with_context(|| cannot_write(&pictures))?,
    }
    let measured = jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M UTC").to_string();
    let note = calibrated.note.as_deref();
    let subject = Subject { profile: SubjectProfile::File(profile), measured: &measured, note };
    let mut html = calibration_report::page(&subject, &report, None);
    let folder = pictures.file_name().unwrap_or_default().to_string_lossy().replace('%', "%25").replace('#', "%23");
    for index in 0..report.slices.len() {
        let name = overlay_name(index);
        fs::copy(named(&name)?, pictures.join(format!("{name}.png"))).with_context(|| cannot_write(&pictures))?;
        let served = format!("\"overlay?slice={index}\"");
        html = html.replace(&served, &format!("\"{folder}/{name}.png\"").replace('&', "&amp;"));
    }
    fs::write(page, html).with_context(|| cannot_write(page))
}

/// A document for people and programs.
///
/// # Errors
/// Never for the types of this crate.
pub(in crate::cli) fn json_of(value: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(value)? + "\n")
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}
