//! Runs the commands of README.md and docs/*.md, and checks the tables, links and test names of the documents.
//!
//! All `sh` blocks of a file run in order in one shell and one empty folder; `cargo run --release --` is replaced by
//! the binary under test, and port 8080 by a free port. A block with a second word (`sh docker`, `sh bench`) needs more
//! than a test has, and is not run, except `sh colmap`.

mod demo;
mod deploy;
mod links;
mod monitoring;
mod powershell;
mod release;
mod tables;
mod words;

use std::{
    fs,
    net::TcpListener,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::Command,
};

use pinstack_science::types::WarningCode;
use tempfile::TempDir;

fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The Markdown files of `docs` and of its folders.
fn pages() -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![project().join("docs")]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("docs can be read") {
            let path = entry.expect("docs can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                found.push(path);
            }
        }
    }
    found
}

/// The `sh` and, if wanted, `sh colmap` blocks of a Markdown file.
fn blocks(markdown: &str, with_colmap: bool) -> Vec<String> {
    let mut found = Vec::new();
    let mut current: Option<String> = None;
    for line in markdown.lines() {
        match (&mut current, line.trim_end()) {
            (None, "```sh") => current = Some(String::new()),
            (None, "```sh colmap") if with_colmap => current = Some(String::new()),
            (Some(_), "```") => found.extend(current.take()),
            (Some(block), line) => {
                block.push_str(line);
                block.push('\n');
            }
            (None, _) => {}
        }
    }
    found
}

/// Makes a folder with the commands `cargo` and `pinstack`, which both run the binary under test.
fn shims(folder: &Path) -> PathBuf {
    let binary = env!("CARGO_BIN_EXE_pinstack");
    let bin = folder.join("bin");
    fs::create_dir(&bin).expect("a folder for the shims");
    let cargo = format!(
        "#!/bin/sh\ncase \"$1 $2 $3\" in\n'run --release --') shift 3; exec {binary} \"$@\";;\n'test  ') exit 0;;\nesac\necho \"cargo $*: not a command of the README\" >&2\nexit 1\n"
    );
    for (name, text) in [("cargo", cargo), ("pinstack", format!("#!/bin/sh\nexec {binary} \"$@\"\n"))] {
        let path = bin.join(name);
        fs::write(&path, text).expect("a shim");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("an executable shim");
    }
    bin
}

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port()
}

/// Runs every `sh` block of `file` and fails with the output of a failed one. Returns the folder in which they ran, if
/// there are any.
fn run_commands_of(file: &Path) -> Option<TempDir> {
    let markdown = fs::read_to_string(file).expect("the document is UTF-8");
    run_commands(file, &blocks(&markdown, true))
}

/// The same with these blocks of `file`.
fn run_commands(file: &Path, blocks: &[String]) -> Option<TempDir> {
    if blocks.is_empty() {
        return None;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let bin = shims(folder.path());
    let home = folder.path().join("here");
    fs::create_dir(&home).expect("a folder");
    // Servers started in the background end with the script, also when a command fails.
    let script = format!(
        "set -euo pipefail\ntrap 'kill $(jobs -p) 2>/dev/null || true; wait' EXIT\nset -x\n{}",
        blocks.join("\n").replace("8080", &free_port().to_string())
    );
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap_or_default());
    let output = Command::new("bash")
        .args(["-c", &script])
        .current_dir(&home)
        .env("PATH", path)
        .output()
        .expect("bash can be started");
    assert!(
        output.status.success(),
        "a command of {} failed:\n{}\n{}",
        file.display(),
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    Some(folder)
}

#[test]
#[ignore = "needs bash, curl, python3"]
fn the_commands_of_the_readme_work_and_the_demo_is_as_good_as_the_tables_say() {
    let folder = run_commands_of(&project().join("README.md")).expect("README.md has commands");
    let here = folder.path().join("here");
    for made in ["demo-out/metrics.json", "beetle_metrics.json"] {
        let text = fs::read(here.join(made)).expect("the commands left it");
        tables::check_good_values(project(), &serde_json::from_slice(&text).expect("JSON"));
    }
    let report = fs::read_to_string(here.join("report.html")).expect("the commands left it");
    let told = report.split("rincipal distance</dt><dd>").nth(1).unwrap_or_default();
    let distance = told.split(' ').next().and_then(|text| text.parse::<f64>().ok());
    assert!(distance.is_some_and(|mm| (mm - 130.0).abs() < 0.1), "65 mm at magnification 1, told: {:.80}", told);
}

/// Words of the tutorial, and what its shorter test says instead: the same scan in smaller pictures of fewer slices.
const SMALLER: [(&str, &str); 2] = [
    ("pinstack demo --scan --render-only\n", "pinstack demo --scan --render-only --width 300 --slices 5\n"),
    // of a sensor 36 mm wide
    ("pixel_pitch_mm=0.06&", "pixel_pitch_mm=0.12&"),
];

/// Checks what the commands of the tutorial left in the folder `here`, COLMAP aside.
fn check_tutorial(here: &Path) {
    let outliers = fs::read_to_string(here.join("outliers.txt")).expect("the commands left it");
    assert!(outliers.lines().all(|line| line.starts_with("pan120_tilt12 ")), "{outliers}");
    let hull = fs::read_to_string(here.join("hull.ply")).expect("the commands left it");
    let numbers = |line: &str| line.split(' ').map(str::parse).collect::<Result<Vec<f64>, _>>().ok();
    let points: Vec<Vec<f64>> = hull.lines().filter_map(numbers).filter(|numbers| numbers.len() == 3).collect();
    for (axis, side_mm) in [9.39, 16.0, 17.64].into_iter().enumerate() {
        let along = points.iter().map(|point| point[axis]);
        let [low, high] = [along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max)];
        assert!((high - low - side_mm).abs() < 0.8, "side {axis} of the hull is {} mm, truly {side_mm}", high - low);
    }
}

