//! A stack that was fused: for programs, and in words.

use std::{collections::BTreeMap, fmt::Write, path::PathBuf, time::Duration};

use serde::Serialize;

use crate::{
    cli::local::View,
    contract::{
        Verdict,
        options::StackOptions,
        outcome::{HeightInfo, ImageInfo, JobOutcome},
        request::JobRequest,
        verdict::{Explained, explained, verdict},
    },
    http::pages::words::duration,
};
use pinstack_science::types::{Warning, metrics::Metrics, stack_layout::StackLayout};

/// A stack that was fused.
#[derive(Debug, Serialize)]
pub(super) struct Fused {
    /// Name in the run.
    pub name: String,
    /// The folder or zip that it came from.
    input: PathBuf,
    /// The folder of its files.
    pub folder: PathBuf,
    /// Its files by what they are.
    pub files: BTreeMap<String, String>,
    /// All options in use.
    options: StackOptions,
    /// The slices in the order of fusion.
    pub slices: StackLayout,
    /// Properties of the image.
    pub image: ImageInfo,
    /// How to read the height map.
    height: Option<HeightInfo>,
    /// The metrics, as GET /v1/stacks/{id}/metrics answers.
    pub metrics: Metrics,
    /// The verdict on the result.
    pub verdict: Verdict,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Fused {
    /// `None` for a job that made no stack.
    pub(super) fn new(
        view: &View,
        request: &JobRequest,
        outcome: JobOutcome,
        warnings: Vec<Warning>,
        folder: PathBuf,
        files: BTreeMap<String, String>,
    ) -> Option<Self> {
        let (JobRequest::Stack(request), JobOutcome::Stack(outcome)) = (request, outcome) else { return None };
        Some(Self {
            name: view.name.clone(),
            input: view.input.clone(),
            folder,
            files,
            options: request.options.clone(),
            slices: request.layout.clone(),
            image: outcome.image,
            height: outcome.height,
            metrics: outcome.metrics,
            verdict: verdict(&warnings),
            warnings,
        })
    }

    /// The stack in words.
    pub(super) fn text(&self) -> String {
        let Self { name, slices, image, metrics, .. } = self;
        let (front, back) = (slices.front.len(), slices.back.len());
        let back = if back == 0 { String::new() } else { format!(" and {back} back-lit") };
        let time = duration(Duration::from_millis(metrics.timing_ms.total));
        let mut out = format!(
            "{name}: {front} slices{back} of {} x {} px, fused in {time} into {} x {} px with {} bits\n",
            slices.width, slices.height, image.width, image.height, image.bit_depth
        );
        let number = |value: Option<f64>, digits: usize| value.map(|value| format!("{value:.digits$}"));
        let rows = [
            ("alignment", number(metrics.alignment.residual_p95_px, 2), "px between slices (95 %)"),
            (
                "sharpness",
                number(metrics.fusion.sharpness_retention, 2),
                "of that of the sharpest slices; good: 0.8 to 1.02",
            ),
            ("unfocused", number(metrics.focus.unfocused_fraction.map(|share| 100.0 * share), 1), "% of the picture"),
            (
                "mask",
                number(metrics.mask.as_ref().and_then(|mask| mask.separability), 2),
                "separability; good: above 0.9",
            ),
        ];
        for (what, value, means) in rows {
            if let Some(value) = value {
                let _ = writeln!(out, "  {what:10} {value} {means}");
            }
        }
        let explained = explained(&self.warnings, &metrics.findings);
        let because = explained.first().filter(|worst| worst.explanation.verdict > Verdict::Use);
        let because = because.map(|worst| format!(": {}", worst.explanation.title)).unwrap_or_default();
        let _ = writeln!(out, "  verdict    {}{because}", self.verdict.words());
        for Explained { code, detail, explanation, .. } in explained {
            let what = if self.warnings.iter().any(|warning| warning.detail == detail) { "warning" } else { "note" };
            let _ = writeln!(out, "  {what:10} {detail} ({code})");
            if explanation.verdict > Verdict::Use {
                let _ = writeln!(out, "             {}", explanation.cure);
            }
        }
        let files: Vec<&str> = self.files.values().map(String::as_str).collect();
        let _ = writeln!(out, "  files      {}: {}", self.folder.display(), files.join(" "));
        out
    }
}
