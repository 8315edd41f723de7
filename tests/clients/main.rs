//! The service with third-party programs: curl, zip, 7z, Python's zipfile, exiftool, COLMAP, tus clients, a browser,
//! Schemathesis, generated clients, R, Octave, and linters of the OpenAPI document.
//!
//! Each test needs programs that may not be installed. It is then skipped, or fails with
//! `PINSTACK_TEST_TOOLS=required`.

mod browser;
mod contract;
mod crash;
mod durability;
mod generated;
mod languages;
mod lint;
mod metadata;
mod photogrammetry;
mod point_in_time;
mod proxy;
mod python;
mod scan;
mod server;
mod tls;
mod tus;
mod web;
mod zips;

use std::process::Command;

/// Whether every program is installed. Some are libraries of Python and node, see [`is_here`].
fn have(programs: &[&str]) -> bool {
    let missing: Vec<&str> = programs.iter().copied().filter(|p| !is_here(p)).collect();
    if missing.is_empty() {
        return true;
    }
    let needed = std::env::var("PINSTACK_TEST_TOOLS").as_deref() == Ok("required");
    assert!(!needed, "not installed: {}", missing.join(", "));
    println!("skipped: {} not installed", missing.join(", "));
    false
}

fn is_here(program: &str) -> bool {
    let command = match program {
        "tuspy" => "python3 -c 'import tusclient'".to_owned(),
        "pydantic" => "python3 -c 'import pydantic, urllib3, dateutil'".to_owned(),
        "pytest" => "python3 -c 'import pytest, httpx, typing_extensions'".to_owned(),
        "httr2" => "Rscript -e 'library(httr2); library(jsonlite); library(png)'".to_owned(),
        // its programs are not in PATH
        "postgresql" => "ls /usr/lib/postgresql/*/bin/initdb || command -v initdb".to_owned(),
        "tree-sitter-matlab" => "python3 -c 'import tree_sitter, tree_sitter_matlab'".to_owned(),
        library @ ("numpy" | "tifffile" | "pandas" | "mypy" | "ruff") => format!("python3 -c 'import {library}'"),
        package @ ("tus-js-client" | "playwright-core" | "axe-core") => format!("node -e 'require(\"{package}\")'"),
        program => format!("command -v {program}"),
    };
    let found = Command::new("sh").args(["-c", &command]).output();
    found.is_ok_and(|output| output.status.success())
}

/// Runs a program and returns its output.
fn run(program: &mut Command) -> String {
    let output = program.output().unwrap_or_else(|e| panic!("{program:?} cannot be started: {e}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{program:?} failed:\n{text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}
