//! Every URL of the service in an answer is written by `link!`, and by `link` in the scripts of the pages: the service
//! may be below a sub-path.

use std::fs;

use crate::source::{Graph, project};

/// The first segments of what the service serves.
const SERVED: [&str; 13] = [
    "v1",
    "web",
    "stacks",
    "send",
    "scans",
    "profiles",
    "calibrations",
    "plan",
    "guide",
    "docs",
    "sign-in",
    "sign-out",
    "problems",
];

/// Whether a text within quotes is a path of the service.
fn is_served(literal: &str) -> bool {
    let Some(path) = literal.strip_prefix('/') else { return false };
    let first = path.split(['/', '?', '#', '{', '$']).next().unwrap_or_default();
    SERVED.contains(&first) || path.is_empty() || path.starts_with(['?', '#'])
}

/// The paths of the service within a line, each with what stands before and behind it.
fn paths<'a>(line: &'a str, quotes: &'a [char]) -> impl Iterator<Item = (&'a str, &'a str, &'a str)> {
    line.match_indices(quotes).filter_map(|(at, quote)| {
        let (before, rest) = (&line[..at], &line[at + quote.len()..]);
        let (literal, behind) = rest.split_once(quote).unwrap_or((rest, ""));
        is_served(literal).then_some((before, literal, behind))
    })
}

#[test]
fn no_answer_has_a_path_that_does_not_know_the_sub_path() {
    let graph = Graph::of("src");
    let mut wrong = Vec::new();
    for (at, file) in graph.files.iter().enumerate().filter(|(_, file)| file.starts_with("src/http/")) {
        for line in graph.code_lines(at) {
            for (before, literal, behind) in paths(&line, &['"']) {
                let is_attribute = before.ends_with('=') || before.ends_with("={ ");
                let is_text =
                    ["format!(", "Redirect::to(", "Redirect::permanent("].iter().any(|end| before.ends_with(end));
                let is_owned = [".to_owned()", ".into()", ".to_string()"].iter().any(|end| behind.starts_with(end));
                if is_attribute || is_text || is_owned {
                    wrong.push(format!("{file}: {literal}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "write these paths with link!:\n{}", wrong.join("\n"));
}

#[test]
fn no_script_of_the_pages_has_a_path_that_does_not_know_the_sub_path() {
    let folder = project().join("src/http/pages/assets");
    let (mut wrong, mut right) = (Vec::new(), 0);
    for file in fs::read_dir(folder).expect("the folder can be read").map(|file| file.expect("a file").path()) {
        if file.extension().is_none_or(|extension| extension != "js") {
            continue;
        }
        let text = fs::read_to_string(&file).expect("scripts are UTF-8");
        for (before, literal, _) in text.lines().flat_map(|line| paths(line, &['\'', '"', '`'])) {
            if before.ends_with("link(") {
                right += 1;
            } else if !before.ends_with("split(") {
                wrong.push(format!("{}: {literal}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "write these paths with link():\n{}", wrong.join("\n"));
    assert!(right >= 8, "{right} paths were found");
}

#[test]
fn paths_of_the_service_are_found() {
    let found = |line| paths(line, &['"', '`']).map(|(_, literal, _)| literal.to_owned()).collect::<Vec<_>>();
    assert_eq!(found(r#"a href="/" { "x" } b action="/v1/x?y""#), ["/", "/v1/x?y"]);
    assert_eq!(found("fetch(`/scans/${name}`)"), ["/scans/${name}"]);
    assert!(found(r#"at("/slices/0") "/{index}" "//x" "v1/a" "/tmp" "</p>""#).is_empty());
}
