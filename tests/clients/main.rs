//! The service as the programs that people have see it: curl, zip, 7z, Python's zipfile, exiftool, COLMAP, tus clients, a
//! browser, Schemathesis, which asks it whether it keeps its contract, clients that generators make, and linters of the
//! document.
//!
//! Each test needs programs that a fresh machine may lack; it is skipped where they are missing, and fails when
//! `PINSTACK_TEST_TOOLS=required` says that they must be there.

mod browser;
mod contract;
mod crash;
mod durability;
mod generated;
mod lint;
mod metadata;
mod photogrammetry;
mod proxy;
mod server;
mod tls;
mod tus;
mod zips;

use std::process::Command;

/// True when every program is here. `tuspy`, `pydantic` and `tus-js-client` are libraries that Python and node must find.
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
        "tus-js-client" => "node -e 'require(\"tus-js-client\")'".to_owned(),
        program => format!("command -v {program}"),
    };
    let found = Command::new("sh").args(["-c", &command]).output();
    found.is_ok_and(|output| output.status.success())
}

/// Runs a program and gives what it printed.
fn run(program: &mut Command) -> String {
    let output = program.output().unwrap_or_else(|e| panic!("{program:?} cannot be started: {e}"));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{program:?} failed:\n{text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}
