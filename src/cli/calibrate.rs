//! `pinstack calibrate`: makes a profile from the pictures of a folder on this machine, without a server.

use std::{
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result, anyhow, bail};
use clap::{Args, ValueEnum};
use serde_json::json;

use super::{
    files,
    local::{self, Bar, Calibrated, View},
    logging,
    option_flags::OptionFlags,
    output::say,
};
use crate::{contract::ranges::check_calibration, settings::LogFormat};
use pinstack_science::{
    calibration,
    imaging::Slices,
    types::calibration_options::{CalibrationOptions, CalibrationSource},
};

/// What follows the help.
const EXIT: &str =
    "Exit code: 0 when a profile was written, whatever its grade; 1 when none was; 2 for wrong arguments.";

/// Make a profile from the pictures of a folder on this machine, without a server
///
/// Writes the profile as JSON, which `pinstack fuse --profile` and PUT /v1/profiles/{rig}/{lens} read, and beside it a
/// report as a page.
#[derive(Debug, Args)]
#[command(after_help = EXIT)]
pub struct Calibrate {
    /// Folder or zip of a dot target, or folders and zips of stacks and scans of one rig
    #[arg(required = true, value_name = "FOLDER")]
    folders: Vec<PathBuf>,
    /// File of the profile [default: FOLDER-profile.json]
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// What the pictures show [default: found from the middle picture]
    #[arg(long, value_enum)]
    from: Option<From>,
    /// Profile of this rig that stacks refine: its homographies follow the pictures, the rest is kept
    #[arg(long, value_name = "FILE", conflicts_with = "from")]
    refine: Option<PathBuf>,
    /// Replace files of an earlier run
    #[arg(long)]
    force: bool,
    /// Print one JSON document instead of the verdict
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    options: OptionFlags<CalibrationOptions>,
}

/// What the pictures show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum From {
    /// A dot target
    Target,
    /// Objects: ordinary stacks
    Stacks,
}

impl Calibrate {
    /// Runs the command.
    ///
    /// # Errors
    /// When the pictures cannot be read or show nothing to calibrate from, or a file cannot be written.
    pub fn run(self) -> Result<()> {
        let OptionFlags(options) = self.options;
        let first = self.folders.first().context("no folder is given")?;
        let name = format!("{}-profile.json", local::name_of(first));
        let out = self.out.unwrap_or_else(|| first.parent().map_or_else(|| name.clone().into(), |at| at.join(&name)));
        let page = out.with_extension("html");
        if let Some(there) = [&out, &page].into_iter().find(|path| path.exists()).filter(|_| !self.force) {
            bail!("{} exists already; give --force to replace it, or another file with -o", there.display());
        }
        files::raise_limit();
        logging::start("error", LogFormat::Text)?;
        let views = local::views(&self.folders, None)?;
        let runtime = tokio::runtime::Runtime::new()?;
        local::stop_by_signals(&runtime)?;
        let bar = Bar::new(1);
        bar.begin(&local::name_of(first));
        if self.refine.is_some() {
            let asked = CalibrationOptions { source: CalibrationSource::Stacks, from: Some(1), ..options.clone() };
            check_calibration(&asked)?;
        }
        let refine = self.refine.as_deref().map(local::read_profile).transpose()?;
        let source = match self.from {
            _ if refine.is_some() => CalibrationSource::Stacks,
            Some(From::Target) => CalibrationSource::DotTarget,
            Some(From::Stacks) => CalibrationSource::Stacks,
            None => shown(&views, &bar)?,
        };
        let at = out.parent().filter(|at| !at.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let scratch = tempfile::Builder::new().prefix(".pinstack-").tempdir_in(at);
        let scratch = scratch.with_context(|| format!("cannot write into {}", at.display()))?;
        let made = local::calibrate(&views, CalibrationOptions { source, ..options }, refine, &bar, scratch.path());
        bar.clear();
        let made = match made {
            Err(_) if local::is_stopped() => bail!("stopped: no profile is made"),
            made => made?,
        };
        let text = local::json_of(&made.draft.input)?;
        fs::write(&out, text).with_context(|| format!("cannot write {}", out.display()))?;
        local::write_report(&made, &out.display().to_string(), &page)?;
        if self.json {
            let (outcome, warnings) = (&made.outcome, &made.warnings);
            let document = json!({
                "profile": out, "report": page, "source": source, "grade": outcome.grade, "verdict": outcome.verdict,
                "reference_index": outcome.reference_index, "slices": outcome.slices, "warnings": warnings,
            });
            say(serde_json::to_string_pretty(&document)?);
        } else {
            say(told(&made, &out, &page));
        }
        Ok(())
    }
}

/// What the pictures show, by that in the middle of the first stack.
fn shown(views: &[View], bar: &Bar) -> Result<CalibrationSource> {
    let view = views.first().context("there are no pictures")?;
    let refused = |detail: String| anyhow!(view.told(&detail));
    let stack = view.stack(bar).map_err(|error| refused(error.to_string()))?;
    let picture = stack.front().load(stack.front().count() / 2).map_err(|error| refused(error.detail))?;
    Ok(match calibration::dot_target(&picture, bar)? {
        Some(_) => CalibrationSource::DotTarget,
        None => CalibrationSource::Stacks,
    })
}

fn told(made: &Calibrated, out: &Path, page: &Path) -> String {
    let mut text = format!("{}\n", made.outcome.verdict);
    for warning in &made.warnings {
        text.push_str(&format!("warning  {} ({})\n", warning.detail, warning.code));
    }
    format!("{text}profile  {}\nreport   {}", out.display(), page.display())
}