#[test]
#[ignore = "needs bash, curl, python3"]
fn the_commands_of_the_tutorial_work_with_smaller_pictures() {
    let file = project().join("docs/TUTORIAL.md");
    let mut blocks = blocks(&fs::read_to_string(&file).expect("UTF-8"), false);
    for (words, instead) in SMALLER {
        assert_eq!(blocks.iter().map(|block| block.matches(words).count()).sum::<usize>(), 1, "{words}");
        blocks = blocks.iter().map(|block| block.replace(words, instead)).collect();
    }
    check_tutorial(&run_commands(&file, &blocks).expect("the tutorial has commands").path().join("here"));
}

#[test]
#[ignore = "more cases of a test"]
fn more_commands_of_the_tutorial_work_as_they_are_and_with_colmap() {
    let folder = run_commands_of(&project().join("docs/TUTORIAL.md")).expect("the tutorial has commands");
    let here = folder.path().join("here");
    check_tutorial(&here);
    let report = fs::read_to_string(here.join("poses.txt")).expect("the commands left it");
    let registered = report.lines().find(|line| line.starts_with("registered")).unwrap_or_default();
    assert!(registered.contains("36 of 36"), "{report}");
    assert!(here.join("points.ply").exists());
}

#[test]
#[ignore = "needs bash, curl, python3"]
fn the_commands_of_the_docs_work() {
    for page in pages().iter().filter(|page| !page.ends_with("TUTORIAL.md")) {
        run_commands_of(page);
    }
}

#[test]
fn every_warning_of_the_metrics_is_explained() {
    let read = |name: &str| fs::read_to_string(project().join("docs").join(name)).expect("UTF-8");
    let (metrics, findings, explained) = (read("METRICS.md"), read("FINDINGS.md"), read("TROUBLESHOOTING.md"));
    let mut codes = Vec::new();
    let sections = [(&findings, "## Findings"), (&findings, "## Other warnings of a stack"), (&metrics, "## `mask`")];
    for (text, heading) in sections {
        for row in tables::rows(tables::section(text, heading)) {
            // the fields of the mask are in a table of the same section
            let is_code = |code: &&str| heading != "## `mask`" || code.starts_with("mask_");
            codes.extend(row[0].split('`').step_by(2).filter(is_code).map(str::to_owned));
        }
    }
    assert!(codes.len() > 30, "{codes:?}");
    let missing: Vec<_> = codes.iter().filter(|code| !explained.contains(&format!("\n### `{code}`\n"))).collect();
    assert!(missing.is_empty(), "TROUBLESHOOTING.md does not explain {missing:?}");
    let headings = explained.lines().filter_map(|line| line.strip_prefix("### `")?.strip_suffix('`'));
    let named = codes.iter().map(String::as_str).chain(headings);
    let unknown: Vec<_> = named.filter(|code| !WarningCode::ALL.iter().any(|known| known == code)).collect();
    assert!(unknown.is_empty(), "no warning has the code {unknown:?}");
}

#[test]
fn every_code_of_a_warning_is_in_a_table_or_a_heading() {
    let documents: Vec<String> = ["TROUBLESHOOTING", "METRICS", "FINDINGS", "CALIBRATION", "SCANS"]
        .map(|name| fs::read_to_string(project().join(format!("docs/{name}.md"))).expect("a document"))
        .into();
    // a row may name several codes
    let explains = |line: &str, quoted: &str| {
        let first = line.strip_prefix("| ").and_then(|row| row.split(" | ").next());
        line.strip_prefix("### ") == Some(quoted) || first.is_some_and(|cell| cell.contains(quoted))
    };
    let explained =
        |code: &WarningCode| documents.iter().any(|text| text.lines().any(|line| explains(line, &format!("`{code}`"))));
    let missing: Vec<_> = WarningCode::ALL.iter().filter(|code| !explained(code)).collect();
    assert!(missing.is_empty(), "no document explains {missing:?}");
}

#[test]
fn only_blocks_of_sh_and_of_colmap_are_commands() {
    let text = "```sh\na\nb\n```\n```sh docker\nc\n```\n```text\nd\n```\n```sh colmap\ne\n```\n";
    assert_eq!(blocks(text, true), ["a\nb\n", "e\n"]);
    assert_eq!(blocks(text, false), ["a\nb\n"]);
}

#[test]
fn every_test_that_a_guarantee_names_exists() {
    fn read(folder: &Path, all: &mut String) {
        for entry in fs::read_dir(folder).expect("the sources can be read") {
            let path = entry.expect("the sources can be read").path();
            if path.is_dir() {
                read(&path, all);
            } else if path.extension().is_some_and(|e| e == "rs") {
                all.push_str(&fs::read_to_string(&path).expect("source is UTF-8"));
            }
        }
    }
    let mut sources = String::new();
    read(&project().join("science/src"), &mut sources);
    read(&project().join("src"), &mut sources);
    read(&project().join("tests"), &mut sources);
    let text = fs::read_to_string(project().join("docs/GUARANTEES.md")).expect("UTF-8");
    let names = text.split('`').skip(1).step_by(2).filter(|name| name.matches('_').count() >= 3);
    for name in names {
        assert!(sources.contains(&format!("fn {name}(")), "no test is called {name}");
    }
}
