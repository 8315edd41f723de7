//! Files of `deploy/` and the Dockerfile: their settings exist, and the tools that read them accept them. And the
//! repository holds no large file.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

/// A file of more bytes than this was most likely committed by accident.
const LARGEST: u64 = 2 << 20;

/// The folder of the project.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A file of the project.
pub fn read(path: impl AsRef<Path>) -> String {
    fs::read_to_string(root().join(path)).expect("a text file")
}

/// Runs a tool and returns what it says.
pub fn run(tool: &str, arguments: &[&str]) -> String {
    let done = Command::new(tool).args(arguments).current_dir(root()).output();
    let done = done.unwrap_or_else(|error| panic!("{tool} cannot be started: {error}"));
    let told = format!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    assert!(done.status.success(), "{tool} {arguments:?}: {told}");
    told
}

/// The folders of manifests for Kubernetes: with a common folder, and what differs with a bucket.
const MANIFESTS: [&str; 2] = ["deploy/kubernetes", "deploy/kubernetes-bucket"];

/// The names of the manifests in such a folder, without the file that joins them.
fn names_in(folder: &str) -> Vec<String> {
    let folder = fs::read_dir(root().join(folder)).expect("manifests");
    let names = folder.map(|entry| entry.expect("a file").file_name().to_string_lossy().into_owned());
    let mut found: Vec<_> = names.filter(|name| name != "kustomization.yaml").collect();
    found.sort();
    found
}

/// The paths of all manifests.
fn manifests() -> Vec<String> {
    let paths = |folder: &str| names_in(folder).into_iter().map(|name| format!("{folder}/{name}")).collect::<Vec<_>>();
    let found: Vec<String> = MANIFESTS.into_iter().flat_map(paths).collect();
    assert!(found.len() >= 10, "{found:?}");
    found
}

/// The files for compose.
const COMPOSE: [&str; 4] =
    ["deploy/compose.yaml", "deploy/compose.cluster.yaml", "deploy/compose.bucket.yaml", "deploy/compose.garage.yaml"];

#[test]
fn every_setting_in_deploy_exists() {
    let manual = read("docs/SETTINGS.md");
    let files = ["Dockerfile", "deploy/systemd/pinstack.service"];
    let mut named = BTreeSet::new();
    for file in files.into_iter().chain(COMPOSE).map(str::to_owned).chain(manifests()) {
        let text = read(file);
        let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        named.extend(words.filter(|word| word.starts_with("PINSTACK_")).map(str::to_owned));
    }
    assert!(named.len() >= 5, "{named:?}");
    let unknown: Vec<_> = named.iter().filter(|name| !manual.contains(&format!("`{name}`"))).collect();
    assert!(unknown.is_empty(), "not among the settings: {unknown:?}");
}

#[test]
fn the_dockerfile_makes_every_file_that_cargo_wants_before_the_sources_are_there() {
    let dockerfile = read("Dockerfile");
    let step = dockerfile.split("\nRUN ").find(|step| step.contains("/benches")).expect("a step");
    let (step, _) = step.split_once("&& cargo build").expect("it builds the dependencies");
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("science")).expect("a folder");
    for name in ["Cargo.toml", "Cargo.lock", "science/Cargo.toml"] {
        fs::write(folder.path().join(name), read(name)).expect("a file");
    }
    let script = format!("set -e; {step}&& \"$0\" metadata --locked --offline --no-deps --format-version 1");
    let done = Command::new("sh").args(["-c", &script, env!("CARGO")]).current_dir(folder.path()).output();
    let done = done.expect("a shell starts");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

#[test]
#[ignore = "needs check-jsonschema"]
fn compose_files_fit_their_schema() {
    run("check-jsonschema", &[&["--builtin-schema", "vendor.compose-spec"][..], &COMPOSE].concat());
}

#[test]
#[ignore = "needs kubernetes-validate"]
fn manifests_fit_the_schemas_of_kubernetes() {
    let paths = manifests();
    // 1.30 is the first version with the action `sleep` of api.yaml
    for version in ["1.30", "1.37"] {
        let mut arguments = vec!["--strict", "-k", version];
        arguments.extend(paths.iter().map(String::as_str));
        let told = run("kubernetes-validate", &arguments);
        assert!(told.matches(" passed for resource ").count() >= paths.len(), "{told}");
    }
}

#[test]
fn the_kustomization_lists_every_manifest_that_is_no_example() {
    for folder in MANIFESTS {
        let text = read(format!("{folder}/kustomization.yaml"));
        let listed: BTreeSet<&str> = text
            .lines()
            // a manifest that needs more than a cluster has is listed in a comment
            .filter_map(|line| line.trim_start_matches([' ', '#']).strip_prefix("- "))
            .map(|name| name.trim_start_matches("path: "))
            .filter(|name| name.ends_with(".yaml"))
            .collect();
        let names = names_in(folder);
        let wanted = names.iter().map(String::as_str).filter(|name| !name.ends_with(".example.yaml")).collect();
        assert_eq!(listed, wanted, "{folder}");
    }
}

