//! `pinstack reconstruct`: the reconstruction of a scan, from the data folder. It is the job of the service, run here.

use std::{fs, path::PathBuf, sync::Arc, time::Instant};

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use jiff::Timestamp;

use super::{
    local::{Bar, fitting, stop_by_signals},
    output::say,
    store::Place,
};
use crate::{
    contract::{
        JobError, Name,
        artifact::FileFormat,
        outcome::JobOutcome,
        reconstruction::{ReconstructionOptions, ReconstructionResult, files},
        request::JobRequest,
    },
    http::{App, Policy, auth::Caller, reconstructions::plan::request_of},
    jobs::{
        JobContext, JobOutput, JobRunner,
        reconstruction::{BUNDLE, INSTALL},
    },
    store::{Job, Store},
    worker::pictures::place,
};
use pinstack_science::photogrammetry::poses::PoseReport;

/// Reconstruct a scan with COLMAP on this machine, and write cameras, points and findings; a server may run meanwhile
#[derive(Debug, Args)]
pub struct Reconstruct {
    #[command(flatten)]
    place: Place,
    /// Name of the scan
    scan: String,
    /// Leave out views that have no result
    #[arg(long)]
    partial: bool,
    /// Leave out observations with a larger error of reprojection, px, 0.1 to 16
    #[arg(long, value_name = "PX", default_value_t = ReconstructionOptions::default().max_error_px)]
    max_error_px: f64,
    /// Folder to write; must not exist [default: {scan}_reconstruction]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Reconstruct {
    /// Runs the command.
    ///
    /// # Errors
    /// What `POST /v1/scans/{scan}/reconstructions` refuses; when there is no COLMAP, or it fails; when the folder
    /// exists or cannot be written.
    pub fn run(self) -> Result<()> {
        let runtime = tokio::runtime::Runtime::new()?;
        stop_by_signals(&runtime)?;
        let scan = Name::new(self.scan)?;
        let out = self.out.unwrap_or_else(|| format!("{scan}_reconstruction").into());
        let options = ReconstructionOptions { partial: self.partial, max_error_px: self.max_error_px };
        options.check().map_err(|fault| anyhow!(fault.detail))?;
        let (config, store) = runtime.block_on(self.place.open())?;
        let Some(colmap) = config.colmap() else { bail!("there is no COLMAP on this machine: {INSTALL}") };
        fs::create_dir(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
        let scratch = tempfile::Builder::new().prefix("job-").tempdir_in(store.workspace.path())?;
        let (job, request) = runtime.block_on(prepared(&store, &scan, options, scratch.path()))?;
        let mut runner = fitting(&request, scratch.path())?;
        runner.colmap = Some(colmap);
        let (archive, others, scratch_path) = (Arc::new(Vec::<u8>::new()), Vec::new(), scratch.path().to_owned());
        let context =
            JobContext { job, profile: None, archive, others, scratch: scratch_path, started: Instant::now() };
        let bar = Bar::new(1);
        bar.begin(scan.as_str());
        let done = runner.run(&context, &bar);
        bar.end();
        let output = done.map_err(|error| match error {
            JobError::Cancelled(cancelled) => anyhow!(cancelled),
            JobError::Failed(fault) => anyhow!(fault.detail),
        })?;
        let result = write(&output, &out)?;
        runtime.block_on(store.metadata.close());
        tell(&result);
        say(format!("{}: the files", out.display()));
        Ok(())
    }
}

/// The job, with its pictures in place.
async fn prepared(
    store: &Store,
    scan: &Name,
    options: ReconstructionOptions,
    scratch: &std::path::Path,
) -> Result<(Job, JobRequest)> {
    let app = App::new(store.clone(), Policy::default());
    let asked = request_of(&app, &Caller::default(), scan, options).await;
    let (stored, request) = asked.map_err(|error| anyhow!("{}", error.fault().detail))?;
    if let Some(missing) = place(store, &request, &scratch.join(BUNDLE)).await? {
        bail!(missing.detail);
    }
    let request = JobRequest::Reconstruction(request);
    Ok((Job::unqueued(stored.input.rig, stored.input.lens, request.clone(), Timestamp::now()), request))
}

/// Writes the files, the report on the poses in its formats, and the numbers.
fn write(output: &JobOutput, out: &std::path::Path) -> Result<ReconstructionResult> {
    let JobOutcome::Reconstruction(outcome) = &output.outcome else { bail!("the job made no reconstruction") };
    for (artifact, file) in outcome.artifacts.iter().zip(&output.files) {
        let format = FileFormat::of_media_type(&artifact.media_type).unwrap_or(FileFormat::Text);
        let to = out.join(format!("{}.{}", artifact.name, format.extension()));
        fs::copy(&file.path, &to).with_context(|| format!("cannot write {}", to.display()))?;
        if artifact.name == files::POSES {
            let report: PoseReport = serde_json::from_slice(&fs::read(&file.path)?)?;
            fs::write(out.join("poses.txt"), report.text())?;
            fs::write(out.join("poses.tex"), report.latex())?;
            fs::write(out.join("poses.html"), crate::http::pages::pose_report::page(&report))?;
        }
    }
    fs::write(out.join("result.json"), serde_json::to_string_pretty(&outcome.result)? + "\n")?;
    Ok(outcome.result.clone())
}

/// What was found, for people.
fn tell(result: &ReconstructionResult) {
    let ReconstructionResult { registered, expected, points, mean_error_px, .. } = result;
    let error = mean_error_px.map(|error| format!(", mean error of reprojection {error:.2} px")).unwrap_or_default();
    say(format!("{registered} of {expected} views registered, {points} points{error}"));
    for finding in &result.findings {
        say(format!("- {}", finding.detail));
    }
}
