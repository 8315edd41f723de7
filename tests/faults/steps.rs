//! The failpoints, as the sources name them.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

/// Calls that make something durable, or undo it.
const DURABLE: [&str; 16] = [
    ".commit()",
    "sync_all(",
    "sync_data(",
    "fs::rename(",
    "fs::remove_",
    "fs::create_dir",
    "fs::write(",
    "fs::copy(",
    "fs::hard_link(",
    ".set_len(",
    "create(true)",
    "create_new(true)",
    "File::create(",
    "tempfile_in(",
    "tempdir_in(",
    ".write_all(&",
];
/// Modules that write what clients rely on.
const MODULES: [&str; 4] = ["store", "jobs", "worker", "http"];
/// A failpoint is at most this many lines before its call.
const NEAR: usize = 4;
/// Files that write nothing that clients rely on: a cache of the web pages, the probe of `/readyz`, the space reserved
/// for deletions, the failpoints themselves, what a reconstruction writes to the scratch folder of its job (its
/// artifacts have the failpoint of all artifacts), and tests.
const EXEMPT: [&str; 9] = [
    "jobs/reconstruction/measured.rs",
    "jobs/reconstruction/mod.rs",
    "worker/pictures.rs",
    "http/state/conversions/pyramid.rs",
    "store/local/probe.rs",
    "store/sqlite/reserve.rs",
    "store/failpoint.rs",
    "tests.rs",
    "testkit.rs",
];

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the source") {
        let path = entry.expect("the source").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The files of these modules, by name, with their lines of code: without comments and tests.
fn files() -> Vec<(String, Vec<String>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    MODULES.iter().for_each(|module| sources(&root.join(module), &mut paths));
    let named = paths.into_iter().filter_map(|path| {
        let name = path.strip_prefix(&root).expect("inside").to_string_lossy().into_owned();
        let of_tests = ["conformance", "_tests", "/tests/"].iter().any(|part| name.contains(part));
        let exempt = of_tests || EXEMPT.iter().any(|end| name.ends_with(end));
        let text = fs::read_to_string(&path).expect("UTF-8");
        let text = text.split("#[cfg(test)]").next().unwrap_or_default();
        let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default().to_owned()).collect();
        (!exempt).then_some((name, lines))
    });
    named.collect()
}

/// The names in `step("...")` and `commit(tx, "...")`.
pub fn names() -> BTreeSet<String> {
    let files = files();
    let lines = files.iter().flat_map(|(_, lines)| lines);
    lines.filter_map(|line| named_in(line)).collect()
}

fn named_in(line: &str) -> Option<String> {
    let behind = line.split_once("step(\"").or_else(|| line.split_once("commit(tx, \""))?.1;
    behind.split_once('"').map(|(name, _)| name.to_owned())
}

#[test]
fn every_durable_write_and_removal_has_a_failpoint_before_it() {
    let mut without = Vec::new();
    for (name, lines) in files() {
        for (at, line) in lines.iter().enumerate() {
            let is_durable = DURABLE.iter().any(|call| line.contains(call));
            let near = lines.get(at.saturating_sub(NEAR)..=at).unwrap_or_default();
            if is_durable && !near.iter().any(|line| line.contains("step(")) {
                without.push(format!("src/{name}:{}: {}", at + 1, line.trim()));
            }
        }
    }
    assert!(without.is_empty(), "no failpoint before these:\n{}", without.join("\n"));
}

#[test]
fn the_failpoints_are_found() {
    let names = names();
    for name in ["publish.rename", "rows.enqueue", "rows.finish", "upload.write", "partial.sync", "remove"] {
        assert!(names.contains(name), "{name} is not among {names:?}");
    }
}
