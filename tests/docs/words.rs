//! The rules of `docs/CONTRIBUTING.md` about words that a test can check: line length, terms that were given up, and
//! words that hide what is meant.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// Longest line of Markdown and of a comment, in characters.
const LONGEST_LINE: usize = 120;

/// Terms that the project gave up, and what replaces each. They are found in prose and inside identifiers.
const TERMS: [(&str, &str); 14] = [
    ("unveil", "halo correction"),
    ("unveiled", "halo_corrected"),
    ("veil", "defocus spread"),
    ("overreach", "foreground fattening"),
    ("lockin", "phase"),
    ("sighting", "detection"),
    ("spotted", "measured dot"),
    ("foul", "foreign"),
    ("strangers", "foreign dots"),
    ("lifeline", "lease keeper"),
    ("pressed", "written artifact"),
    ("teller", "event stream, or diagnosis"),
    ("rival", "takeover"),
    ("unwatched", "NoControl"),
];

/// Phrases that hide what is meant, and what to write instead. They are found in prose.
const PHRASES: [(&str, &str); 14] = [
    ("nobody", "no one, or name who"),
    ("whoever", "name who"),
    ("astray", "wrong"),
    ("is none of", "is not"),
    ("leave it away", "omit it"),
    ("over its time", "expired"),
    ("over their time", "expired"),
    ("so long", "as long as, or meanwhile"),
    ("the house", "the architecture"),
    ("goes the way of", "uses"),
    ("shall", "must, or will"),
    ("is over by", "has expired by"),
    ("somebody else", "another client"),
    ("for nobody", "for no one"),
];

/// Lines of these files may name what they forbid or accept for compatibility.
const EXEMPT: [&str; 1] = ["tests/docs/words.rs"];

/// A line may hold `unveiled` where the older name of the method is accepted.
fn is_alias(line: &str) -> bool {
    line.contains("`unveiled`") || line.contains("\"unveiled\"") || line.contains("=unveiled")
}

fn find(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the folder can be read") {
        let path = entry.expect("the folder can be read").path();
        if path.is_dir() {
            if !path.ends_with("target") && !path.ends_with("corpus") {
                find(&path, extensions, found);
            }
        } else if path.extension().is_some_and(|e| extensions.iter().any(|known| e == *known)) {
            found.push(path);
        }
    }
}

/// Path and text of every file of the project with one of these extensions.
fn files(project: &Path, extensions: &[&str]) -> Vec<(String, String)> {
    let mut paths = ["README.md", "CHANGELOG.md", "SECURITY.md"].map(|name| project.join(name)).to_vec();
    for folder in ["docs", "science/src", "src", "science/benches", "tests", "openapi"] {
        find(&project.join(folder), extensions, &mut paths);
    }
    paths
        .into_iter()
        .filter(|path| path.extension().is_some_and(|e| extensions.iter().any(|known| e == *known)))
        .map(|path| {
            let text = fs::read_to_string(&path).expect("UTF-8");
            (path.strip_prefix(project).expect("inside the project").display().to_string(), text)
        })
        .filter(|(path, _)| !EXEMPT.contains(&path.as_str()))
        .collect()
}

/// True when `line` holds `phrase` with no letter on either side; case does not matter.
fn holds(line: &str, phrase: &str) -> bool {
    let line = line.to_lowercase();
    line.match_indices(phrase).any(|(at, _)| {
        let letter = |c: Option<char>| c.is_some_and(char::is_alphabetic);
        !letter(line[..at].chars().next_back()) && !letter(line[at + phrase.len()..].chars().next())
    })
}

fn check(project: &Path, what: &[(&str, &str)], extensions: &[&str]) {
    let mut found = Vec::new();
    for (path, text) in files(project, extensions) {
        for (at, line) in text.lines().enumerate().filter(|(_, line)| !is_alias(line)) {
            for (phrase, better) in what {
                if holds(line, phrase) {
                    found.push(format!("{path}:{}: '{phrase}'; write: {better}", at + 1));
                }
            }
        }
    }
    assert!(found.is_empty(), "{} lines:\n{}", found.len(), found.join("\n"));
}

#[test]
fn terms_that_were_given_up_are_not_used() {
    check(super::project(), &TERMS, &["rs", "md", "json"]);
}

#[test]
fn prose_is_free_of_phrases_that_hide_what_is_meant() {
    check(super::project(), &PHRASES, &["rs", "md", "json"]);
}

#[test]
fn markdown_and_comments_wrap() {
    let mut long = Vec::new();
    for (path, text) in files(super::project(), &["rs", "md"]) {
        let is_markdown = path.ends_with(".md");
        let mut in_code = false;
        for (at, line) in text.lines().enumerate() {
            if is_markdown && line.trim_start().starts_with("```") {
                in_code = !in_code;
            }
            let text = line.trim_start().trim_start_matches(['/', '!']).trim_start();
            // a row of a table cannot wrap, nor can a picture or an address
            let can_wrap = !text.starts_with('|') && !line.starts_with("![") && !line.contains("https://");
            let is_prose = match is_markdown {
                true => !in_code,
                false => line.trim_start().starts_with("//"),
            };
            if is_prose && can_wrap && line.chars().count() > LONGEST_LINE {
                long.push(format!("{path}:{}: {} characters", at + 1, line.chars().count()));
            }
        }
    }
    assert!(long.is_empty(), "{} lines are longer than {LONGEST_LINE}:\n{}", long.len(), long.join("\n"));
}

#[test]
fn phrases_are_found_as_whole_words_in_prose_and_identifiers() {
    assert!(holds("Nobody asks", "nobody") && holds("fn nobody_is_let_in()", "nobody"));
    assert!(!holds("unveiled", "veil") && !holds("surveillance", "veil"));
}
