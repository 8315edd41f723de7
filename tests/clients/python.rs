//! The Python client of the project: its own tests against the binary under test, its types and its style.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use crate::run;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/python")
}

/// A module of Python on the sources of the client. It writes no caches.
fn python(module: &str) -> Command {
    let mut command = Command::new("python3");
    command
        .args(["-m", module])
        .current_dir(folder())
        .env("PYTHONPATH", folder().join("src"))
        .env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

#[test]
#[ignore = "needs python3, 7z, pytest, httpx, numpy, tifffile, pandas, PyInstaller"]
fn the_python_client_passes_its_tests_against_the_service() {
    let binary = env!("CARGO_BIN_EXE_pinstack");
    let told = run(python("pytest").args(["-q", "-p", "no:cacheprovider"]).env("PINSTACK_TEST_BINARY", binary));
    assert!(!told.contains(" skipped"), "a library is missing:\n{told}");
}

#[test]
#[ignore = "needs python3, mypy, ruff, numpy, pandas"]
fn the_python_client_has_complete_types_and_the_style_of_its_settings() {
    run(python("mypy").args(["--cache-dir", "/dev/null", "src", "tools", "examples"]));
    run(python("ruff").args(["check", "--no-cache", "."]));
    run(python("ruff").args(["format", "--no-cache", "--check", "."]));
}
