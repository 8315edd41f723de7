//! The floors of the house, held by reading the source: `docs/ARCHITECTURE.md` says why.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// From the ground up. A module may name only modules that stand before it in this list.
const FLOORS: [&[&str]; 13] = [
    &["model"],
    &["imaging"],
    &["synth"],
    &["quality"],
    &["fusion", "calibration"],
    &["archive"],
    // the line: above it there may be async code, a database and a clock
    &["telemetry"],
    &["store"],
    &["disk_budget"],
    &["jobs"],
    &["worker"],
    &["http"],
    &["cli"],
];

/// How many floors are pure.
const PURE: usize = 6;

/// What a pure floor must not name.
const IMPURE: [&str; 12] = [
    "tokio",
    "axum",
    "sqlx",
    "tower",
    "tower_http",
    "reqwest",
    "tracing",
    "SystemTime",
    "Instant",
    "Timestamp::now",
    "Zoned::now",
    "async fn",
];

const LONGEST_FILE: usize = 600;

fn floor_of(module: &str) -> Option<usize> {
    FLOORS.iter().position(|floor| floor.contains(&module))
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("src can be read") {
        let path = entry.expect("src can be read").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Every source file with the module it belongs to and its code without comments.
fn files() -> Vec<(PathBuf, String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    sources(&root, &mut paths);
    paths
        .into_iter()
        .map(|path| {
            let relative = path.strip_prefix(&root).expect("inside src").to_path_buf();
            let first = relative.components().next().expect("a file").as_os_str().to_string_lossy();
            let module = first.trim_end_matches(".rs").to_owned();
            let text = fs::read_to_string(&path).expect("source is UTF-8");
            let code: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
            (relative, module, code.join("\n"))
        })
        .collect()
}

/// Modules named as `crate::name` in a piece of code, grouped imports (`crate::{a, b::c}`) included.
fn named_modules(code: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let word = |text: &str| text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        if !rest.starts_with('{') {
            names.push(word(rest));
            continue;
        }
        let (mut depth, mut start) = (0, true);
        for (i, c) in rest.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                break;
            }
            if depth == 1 && (c == '{' || c == ',') {
                start = true;
            } else if start && !c.is_whitespace() {
                names.push(word(&rest[i..]));
                start = false;
            }
        }
    }
    names
}

#[test]
fn every_module_imports_only_from_the_floors_below_it() {
    let mut wrong = Vec::new();
    for (path, module, code) in files() {
        let Some(own) = floor_of(&module) else { continue };
        for name in named_modules(&code) {
            let Some(other) = floor_of(&name) else { continue };
            if other > own || (other == own && name != module) {
                wrong.push(format!("{} names crate::{name}, which is not below {module}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_module_has_its_floor() {
    for (path, module, _) in files() {
        let known = ["lib", "main", "science"].contains(&module.as_str()) || floor_of(&module).is_some();
        assert!(known, "{} belongs to no floor: add its module to FLOORS", path.display());
    }
}

#[test]
fn the_science_knows_no_runtime_no_database_and_no_clock() {
    let mut wrong = Vec::new();
    for (path, module, code) in files() {
        if floor_of(&module).is_none_or(|floor| floor >= PURE) {
            continue;
        }
        for word in IMPURE {
            let named = code.match_indices(word).any(|(at, _)| {
                let before = code[..at].chars().next_back();
                let after = code[at + word.len()..].chars().next();
                let part_of_a_word = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
                !part_of_a_word(before) && !part_of_a_word(after)
            });
            if named {
                wrong.push(format!("{} names {word}", path.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn one_file_alone_names_the_zip_crate_below_the_line() {
    let naming: Vec<String> = files()
        .into_iter()
        .filter(|(_, _, code)| code.contains("zip::") && !code.contains("crate::zip"))
        .filter(|(_, _, code)| {
            code.lines().any(|line| line.trim_start().starts_with("use zip") || line.contains(" zip::"))
        })
        .map(|(path, _, _)| path.display().to_string())
        .collect();
    assert!(naming.len() <= 1, "the zip crate is named by {}", naming.join(", "));
}

#[test]
fn work_beside_a_request_keeps_the_request_in_its_log_lines() {
    let mut wrong = Vec::new();
    for (path, module, code) in files() {
        let starts_tasks = path.ends_with("http/background.rs") || path.ends_with("http/serve.rs");
        if module == "http"
            && !starts_tasks
            && (code.contains("tokio::spawn(") || code.contains("task::spawn_blocking("))
        {
            wrong.push(format!("{} starts a task by itself; use http::background", path.display()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_file_is_too_long_to_have_one_reason_to_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    for (path, _, _) in files() {
        let lines = fs::read_to_string(root.join(&path)).expect("source is UTF-8").lines().count();
        assert!(lines <= LONGEST_FILE, "{} has {lines} lines; split it (at most {LONGEST_FILE})", path.display());
    }
}

#[test]
fn grouped_imports_are_understood() {
    let code = "use crate::{a::x, b::{self, c}, d};\nlet y = crate::e::f();";
    assert_eq!(named_modules(code), ["a", "b", "d", "e"]);
}
