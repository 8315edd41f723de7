//! The calibration report as one HTML page: the verdict and the findings in words, then residual maps and charts, then
//! a table of all values.
//!
//! Pure functions from a report to text. The page loads nothing and runs no script, and it contains its only style
//! sheet ([`STYLE`]). It can therefore be served under a strict content security policy, saved, mailed and printed.
//!
//! The maps and charts are written as inline SVG, without a plotting library. The SVG takes its colours from the style
//! sheet's variables and so follows dark mode and print; each mark has a `<title>` for pointers and screen readers;
//! names from the archive are escaped in one place; the ticks are exact and the bytes are the same in every run.
//! `plotters` writes fixed colours on elements without classes, so a style sheet cannot restyle a series. `charming`
//! renders with ECharts, that is with JavaScript, in the browser or in an embedded engine. Neither draws residual maps.
//! Either would replace about 350 lines here (axes and charts) and add dependencies.

mod axes;
pub(super) mod chart;
mod charts;
mod drift;
mod facts;
mod residual_maps;
mod slice_table;
mod style;

#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;

pub use style::STYLE;

use super::html;
use html::{escape, sentence};
use pinstack_science::types::report::{CalibrationReport, Drift, Grade};

/// What the report is about: the heading above the verdict.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Where the profile is.
    pub profile: SubjectProfile<'a>,
    /// When it was measured, as text.
    pub measured: &'a str,
    /// The user's note.
    pub note: Option<&'a str>,
}

/// The profile that a report is about.
#[derive(Debug, Clone, Copy)]
pub enum SubjectProfile<'a> {
    /// A profile of the service.
    Stored {
        /// Name of the rig.
        rig: &'a str,
        /// Name of the lens.
        lens: &'a str,
        /// The revision that the calibration made; `None` when the option `keep` excluded it.
        revision: Option<u32>,
    },
    /// A file, by its name.
    File(&'a str),
}

impl SubjectProfile<'_> {
    /// The text of the title, the heading as markup, and what became of the profile.
    fn shown(&self) -> [String; 3] {
        match *self {
            Self::File(name) => [name.to_owned(), format!("<bdi>{}</bdi>", escape(name)), "Profile file".to_owned()],
            Self::Stored { rig, lens, revision } => {
                let number = revision.map_or_else(|| "not kept".to_owned(), |revision| format!("revision {revision}"));
                let kept = revision.map(|revision| format!("Profile revision {revision}"));
                [
                    format!("{rig} with {lens}, {number}"),
                    format!("<bdi>{}</bdi> with <bdi>{}</bdi>", escape(rig), escape(lens)),
                    kept.unwrap_or_else(|| "Not kept as a profile revision".to_owned()),
                ]
            }
        }
    }
}

/// The whole page. `drift` compares with the previous revision, if there is one. Links to the overlay pictures are
/// relative (`overlay?slice=N`): the page is served beside them.
pub fn page(subject: &Subject<'_>, report: &CalibrationReport, drift: Option<&Drift>) -> String {
    let [of, ..] = subject.profile.shown();
    let title = format!("Calibration of {of}");
    let mut out = String::with_capacity(1 << 20);
    out.push_str("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    out.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n");
    out.push_str(&format!("<title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n", escape(&title)));
    out.push_str(&head(subject, report));
    out.push_str(&findings(report));
    out.push_str(&facts::facts(report));
    out.push_str(&residual_maps::residual_maps(report));
    out.push_str(&charts::charts(report));
    out.push_str(&facts::candidates(report));
    out.push_str(&drift::section(report, drift));
    out.push_str(&slice_table::slice_table(report));
    out.push_str("</main>\n</body>\n</html>\n");
    out
}

/// Rig, lens and the verdict. A word and a sign give the grade; the colour only repeats it.
fn head(subject: &Subject<'_>, report: &CalibrationReport) -> String {
    let (class, sign, word) = match report.grade {
        Grade::Good => ("good", "✓", "Good"),
        Grade::Usable => ("usable", "!", "Usable"),
        Grade::Poor => ("poor", "✕", "Poor"),
    };
    let note = subject.note.map(|note| format!("<p class=\"note\">“{}”</p>", escape(note))).unwrap_or_default();
    let [_, heading, kept] = subject.profile.shown();
    format!(
        "<header class=\"{class}\">\n<p class=\"over\">Calibration report</p>\n<h1>{heading}</h1>\n\
         <p class=\"sub\">{kept} · {}</p>\n\
         <div class=\"verdict\"><span class=\"grade\"><span aria-hidden=\"true\">{sign}</span> {word}</span>\n<p>{}</p></div>\n{note}\
         </header>\n",
        escape(subject.measured),
        escape(&without_grade(&report.verdict, word)),
    )
}

/// The verdict without the grade that it may begin with: the page shows the grade beside it.
fn without_grade(verdict: &str, word: &str) -> String {
    let Some(rest) = verdict.strip_prefix(word).and_then(|rest| rest.strip_prefix(": ")) else {
        return verdict.to_owned();
    };
    sentence(rest)
}

fn findings(report: &CalibrationReport) -> String {
    if report.findings.is_empty() {
        return "<section>\n<h2>Findings</h2>\n<p>No problems were found.</p>\n</section>\n".to_owned();
    }
    let items: String = report
        .findings
        .iter()
        .map(|finding| {
            format!("<li>{} <code>{}</code></li>\n", escape(&sentence(&finding.detail)), escape(finding.code.as_str()))
        })
        .collect();
    format!("<section>\n<h2>Findings</h2>\n<ul class=\"findings\">\n{items}</ul>\n</section>\n")
}
