//! What a run says about its results: a document for programs, and the same for people.

use std::{fmt::Write, path::PathBuf};

use anyhow::Result;
use serde::Serialize;

use super::{
    bundle,
    fused::Fused,
    output::{self, Output, PROFILE},
};
use crate::{
    cli::{
        local::{Calibrated, UsedProfile, View, json_of},
        sheet::{self, Cell},
    },
    contract::Verdict,
    jobs::SOFTWARE,
};
use pinstack_science::{photogrammetry::bundle::Layout, types::Warning};

/// Files of a run.
const SUMMARY: &str = "summary.txt";
const SHEET: &str = "contact-sheet.html";

/// The results of a run.
#[derive(Debug, Serialize)]
pub(super) struct Document {
    /// Program and version.
    software: &'static str,
    /// The folder of the results.
    folder: PathBuf,
    /// The file of the profile, in that folder.
    profile: &'static str,
    /// What a calibration from the pictures found; absent where the profile was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<MadeProfile>,
    /// The stacks that were fused.
    pub views: Vec<Fused>,
    /// Those that were not.
    pub failed: Vec<Failed>,
    /// The contact sheet of several stacks, in the folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    contact_sheet: Option<&'static str>,
    /// The folder of the bundle, in the folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    bundle: Option<String>,
}

/// The verdict on a profile that was made from the pictures.
#[derive(Debug, Serialize)]
struct MadeProfile {
    verdict: String,
    warnings: Vec<Warning>,
}

/// A stack that could not be fused.
#[derive(Debug, Serialize)]
pub(super) struct Failed {
    /// Name in the run.
    pub name: String,
    /// Why.
    pub error: String,
}

impl Document {
    /// Of a run that begins.
    pub(super) fn new(used: &UsedProfile, output: &Output) -> Self {
        let made =
            |made: &Calibrated| MadeProfile { verdict: made.outcome.verdict.clone(), warnings: made.warnings.clone() };
        Self {
            software: SOFTWARE,
            folder: output.folder.clone(),
            profile: PROFILE,
            calibration: used.calibrated.as_ref().map(made),
            views: Vec::new(),
            failed: Vec::new(),
            contact_sheet: None,
            bundle: None,
        }
    }

    /// Writes metrics, summary, contact sheet and bundle.
    ///
    /// # Errors
    /// When one cannot be written.
    pub(super) fn finish(&mut self, output: &Output, views: &[View], layout: Option<Layout>) -> Result<()> {
        for fused in &self.views {
            output::write(&fused.folder.join("metrics.json"), &json_of(&fused.metrics)?)?;
        }
        if self.views.len() > 1 {
            output.write(SHEET, &sheet::page("Fused stacks", &self.cells()))?;
            self.contact_sheet = Some(SHEET);
        }
        if let Some(layout) = layout.filter(|_| !self.views.is_empty()) {
            self.bundle = Some(bundle::write(layout, output, views, &self.views)?);
        }
        output.write(SUMMARY, &self.text())
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |fused: &Fused| {
            let file = |name: &str| format!("{}/{}", fused.name, fused.files.get(name).map_or("", String::as_str));
            let caption = match fused.verdict {
                Verdict::Use => fused.name.clone(),
                found => format!("{}: {}", fused.name, found.words()),
            };
            Cell { file: file("image"), picture: file("preview"), caption }
        };
        self.views.iter().map(cell).collect()
    }

    /// The last line.
    pub(super) fn ends(&self) -> String {
        let folder = self.folder.join("");
        let more = self.contact_sheet.into_iter().chain(self.bundle.as_deref());
        let names: Vec<&str> = more.chain([self.profile, SUMMARY]).collect();
        format!("{}: {}", folder.display(), names.join(" "))
    }

    fn text(&self) -> String {
        let mut out = format!("{SOFTWARE}\n\n");
        if let Some(made) = &self.calibration {
            let _ = writeln!(out, "profile: {}", made.verdict);
            for warning in &made.warnings {
                let _ = writeln!(out, "  warning    {} ({})", warning.detail, warning.code);
            }
            out.push('\n');
        }
        for fused in &self.views {
            let _ = writeln!(out, "{}", fused.text());
        }
        for failed in &self.failed {
            let _ = writeln!(out, "{}: not fused: {}\n", failed.name, failed.error);
        }
        out
    }
}
