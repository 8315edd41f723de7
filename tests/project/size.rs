//! The size of the code: lines, files and what is written twice. The numbers may only shrink; a commit that raises one
//! says why.

use std::{
    collections::{BTreeSet, HashMap},
    fs,
    path::Path,
};

use crate::source::{Graph, SOURCES, project, rust_files};

/// Production lines of both crates: code, comments and blanks, without what stands behind `#[cfg(test)]`.
const MOST_PRODUCTION_LINES: usize = 106_000;

/// Lines of a source file, tests included.
const LONGEST_FILE: usize = 350;

/// Pairs of production files that have a run of [`RUN`] equal lines of code.
const MOST_EQUAL_PAIRS: usize = 2;

/// Lines of code that are a run: lines of punctuation alone do not count.
const RUN: usize = 8;

/// Examples in the documentation of the science.
const FEWEST_EXAMPLES: usize = 15;

#[test]
fn the_code_does_not_grow() {
    let mut total = 0;
    let mut areas: HashMap<String, usize> = HashMap::new();
    for folder in SOURCES {
        let graph = Graph::of(folder);
        for (file, lines) in graph.production_lines() {
            let area: Vec<&str> = file.split('/').skip(folder.split('/').count()).take(1).collect();
            *areas.entry(format!("{folder}/{}", area.concat())).or_default() += lines;
            total += lines;
        }
    }
    let mut table: Vec<(String, usize)> = areas.into_iter().collect();
    table.sort_by_key(|(_, lines)| std::cmp::Reverse(*lines));
    for (area, lines) in table {
        println!("{lines:7} {area}");
    }
    println!("{total:7} production lines");
    assert!(total <= MOST_PRODUCTION_LINES, "{total} production lines; at most {MOST_PRODUCTION_LINES}");
}

#[test]
fn no_file_is_too_long_to_have_one_purpose() {
    let too_long: Vec<String> = rust_files(SOURCES)
        .into_iter()
        .map(|path| (fs::read_to_string(&path).expect("source is UTF-8").lines().count(), path))
        .filter(|(lines, _)| *lines > LONGEST_FILE)
        .map(|(lines, path)| format!("{} has {lines} lines", path.display()))
        .collect();
    assert!(too_long.is_empty(), "split these files (at most {LONGEST_FILE} lines):\n{}", too_long.join("\n"));
}

#[test]
fn the_same_lines_are_not_written_twice() {
    // a run may begin at any line; files with the same run are a pair once
    let mut seen: HashMap<Vec<String>, String> = HashMap::new();
    let mut pairs: BTreeSet<(String, String)> = BTreeSet::new();
    for folder in SOURCES {
        let graph = Graph::of(folder);
        for (index, file) in graph.files.iter().enumerate() {
            for run in graph.code_lines(index).windows(RUN) {
                let first = seen.entry(run.to_vec()).or_insert_with(|| file.clone());
                if first != file {
                    pairs.insert((first.clone(), file.clone()));
                }
            }
        }
    }
    let listed: Vec<String> = pairs.iter().map(|(a, b)| format!("{a} ~ {b}")).collect();
    println!("{} pairs of files with {RUN} equal lines", listed.len());
    assert!(listed.len() <= MOST_EQUAL_PAIRS, "{RUN} equal lines in a row:\n{}", listed.join("\n"));
}

#[test]
fn operations_of_the_science_have_examples() {
    let mut examples = 0;
    for path in rust_files(&["science/src"]) {
        let text = fs::read_to_string(&path).expect("source is UTF-8");
        let mut inside = false;
        for line in text.lines().map(str::trim_start) {
            let Some(doc) = line.strip_prefix("///").or_else(|| line.strip_prefix("//!")) else {
                inside = false;
                continue;
            };
            let Some(language) = doc.trim().strip_prefix("```") else { continue };
            if !inside && (language.is_empty() || language == "no_run") {
                examples += 1;
            }
            inside = !inside;
        }
    }
    assert!(examples >= FEWEST_EXAMPLES, "{examples} examples; at least {FEWEST_EXAMPLES}");
}

#[test]
fn codes_of_warnings_are_not_compared_as_text() {
    let mut wrong = Vec::new();
    for folder in SOURCES {
        let graph = Graph::of(folder);
        for (index, file) in graph.files.iter().enumerate().filter(|(_, file)| !file.ends_with("warning_code.rs")) {
            let lines = graph.code_lines(index);
            let compares = |line: &&String| {
                let code = line.split("code").nth(1).unwrap_or_default().trim_start_matches(".as_str()").trim_start();
                (code.starts_with("== \"") || code.starts_with("!= \"")) || line.contains("match warning.code.as_str()")
            };
            wrong.extend(lines.iter().filter(compares).map(|line| format!("{file}: {line}")));
        }
    }
    assert!(wrong.is_empty(), "compare with a variant of WarningCode:\n{}", wrong.join("\n"));
}

#[test]
fn a_result_in_a_result_has_names_instead() {
    let mut wrong = Vec::new();
    for path in rust_files(SOURCES) {
        let text = fs::read_to_string(&path).expect("source is UTF-8");
        for (number, line) in text.lines().enumerate() {
            let code = line.split("//").next().unwrap_or_default();
            // `Result<Result`, `StoreResult<ApiResult` and their kind
            let nested = code.match_indices("Result<").any(|(at, found)| {
                let inner = &code[at + found.len()..];
                let name: String = inner.chars().take_while(|c| c.is_alphanumeric()).collect();
                name.ends_with("Result") && inner[name.len()..].starts_with('<')
            });
            if nested {
                wrong.push(format!("{}:{}: {}", shown(&path), number + 1, line.trim()));
            }
        }
    }
    assert!(wrong.is_empty(), "return an enum whose cases have names:\n{}", wrong.join("\n"));
}

fn shown(path: &Path) -> String {
    path.strip_prefix(project()).unwrap_or(path).display().to_string()
}
