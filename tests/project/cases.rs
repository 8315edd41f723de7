//! Tests that take more cases of a test: they are ignored for that reason, by which `.ci/run` finds them, and their
//! names say so.

use std::fs;

use crate::source::rust_files;

/// The attribute of these tests.
const MORE: &str = "#[ignore = \"more cases of a test\"]";

#[test]
fn tests_with_more_cases_have_names_of_their_own_that_say_so() {
    let (mut of_more, mut of_others) = (Vec::new(), Vec::new());
    for path in rust_files(&["science/src", "src", "tests"]) {
        let text = fs::read_to_string(&path).expect("source is UTF-8");
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        for (at, line) in lines.iter().enumerate() {
            let Some(function) = line.trim_start_matches("async ").strip_prefix("fn ") else { continue };
            let name = function.split('(').next().unwrap_or_default().to_owned();
            let mut attributes = lines[..at].iter().rev().take_while(|line| line.starts_with("#["));
            let names = if attributes.any(|line| *line == MORE) { &mut of_more } else { &mut of_others };
            names.push(name);
        }
    }
    assert!(of_more.len() > 20, "{of_more:?}");
    let wrong: Vec<&String> = of_more.iter().filter(|name| !name.starts_with("more_")).collect();
    assert!(wrong.is_empty(), "the names of tests that have {MORE} begin with `more_`: {wrong:?}");
    // `--skip` leaves out every test whose path contains the name
    let also: Vec<&String> = of_others.iter().filter(|other| of_more.iter().any(|more| other.contains(more))).collect();
    assert!(also.is_empty(), "these would be left out with a test of more cases: {also:?}");
}
