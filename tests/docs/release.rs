//! Workflow files and the scripts of a release: the tools that read them accept them, actions are pinned, rights are
//! granted job by job, and the version is the same everywhere.

use std::{fs, path::Path, process::Command};

use crate::deploy::{read, root, run};

fn workflows() -> Vec<(String, String)> {
    let folder = fs::read_dir(root().join(".github/workflows")).expect("workflows");
    let mut found: Vec<_> = folder
        .map(|entry| entry.expect("a file").path())
        .map(|path| (path.display().to_string(), fs::read_to_string(&path).expect("UTF-8")))
        .collect();
    found.sort();
    assert!(found.len() >= 2, "{found:?}");
    found
}

fn scripts() -> Vec<String> {
    let folder = fs::read_dir(root().join("scripts/release")).expect("scripts");
    let names = folder.map(|entry| entry.expect("a file").file_name().to_string_lossy().into_owned());
    names.map(|name| format!("scripts/release/{name}")).collect()
}

#[test]
#[ignore = "needs actionlint"]
fn actionlint_accepts_the_workflows() {
    let paths: Vec<String> = workflows().into_iter().map(|(path, _)| path).collect();
    run("actionlint", &paths.iter().map(String::as_str).collect::<Vec<_>>());
}

#[test]
#[ignore = "needs shellcheck"]
fn shellcheck_accepts_the_scripts() {
    let mut files: Vec<String> = scripts().into_iter().filter(|name| name.ends_with(".sh")).collect();
    assert!(files.len() >= 8, "{files:?}");
    let others = [
        ".ci/run",
        ".ci/tools",
        "deploy/debian/postinst",
        "scripts/containers.sh",
        "scripts/slow_tests.sh",
        "scripts/with_garage.sh",
    ];
    files.extend(others.map(str::to_owned));
    run("shellcheck", &files.iter().map(String::as_str).collect::<Vec<_>>());
}

#[test]
fn every_action_is_pinned_to_a_commit_and_names_its_version() {
    for (path, text) in workflows() {
        let uses: Vec<&str> =
            text.lines().filter_map(|line| line.trim_start_matches([' ', '-']).strip_prefix("uses: ")).collect();
        assert!(!uses.is_empty(), "{path} uses no action");
        for action in uses {
            let pinned = action.split_once('@').and_then(|(_, pin)| pin.split_once(" # v"));
            let is_commit = |pin: &str| pin.len() == 40 && pin.bytes().all(|byte| byte.is_ascii_hexdigit());
            assert!(pinned.is_some_and(|(pin, version)| is_commit(pin) && !version.is_empty()), "{path}: {action}");
        }
    }
}

#[test]
fn workflows_grant_no_right_to_all_jobs() {
    for (path, text) in workflows() {
        assert!(text.contains("\npermissions: {}\n"), "{path} must begin without rights");
        let (jobs, granted) = (text.matches("    runs-on: ").count(), text.matches("    permissions:\n").count());
        assert_eq!(jobs, granted, "{path}: each job states its rights");
        assert_eq!(
            text.matches("actions/checkout@").count(),
            text.matches("persist-credentials: false").count(),
            "{path}"
        );
    }
}

#[test]
fn every_script_of_a_workflow_exists_and_can_be_started() {
    use std::os::unix::fs::PermissionsExt;
    let mut named = 0;
    for (path, text) in workflows() {
        for word in text.split_whitespace().map(|word| word.trim_start_matches("\"version=$(")) {
            if word.starts_with("scripts/") && word.contains('.') {
                let metadata =
                    fs::metadata(root().join(word)).unwrap_or_else(|error| panic!("{path}: {word}: {error}"));
                assert!(metadata.permissions().mode() & 0o111 != 0, "{word} is not executable");
                named += 1;
            }
        }
    }
    assert!(named >= 10, "{named}");
}

/// Runs scripts/release/version.sh, of `folder`.
fn version(folder: &Path, arguments: &[&str]) -> Result<String, String> {
    let output = Command::new(folder.join("scripts/release/version.sh")).args(arguments).output().expect("it starts");
    let told = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    if output.status.success() { Ok(told(&output.stdout)) } else { Err(told(&output.stderr)) }
}

#[test]
fn a_release_has_one_version() {
    let here = env!("CARGO_PKG_VERSION");
    assert_eq!(version(&root(), &[]).as_deref(), Ok(here));
    assert_eq!(version(&root(), &[&format!("v{here}")]).as_deref(), Ok(here));
    let image = format!("newTag: \"{here}\"");
    assert!(read("deploy/kubernetes/kustomization.yaml").contains(&image), "the manifests name another version");
    let refused = version(&root(), &["v99.0.0"]).expect_err("another tag");
    assert!(refused.contains(&format!("must be v{here}")), "{refused}");

    let copy = tempfile::tempdir().expect("a folder");
    let client = "clients/python/src/pinstack/_version.py";
    for file in ["scripts/release/version.sh", "Cargo.toml", client] {
        let to = copy.path().join(file);
        fs::create_dir_all(to.parent().expect("in a folder")).expect("a folder");
        fs::copy(root().join(file), to).expect("a copy");
    }
    fs::write(copy.path().join(client), read(client).replace(here, "99.0.0")).expect("a file");
    let refused = version(copy.path(), &[]).expect_err("another client");
    assert!(refused.contains("99.0.0"), "{refused}");
}

#[test]
fn a_binary_goes_with_the_licences_of_all_that_is_in_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("THIRD-PARTY.txt");
    let target = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    // the sources of all crates are there: this test was built from them
    let made = Command::new(root().join("scripts/release/notices.py"))
        .arg(target)
        .arg(&out)
        .current_dir(root())
        .env("CARGO_NET_OFFLINE", "true")
        .output()
        .expect("it starts");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let text = fs::read_to_string(out).expect("UTF-8");
    for part in [
        "Rust standard library 1.",
        "Swagger UI v",
        "tokio 1.",
        "ring 0.",
        "libsqlite3-sys 0.",
        "BoringSSL",
        "fiat-crypto",
    ] {
        assert!(text.contains(part), "nothing about {part}");
    }
    // dependencies of tests and of build scripts are in no binary
    assert!(!text.contains("\ncriterion ") && !text.contains("\ncc 1."), "more than the binary has");

    // every way to hand out a binary hands out the file
    let archive = read("scripts/release/binary.sh");
    let package = read("Cargo.toml");
    for (name, text) in [("archive", archive), ("package", package), ("image", read("Dockerfile"))] {
        assert!(text.contains("THIRD-PARTY.txt"), "the {name} has no licences");
    }
}

#[test]
fn checksums_find_a_changed_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().to_str().expect("UTF-8");
    let script = root().join("scripts/release/checksums.sh");
    let empty = Command::new(&script).arg(path).output().expect("it starts");
    assert!(!empty.status.success(), "a folder without artefacts is refused");
    fs::write(folder.path().join("one.tar.gz"), "one").expect("a file");
    let done = Command::new(&script).arg(path).output().expect("it starts");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let check = || Command::new("sha256sum").args(["--check", "--quiet", "SHA256SUMS"]).current_dir(path).output();
    assert!(check().expect("it starts").status.success());
    fs::write(folder.path().join("one.tar.gz"), "two").expect("a file");
    assert!(!check().expect("it starts").status.success());
}
