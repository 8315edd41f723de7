//! The OpenAPI document, checked by common linters.

use std::{fs, process::Command};

use crate::run;

/// Runs a linter on the OpenAPI document of the program and checks that it finds no error.
fn linted(program: &str, arguments: &[&str]) {
    let folder = tempfile::tempdir().expect("a folder");
    let document = folder.path().join("openapi.json");
    fs::write(&document, run(Command::new(env!("CARGO_BIN_EXE_pinstack")).arg("openapi"))).expect("the document");
    fs::write(folder.path().join("ruleset.yaml"), "extends: [\"spectral:oas\"]\n").expect("a rule set");
    let output = Command::new(program)
        .arg("lint")
        .args(arguments)
        .arg(&document)
        .current_dir(folder.path())
        .env("REDOCLY_TELEMETRY", "off")
        .env("REDOCLY_SUPPRESS_UPDATE_NOTICE", "true")
        .output()
        .expect("the linter starts");
    let told = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{told}");
}

#[test]
#[ignore = "needs redocly"]
fn redocly_finds_no_error_in_the_document() {
    linted("redocly", &["--format", "stylish"]);
}

#[test]
#[ignore = "needs spectral"]
fn spectral_reports_nothing_about_the_document() {
    linted("spectral", &["--ruleset", "ruleset.yaml", "--fail-severity", "warn"]);
}
