//! `pinstack doctor` says whether a service can run, and changes nothing.

use std::{
    collections::BTreeMap,
    path::Path,
    process::{Output, Stdio},
};

use serde_json::Value;

use crate::process::{Process, pinstack};

/// The findings by check: level and sentence.
type Findings = BTreeMap<String, (String, String)>;

fn doctor(data: &Path, environment: &[(&str, &str)]) -> (Output, Findings) {
    let mut command = pinstack(&["doctor", "--json"], data);
    command.env("PINSTACK_LISTEN", "127.0.0.1:0").env("PINSTACK_MIN_FREE_BYTES", "0");
    command.env("PINSTACK_MAX_UPLOAD_BYTES", "1024").envs(environment.iter().copied());
    let done = command.output().expect("it runs");
    let list: Vec<Value> = serde_json::from_slice(&done.stdout).unwrap_or_else(|error| panic!("{error}: {done:?}"));
    let text = |finding: &Value, key: &str| finding[key].as_str().expect("a text").to_owned();
    let findings = list.iter().map(|one| (text(one, "check"), (text(one, "level"), text(one, "detail")))).collect();
    (done, findings)
}

fn level<'a>(findings: &'a Findings, check: &str) -> &'a str {
    findings.get(check).map_or("missing", |(level, _)| level)
}

fn files(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder");
    let mut names: Vec<_> =
        entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

#[test]
fn a_new_machine_is_fine_and_stays_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let (done, findings) = doctor(&folder.path().join("data"), &[("PINSTACK_MEMORY_MB", "64")]);
    assert!(done.status.success(), "{findings:?}");
    assert!(findings["database"].1.contains("none yet"), "{findings:?}");
    assert_eq!(files(folder.path()), Vec::<String>::new());
    let text = pinstack(&["doctor"], &folder.path().join("data")).output().expect("it runs");
    assert!(String::from_utf8_lossy(&text.stdout).contains("ok       data folder: "), "{text:?}");
}

#[tokio::test]
async fn a_running_service_is_recognised() {
    let process = Process::start(&[]).await;
    let data = process.folder.path().join("data");
    let address = process.base.trim_start_matches("http://").to_owned();
    let (done, findings) = doctor(&data, &[("PINSTACK_LISTEN", &address), ("PINSTACK_MEMORY_MB", "64")]);
    assert!(done.status.success(), "{findings:?}");
    assert!(findings["address"].1.contains("a pinstack runs") && findings["address"].1.contains("is ready"));
    assert!(findings["database"].1.ends_with("0 profiles, 0 queued jobs"), "{findings:?}");
}

#[test]
fn each_problem_is_named_with_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    std::fs::create_dir(&data).expect("a folder");
    for (check, environment, told) in [
        ("settings", &[("PINSTACK_WORKERS", "many")][..], "workers"),
        ("disk", &[("PINSTACK_MIN_FREE_BYTES", "1000000000000000")], "free disk space"),
        ("tokens", &[("PINSTACK_LISTEN", "0.0.0.0:0")], "pinstack token add"),
        ("tokens", &[("PINSTACK_AUTH", "tokens")], "pinstack token add"),
        ("address", &[("PINSTACK_LISTEN", "192.0.2.1:8080"), ("PINSTACK_AUTH", "none")], "an address of this machine"),
        ("database", &[("PINSTACK_DATABASE_URL", "postgres://ann:geheim@127.0.0.1:1/none")], "check that it runs"),
        // no file can be made there, not even by root
        ("data folder", &[], "cannot be made"),
    ] {
        let data = if check == "data folder" { Path::new("/proc/self/task") } else { &data };
        let (done, findings) = doctor(data, environment);
        assert_eq!(done.status.code(), Some(1), "{check}: {findings:?}");
        assert_eq!(level(&findings, check), "problem", "{findings:?}");
        let detail = &findings[check].1;
        assert!(detail.contains(told) && !detail.contains("geheim"), "{detail}");
    }
    let (_, findings) = doctor(&data, &[("PINSTACK_MEMORY_MB", "16777216")]);
    assert_eq!(level(&findings, "memory"), "warning", "{findings:?}");
    assert!(findings["memory"].1.contains("lower memory_mb"), "{findings:?}");
    let (_, findings) = doctor(&data, &[("PINSTACK_LISTEN", "0.0.0.0:0"), ("PINSTACK_AUTH", "none")]);
    assert_eq!(level(&findings, "tokens"), "warning", "{findings:?}");
    assert_eq!(files(&data), Vec::<String>::new(), "the probe leaves nothing");
}

#[test]
fn a_database_that_is_none_or_newer_is_a_problem() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    std::fs::create_dir(&data).expect("a folder");
    std::fs::write(data.join("pinstack.sqlite"), "this is no database at all".repeat(100)).expect("a file");
    let (done, findings) = doctor(&data, &[]);
    assert!(!done.status.success());
    assert_eq!(level(&findings, "database"), "problem", "{findings:?}");
}

#[tokio::test]
async fn schemas_of_other_versions_are_recognised() {
    use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let made = pinstack(&["token", "add", "ann", "--scope", "read"], &data).output().expect("it runs");
    assert!(made.status.success(), "{made:?}");
    let (_, findings) = doctor(&data, &[("PINSTACK_MEMORY_MB", "64")]);
    assert_eq!(findings["tokens"].1, "1 valid");
    let options = SqliteConnectOptions::new().filename(data.join("pinstack.sqlite"));
    let mut connection = SqliteConnection::connect_with(&options).await.expect("a database");
    for (sql, expected, told) in [
        ("UPDATE _sqlx_migrations SET version = version + 87", "problem", "newer version"),
        ("UPDATE _sqlx_migrations SET version = version - 100", "problem", "before the first release"),
    ] {
        sqlx::query(sql).execute(&mut connection).await.expect(sql);
        let (_, findings) = doctor(&data, &[]);
        let (level, detail) = &findings["database"];
        assert!(level == expected && detail.contains(told), "{findings:?}");
    }
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    let folder = tempfile::tempdir().expect("a folder");
    for form in [&["doctor"][..], &["doctor", "--json"]] {
        let mut command = pinstack(form, &folder.path().join("data"));
        command.env("PINSTACK_LISTEN", "127.0.0.1:0").env("PINSTACK_MIN_FREE_BYTES", "0");
        command.env("PINSTACK_MAX_UPLOAD_BYTES", "1024").env("PINSTACK_MEMORY_MB", "64");
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
        // as `head` does when it has its lines
        drop(child.stdout.take());
        let done = child.wait_with_output().expect("it ends");
        assert!(done.status.success(), "{form:?}: {}", String::from_utf8_lossy(&done.stderr));
    }
}
