//! The words by which stacks and calibrations are found.
//!
//! A job is indexed under terms: every beginning of every word of its label, scan, rig, lens and file name; its rig,
//! lens and scan as they are; of a stack, the digest of its zip, which all runs of the same pictures share; and, once
//! it has ended, its verdict, or that it failed. A search looks up one term per word and per filter. Each lookup reads
//! rows of one index in the order of lists, so a page costs the same in a store of any size. A term begins with the
//! first letter of the kind of the job.
//!
//! A word is a run of letters and digits in lower case (`Pan020_tilt15` has two). A number that ends a word is a word
//! too (`IMG4711`). Each character of a script without blanks between words, such as Chinese, is a word.

use std::collections::BTreeSet;

use crate::contract::{JobKind, JobState, Verdict, request::JobRequest};
use pinstack_science::types::text;

/// Incremented when other terms, or other verdicts, follow from the same job: every store then indexes its jobs anew.
pub(in crate::store) const VERSION: i64 = 2;
/// The field of the digest of the zip of a stack.
pub(in crate::store) const ZIP: &str = "zip";
/// Longest beginning of a word that is indexed, in characters. Words that differ only after it are found as one.
const MAX_BEGINNING: usize = 24;
/// Words of a job that are indexed, and words of a search that are looked up.
const MAX_WORDS: usize = 40;

/// Numbers of stacks by verdict, for the head of a list. Each is counted up to [`FoundStacks::MOST`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FoundStacks {
    /// All that match.
    pub all: u64,
    /// Those of each verdict, in the order of [`Verdict::ALL`].
    pub verdicts: [u64; 3],
    /// Those that failed.
    pub failed: u64,
}

impl FoundStacks {
    /// A larger number is not counted: it stands for this one or more.
    pub const MOST: u64 = 10_000;
}

/// The terms of a job that is accepted.
pub(in crate::store) fn terms(rig: &str, lens: &str, request: &JobRequest) -> BTreeSet<String> {
    let (kind, scan) = (request.kind(), request.scan().map(|scan| scan.as_str()));
    let (label, zip) = match request {
        JobRequest::Stack(stack) => (stack.options.label.as_deref(), Some(stack.upload.sha256.as_str())),
        JobRequest::Calibration(_) | JobRequest::Reconstruction(_) => (None, None),
    };
    let file = request.upload().filename.as_deref();
    let exact = [("rig", Some(rig)), ("lens", Some(lens)), ("scan", scan), (ZIP, zip)];
    let mut terms: BTreeSet<String> =
        exact.into_iter().filter_map(|(field, value)| Some(exactly(kind, field, value?))).collect();
    let words = [label, scan, Some(rig), Some(lens), file].into_iter().flatten().flat_map(|text| {
        let words = words(text);
        let numbers: Vec<String> = words.iter().filter_map(|word| number_at_end(word)).collect();
        words.into_iter().chain(numbers)
    });
    for word in words.take(MAX_WORDS) {
        let ends = word.char_indices().map(|(at, c)| at + c.len_utf8()).take(MAX_BEGINNING);
        terms.extend(ends.map(|end| format!("{}/{}", letter(kind), &word[..end])));
    }
    terms
}

/// The terms that a job must have to match a text: one per word.
pub(in crate::store) fn wanted(kind: JobKind, text: &str) -> BTreeSet<String> {
    let beginning = |word: String| word.chars().take(MAX_BEGINNING).collect::<String>();
    words(text).into_iter().take(MAX_WORDS).map(|word| format!("{}/{}", letter(kind), beginning(word))).collect()
}

/// The term of a field that has this value.
pub(in crate::store) fn exactly(kind: JobKind, field: &str, value: &str) -> String {
    format!("{}:{field}={value}", letter(kind))
}

/// The end of the term of a verdict, after the letter of the kind.
pub(in crate::store) fn verdict(verdict: Verdict) -> String {
    format!(":is={}", verdict.as_str())
}

/// The same of a job that failed.
pub(in crate::store) const FAILED: &str = ":is=failed";

/// The same of a job that ended in this state with these warnings; `None` if it is not found by how it ended.
pub(in crate::store) fn ended(
    kind: JobKind,
    state: JobState,
    warnings: &[pinstack_science::types::Warning],
) -> Option<String> {
    match (kind, state) {
        (JobKind::Stack, JobState::Succeeded) => Some(verdict(crate::contract::verdict::verdict(warnings))),
        (_, JobState::Failed) => Some(FAILED.to_owned()),
        _ => None,
    }
}

/// The letter that the terms of a kind begin with.
pub(in crate::store) fn letter(kind: JobKind) -> &'static str {
    kind.as_str().get(..1).unwrap_or_default()
}

fn words(text: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word = String::new();
    for c in text::folded(text).chars().chain([' ']) {
        if c.is_alphanumeric() && !stands_alone(c) {
            word.push(c);
            continue;
        }
        if !word.is_empty() {
            words.push(std::mem::take(&mut word));
        }
        if stands_alone(c) {
            words.push(c.to_string());
        }
    }
    words
}

/// Letters of scripts that are written without blanks: kana, Han, and what lies between them.
fn stands_alone(c: char) -> bool {
    matches!(c, '\u{2e80}'..='\u{9fff}' | '\u{f900}'..='\u{faff}' | '\u{20000}'..='\u{3ffff}') && c.is_alphanumeric()
}

fn number_at_end(word: &str) -> Option<String> {
    let head = word.trim_end_matches(|c: char| c.is_ascii_digit());
    word.get(head.len()..).filter(|number| !number.is_empty() && !head.is_empty()).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_runs_of_letters_and_digits_in_any_script() {
        assert_eq!(words("Pan020_tilt15.zip"), ["pan020", "tilt15", "zip"]);
        assert_eq!(words("Käfer-4711 «Ä»"), ["käfer", "4711", "ä"]);
        assert_eq!(words("甲虫 No.3"), ["甲", "虫", "no", "3"]);
        assert_eq!(words(" -- "), Vec::<String>::new());
        assert_eq!((number_at_end("img4711"), number_at_end("4711")), (Some("4711".into()), None));
        let long = "x".repeat(60);
        assert_eq!(wanted(JobKind::Stack, &long).first().map(String::len), Some(2 + MAX_BEGINNING));
    }
}
