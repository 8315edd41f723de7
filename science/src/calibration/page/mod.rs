//! The calibration report as one HTML page for the technician: what was found, in words first, then drawn, then as
//! numbers.
//!
//! Pure functions from a report to text. The page loads nothing, runs nothing, and carries its one style sheet
//! ([`STYLE`]) with it, so it can be served under a strict content policy, saved, mailed and printed.

mod axes;
mod chart;
mod charts;
mod facts;
mod html;
mod maps;
mod moved;
mod style;
mod table;

#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;

pub use style::STYLE;

use crate::types::report::{CalibrationReport, Drift, Grade};
use html::{escape, sentence};

/// What the report is about: the words over the verdict.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Name of the rig.
    pub rig: &'a str,
    /// Name of the lens.
    pub lens: &'a str,
    /// The profile revision that the calibration made.
    pub revision: u32,
    /// When it was measured, for a reader.
    pub measured: &'a str,
    /// What the user noted.
    pub note: Option<&'a str>,
}

/// The whole page. `drift` compares with the revision before, when there is one. Links to the slices with their
/// dots are relative (`overlay?slice=N`), so they work where the page lies beside them.
pub fn page(subject: &Subject<'_>, report: &CalibrationReport, drift: Option<&Drift>) -> String {
    let title = format!("Calibration of {} with {}, revision {}", subject.rig, subject.lens, subject.revision);
    let mut out = String::with_capacity(1 << 20);
    out.push_str("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n");
    out.push_str("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n");
    out.push_str(&format!("<title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n", escape(&title)));
    out.push_str(&head(subject, report));
    out.push_str(&findings(report));
    out.push_str(&facts::facts(report));
    out.push_str(&maps::maps(report));
    out.push_str(&charts::charts(report));
    out.push_str(&facts::candidates(report));
    out.push_str(&moved::moved(report, drift));
    out.push_str(&table::table(report));
    out.push_str("</main>\n</body>\n</html>\n");
    out
}

/// Rig, lens and the verdict. The grade is a word and a sign before it is a colour.
fn head(subject: &Subject<'_>, report: &CalibrationReport) -> String {
    let (class, sign, word) = match report.grade {
        Grade::Good => ("good", "✓", "Good"),
        Grade::Usable => ("usable", "!", "Usable"),
        Grade::Poor => ("poor", "✕", "Poor"),
    };
    let note = subject.note.map(|note| format!("<p class=\"note\">“{}”</p>", escape(note))).unwrap_or_default();
    format!(
        "<header class=\"{class}\">\n<p class=\"over\">Calibration report</p>\n<h1><bdi>{}</bdi> with <bdi>{}</bdi></h1>\n\
         <p class=\"sub\">Profile revision {} · {}</p>\n\
         <div class=\"verdict\"><span class=\"grade\"><span aria-hidden=\"true\">{sign}</span> {word}</span>\n<p>{}</p></div>\n{note}\
         </header>\n",
        escape(subject.rig),
        escape(subject.lens),
        subject.revision,
        escape(subject.measured),
        escape(&without_grade(&report.verdict, word)),
    )
}

/// The verdict may begin with the grade, which stands beside it already.
fn without_grade(verdict: &str, word: &str) -> String {
    let Some(rest) = verdict.strip_prefix(word).and_then(|rest| rest.strip_prefix(": ")) else {
        return verdict.to_owned();
    };
    sentence(rest)
}

fn findings(report: &CalibrationReport) -> String {
    if report.findings.is_empty() {
        return "<section>\n<h2>Findings</h2>\n<p>Nothing to put right.</p>\n</section>\n".to_owned();
    }
    let items: String = report
        .findings
        .iter()
        .map(|finding| {
            format!("<li>{} <code>{}</code></li>\n", escape(&sentence(&finding.detail)), escape(&finding.code))
        })
        .collect();
    format!("<section>\n<h2>Findings</h2>\n<ul class=\"findings\">\n{items}</ul>\n</section>\n")
}