#[test]
#[ignore = "needs kustomize, kubernetes-validate"]
fn with_a_bucket_kubernetes_shares_no_volume() {
    let text = run("kustomize", &["build", MANIFESTS[1]]);
    for gone in ["PersistentVolumeClaim\n", "persistentVolumeClaim:", "ReadWriteMany"] {
        assert!(!text.contains(gone), "{gone} is in\n{text}");
    }
    // API and workers
    for twice in ["ephemeral:", "secretName: pinstack-bucket", "mountPath: /bucket"] {
        assert_eq!(text.matches(twice).count(), 2, "{twice} in\n{text}");
    }
    assert!(text.contains("PINSTACK_STORAGE_URL: s3://") && text.contains("port: 443"), "{text}");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("all.yaml");
    fs::write(&file, &text).expect("a file");
    let told = run("kubernetes-validate", &["--strict", "-k", "1.30", file.to_str().expect("UTF-8")]);
    assert_eq!(told.matches(" passed for resource ").count(), text.matches("\nkind: ").count(), "{told}");
}

#[test]
fn the_program_accepts_the_settings_of_the_debian_package_and_of_kubernetes() {
    let folder = tempfile::tempdir().expect("a folder");
    let doctor = |command: &mut Command| {
        let output = command.args(["doctor", "--data-dir"]).arg(folder.path()).output().expect("it starts");
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
    };
    let accepts = |told: &str| told.lines().any(|line| line.split_whitespace().take(2).eq(["ok", "settings:"]));
    let pinstack = || Command::new(env!("CARGO_BIN_EXE_pinstack"));
    assert!(!accepts(&doctor(pinstack().env("PINSTACK_AUTH", "perhaps"))), "a wrong value is seen");
    let told = doctor(pinstack().env("PINSTACK_CONFIG", root().join("deploy/debian/pinstack.toml")));
    assert!(accepts(&told), "{told}");

    let url = folder.path().join("database_url");
    fs::write(&url, "postgres://pinstack@127.0.0.1:1/pinstack").expect("a file");
    // the second has the first below it; its server is one that refuses every connection
    for folders in [&MANIFESTS[..1], &MANIFESTS[..]] {
        let mut command = pinstack();
        let mut count = 0;
        for folder in folders {
            let config = read(format!("{folder}/config.yaml"));
            let pairs = config.lines().filter_map(|line| line.trim().split_once(": "));
            for (name, value) in pairs.filter(|(name, _)| name.starts_with("PINSTACK_")) {
                let value = match name {
                    "PINSTACK_DATABASE_URL_FILE" => url.to_str().expect("UTF-8"),
                    "PINSTACK_STORAGE_ENDPOINT" => "http://127.0.0.1:1",
                    _ => value.trim_matches(['\'', '"']),
                };
                command.env(name, value);
                count += 1;
            }
        }
        assert!(count >= 3 * folders.len() + 2, "{count} settings");
        let told = doctor(&mut command);
        assert!(accepts(&told), "{told}");
    }
}

#[test]
#[ignore = "needs systemd-analyze"]
fn systemd_accepts_the_unit_and_finds_it_hardened() {
    let folder = tempfile::tempdir().expect("a folder");
    let unit = folder.path().join("pinstack.service");
    // the program is not installed where the unit looks for it
    let text = read("deploy/systemd/pinstack.service").replace("/usr/bin/pinstack", "/bin/true");
    fs::write(&unit, text).expect("a file");
    let unit = unit.to_str().expect("UTF-8");
    let told = run("systemd-analyze", &["verify", unit]);
    assert!(told.trim().is_empty(), "{told}");
    let told = run("systemd-analyze", &["security", "--offline=true", "--threshold=20", unit]);
    assert!(told.contains("OK"), "{told}");
}

#[test]
#[ignore = "needs git and its repository"]
fn no_large_file_is_in_the_repository() {
    let names = run("git", &["-c", "safe.directory=*", "ls-files", "-z"]);
    let names: Vec<&str> = names.split('\0').filter(|name| !name.is_empty()).collect();
    assert!(names.contains(&"Cargo.toml"), "git lists {} files", names.len());
    let size = |name: &&str| fs::metadata(root().join(name)).map_or(0, |metadata| metadata.len());
    let large: Vec<&str> = names.into_iter().filter(|name| size(name) > LARGEST).collect();
    assert!(large.is_empty(), "more than 2 MiB: {large:?}");
}
