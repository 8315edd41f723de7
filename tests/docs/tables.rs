//! Tables of the documents, read as data.

use std::{collections::BTreeMap, fs, path::Path, process::Command};

use serde_json::Value;

/// The cells of every row of the tables of a document whose first cell is in backticks, without these backticks.
pub fn rows(markdown: &str) -> Vec<Vec<String>> {
    let rows = markdown.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| {
        let mut cells: Vec<String> = row.trim().trim_matches('|').split('|').map(|c| c.trim().to_owned()).collect();
        cells[0] = cells[0].trim_matches('`').to_owned();
        cells
    })
    .collect()
}

/// The section of a document below a heading, to the next heading of any level.
pub fn section<'a>(markdown: &'a str, heading: &str) -> &'a str {
    let (_, rest) = markdown.split_once(heading).unwrap_or_else(|| panic!("no heading {heading}"));
    rest.split("\n#").next().unwrap_or_default()
}

/// Whether `value` satisfies a cell of the column "good".
fn is_good(value: &Value, cell: &str) -> bool {
    let number = |text: &str| text.trim().parse::<f64>().unwrap_or_else(|_| panic!("'{cell}' is no limit"));
    let measured = || value.as_f64().unwrap_or_else(|| panic!("{value} is no number"));
    if let Some(limit) = cell.strip_prefix("below ") {
        return measured() < number(limit);
    }
    if let Some(limit) = cell.strip_prefix("above ") {
        return measured() > number(limit);
    }
    if let Some((low, high)) = cell.split_once(" to ") {
        return (number(low)..=number(high)).contains(&measured());
    }
    let wanted: Value = serde_json::from_str(cell.trim_matches('`')).unwrap_or_else(|_| panic!("'{cell}' is no value"));
    match wanted.as_f64() {
        Some(wanted) => measured() == wanted,
        None => *value == wanted,
    }
}

/// Checks the metrics of a stack against the tables of good values in README.md and docs/METRICS.md.
pub fn check_good_values(project: &Path, metrics: &Value) {
    let readme = fs::read_to_string(project.join("README.md")).expect("UTF-8");
    let document = fs::read_to_string(project.join("docs/METRICS.md")).expect("UTF-8");
    let first = rows(section(&readme, "\n## Reading the metrics\n"));
    let all = rows(section(&document, "\n### What is good\n"));
    let all: Vec<_> = all.into_iter().filter(|row| row[0].contains('.')).collect();
    assert!(first.len() >= 5 && all.len() >= 10, "the tables were found");
    for row in first.iter().chain(&all) {
        let value = row[0].split('.').fold(metrics, |value, name| &value[name]);
        assert!(!value.is_null(), "the demo has no {}", row[0]);
        assert!(is_good(value, &row[1]), "the demo's {} is {value}; the documents say {}", row[0], row[1]);
    }
}

/// Each flag of `pinstack serve --help` with its help text.
fn flags() -> BTreeMap<String, String> {
    let output = Command::new(env!("CARGO_BIN_EXE_pinstack")).args(["serve", "--help"]).output().expect("it runs");
    let help = String::from_utf8(output.stdout).expect("UTF-8");
    let (mut flags, mut current) = (BTreeMap::new(), String::new());
    for line in help.lines() {
        let words = line.trim_start().trim_start_matches("-h, ").trim_start_matches("-V, ");
        if words.starts_with("--") {
            current = words.split([' ', '=', '[']).next().unwrap_or_default().to_owned();
            flags.insert(current.clone(), String::new());
        }
        if let Some(text) = flags.get_mut(&current) {
            text.push_str(line.trim());
            text.push(' ');
        }
    }
    flags.retain(|flag, _| !["--help", "--version", "--config"].contains(&flag.as_str()));
    flags
}

/// The text between `start` and the next closing bracket or comma.
fn bracketed<'a>(text: &'a str, start: &str) -> Option<&'a str> {
    text.split_once(start)?.1.split([']', ',']).next()
}

#[test]
fn the_table_of_settings_agrees_with_the_help_of_the_program() {
    let document = fs::read_to_string(super::project().join("docs/SETTINGS.md")).expect("UTF-8");
    let mut documented = BTreeMap::new();
    for row in rows(section(&document, "# Settings\n")) {
        // two flags may share a row
        let names = row[0].split('`').filter(|name| name.starts_with("--"));
        let variables = row[1].split('`').filter(|name| name.starts_with("PINSTACK_"));
        let defaults: Vec<&str> = row[2].split(',').map(|text| text.trim().trim_matches('`')).collect();
        for (i, (name, variable)) in names.zip(variables).enumerate() {
            let default = defaults.get(i).or(defaults.last()).copied().unwrap_or_default();
            documented.insert(name.to_owned(), (variable.to_owned(), default.to_owned()));
        }
    }
    let flags = flags();
    let (of_table, of_program): (Vec<_>, Vec<_>) = (documented.keys().collect(), flags.keys().collect());
    assert_eq!(of_table, of_program, "docs/SETTINGS.md against pinstack serve --help");
    for (flag, text) in flags {
        let (variable, default) = &documented[&flag];
        assert_eq!(bracketed(&text, "[env: "), Some(variable.as_str()), "{flag}: {text}");
        if let Some(said) = bracketed(&text, "[default: ") {
            assert_eq!(said, default, "{flag}: {text}");
        }
    }
}

#[test]
fn a_limit_of_a_table_is_understood() {
    let number = |value: f64| Value::from(value);
    for (value, cell) in [(0.4, "below 0.5"), (0.91, "above 0.9"), (1.02, "0.8 to 1.02"), (0.0, "0")] {
        assert!(is_good(&number(value), cell), "{value} {cell}");
    }
    for (value, cell) in [(0.5, "below 0.5"), (0.9, "above 0.9"), (1.03, "0.8 to 1.02"), (0.003, "0")] {
        assert!(!is_good(&number(value), cell), "{value} {cell}");
    }
    assert!(is_good(&Value::from(false), "`false`") && !is_good(&Value::from(true), "`false`"));
    assert!(is_good(&serde_json::json!([]), "`[]`") && !is_good(&serde_json::json!([3]), "`[]`"));
}
