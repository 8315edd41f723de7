//! Runs other programs.

use std::process::Command;

/// Runs a program and returns its output.
pub fn run(program: &mut Command) -> String {
    let output = program.output().unwrap_or_else(|e| panic!("{program:?} cannot be started: {e}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{program:?} failed:\n{text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}
