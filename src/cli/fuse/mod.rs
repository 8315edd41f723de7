//! `pinstack fuse`: fuses the stacks in folders on this machine, without a server, with the jobs of the service.

mod bundle;
mod fused;
mod output;
mod results;

use std::path::PathBuf;

use anyhow::{Context, Result, anyhow, bail};
use clap::Args;

use self::{
    fused::Fused,
    output::Output,
    results::{Document, Failed},
};
use super::{
    files, local,
    local::{Bar, ProfileFlags, UsedProfile, View},
    logging,
    option_flags::OptionFlags,
    output::{note, say},
};
use crate::{
    contract::{JobError, options::StackOptions, request::JobRequest},
    http::ingest::submission::stack::StackSubmission,
    jobs::JobRunner,
    settings::LogFormat,
};
use pinstack_science::{photogrammetry::bundle::Layout, types::Interrupted};

/// What follows the help.
const EXIT: &str = "Exit code: 0 when every stack was fused, also with warnings; 1 when one was not, or anything else failed; 2 for \
     wrong arguments.";

/// Fuse the stacks in folders on this machine, without a server
///
/// A folder, or a zip of it, is a stack: front-lit slices in front/ or in the folder itself, back-lit slices in back/.
/// A folder with one folder per view is a scan; names with angles (pan020_tilt15) are read. Image, mask, depth,
/// metrics, preview, profile and a summary are written to FOLDER-fused/; with several folders to fused/ beside the
/// first, a folder per stack, with a contact sheet.
#[derive(Debug, Args)]
#[command(after_help = EXIT)]
pub struct Fuse {
    /// Folders or zips, of stacks or scans
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// Folder of the results
    #[arg(short, long, value_name = "OUT")]
    out: Option<PathBuf>,
    #[command(flatten)]
    profile: ProfileFlags,
    /// Folder of the back-lit slices, if they are not in FOLDER
    #[arg(long, value_name = "FOLDER")]
    back: Option<PathBuf>,
    /// Replace the results of an earlier run
    #[arg(long)]
    force: bool,
    /// Bundle for a reconstruction program too: colmap, meshroom, metashape, realitycapture, odm, openmvg or nerfstudio
    #[arg(long, value_name = "PROGRAM", value_parser = bundle::layout)]
    bundle: Option<Layout>,
    /// Print one JSON document with all results instead of the summary
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    options: OptionFlags<StackOptions>,
}

impl Fuse {
    /// Runs the command.
    ///
    /// # Errors
    /// When a stack cannot be read or fused, or a result cannot be written.
    pub fn run(self) -> Result<()> {
        let OptionFlags(options) = self.options;
        options.check()?;
        files::raise_limit();
        let views = local::views(&self.folders, self.back.as_deref())?;
        let inputs: Vec<PathBuf> = self.folders.iter().chain(&self.back).cloned().collect();
        let output = Output::make(self.out, &self.folders, &inputs, views.len(), self.force)?;
        logging::start("error", LogFormat::Text)?;
        let runtime = tokio::runtime::Runtime::new()?;
        local::stop_by_signals(&runtime)?;
        let bar = Bar::new(views.len() + usize::from(self.profile.is_unknown()));
        let used = output.in_scratch(|scratch| {
            bar.begin("profile");
            let is_measured = self.profile.is_unknown();
            let used = self.profile.find(options.profile_revision, &views, &bar, scratch, &runtime)?;
            if let Some(made) = &used.calibrated {
                output.write_profile(&used.profile.input)?;
                local::write_report(made, output::PROFILE, &output.folder.join(output::REPORT))?;
            }
            if is_measured {
                bar.end();
            }
            Ok(used)
        });
        let used = stopped(used)?;
        let mut document = Document::new(&used, &output);
        for view in &views {
            bar.begin(&view.name);
            match output.in_scratch(|scratch| fused(view, &used, &options, &output, &bar, scratch)) {
                Ok(fused) => {
                    bar.end();
                    if !self.json {
                        say(fused.text().trim_end());
                    }
                    document.views.push(fused);
                }
                Err(_) if local::is_stopped() => break,
                Err(error) => {
                    bar.end();
                    let failed = Failed { name: view.name.clone(), error: format!("{error:#}") };
                    if views.len() > 1 {
                        note(format!("{}: {}", failed.name, failed.error));
                    }
                    document.failed.push(failed);
                }
            }
        }
        bar.clear();
        if !document.views.is_empty() {
            output.write_profile(&used.profile.input)?;
            document.finish(&output, &views, self.bundle)?;
        }
        if self.json {
            say(local::json_of(&document)?.trim_end());
        } else if !document.views.is_empty() {
            say(document.ends());
        }
        if local::is_stopped() {
            bail!("stopped: {} of {} stacks are fused", document.views.len(), views.len());
        }
        match document.failed.as_slice() {
            [] => Ok(()),
            [one] if views.len() == 1 => Err(anyhow!("{}", one.error)),
            failed => Err(anyhow!("{} of {} stacks could not be fused", failed.len(), views.len())),
        }
    }
}

/// The result; of work that a signal stopped, an error that says so.
fn stopped<T>(result: Result<T>) -> Result<T> {
    match result {
        Err(_) if local::is_stopped() => Err(anyhow!("stopped: nothing is fused")),
        other => other,
    }
}

/// Fuses a view and moves its results to where they belong.
fn fused(
    view: &View,
    used: &UsedProfile,
    options: &StackOptions,
    output: &Output,
    bar: &Bar,
    scratch: &std::path::Path,
) -> Result<Fused> {
    let told = |detail: &str| anyhow!(view.told(detail));
    let stack = view.stack(bar).map_err(|error: Interrupted| told(&error.to_string()))?;
    let layout = stack.layout().clone();
    drop(stack);
    let archive = view.zip(scratch, bar).map_err(|error| told(&error.to_string()))?;
    let submission = StackSubmission::new(used.profile.clone(), options.clone(), None);
    let submission = submission.map_err(|error| anyhow!("{}", error.fault().detail))?.with_profile_called(&used.called);
    let mut warnings: Vec<_> = submission.unknown_orientation(&layout).into_iter().collect();
    let request = submission.to_request(local::no_upload(&*archive), layout).map_err(|fault| told(&fault.detail))?;
    let request = JobRequest::Stack(request);
    let runner = local::fitting(&request, scratch)?;
    let context = local::context(request, Some(used.profile.clone()), archive, scratch)?;
    let made = runner.run(&context, bar).map_err(|error| match error {
        JobError::Cancelled(cancelled) => anyhow!(cancelled),
        JobError::Failed(fault) => told(&fault.detail),
    })?;
    warnings.extend(made.warnings);
    let folder = output.folder_of(&view.name)?;
    let files = output::moved(made.outcome.artifacts(), &made.files, &folder)?;
    Fused::new(view, &context.job.request, made.outcome, warnings, folder, files).context("the job made no stack")
}
