//! Alerts and dashboard of `deploy/`: they name series that exist, each alert is explained, and the tools of Prometheus
//! accept them.
//!
//! That `docs/MONITORING.md` lists exactly the series of the service is a test of `tests/api`.

use std::{collections::BTreeSet, fs, path::PathBuf, process::Command};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The series that the manual lists.
fn listed() -> BTreeSet<String> {
    let manual = read("docs/MONITORING.md");
    let rows = manual.lines().filter_map(|line| line.strip_prefix("| `")?.split_once('`'));
    rows.map(|(name, _)| name.to_owned())
        .filter(|name| name.starts_with("pinstack_") || name.starts_with("process_"))
        .collect()
}

/// The series that expressions of Prometheus name.
fn named(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
    let series = words.filter(|word| word.starts_with("pinstack_") || word.starts_with("process_"));
    series
        .map(|name| {
            ["_bucket", "_sum", "_count"].iter().find_map(|end| name.strip_suffix(end)).unwrap_or(name).to_owned()
        })
        .collect()
}

#[test]
fn alerts_and_dashboard_name_series_that_exist() {
    let listed = listed();
    assert!(listed.len() > 30, "{listed:?}");
    for file in ["deploy/prometheus/alerts.yml", "deploy/grafana/pinstack.json"] {
        let named = named(&read(file));
        assert!(named.len() > 8, "{file} names {named:?}");
        let unknown: Vec<_> = named.difference(&listed).collect();
        assert!(unknown.is_empty(), "{file} names {unknown:?}");
    }
}

#[test]
fn the_dashboard_is_json_whose_panels_all_have_a_title_and_an_expression() {
    let dashboard: serde_json::Value = serde_json::from_str(&read("deploy/grafana/pinstack.json")).expect("JSON");
    let panels = dashboard["panels"].as_array().expect("panels");
    let mut places = BTreeSet::new();
    for panel in panels {
        assert!(panel["title"].as_str().is_some_and(|title| !title.is_empty()), "{panel}");
        let targets = panel["targets"].as_array().expect("targets");
        assert!(targets.iter().all(|target| !named(target["expr"].as_str().unwrap_or_default()).is_empty()), "{panel}");
        assert!(places.insert((panel["gridPos"]["x"].as_u64(), panel["gridPos"]["y"].as_u64())), "one covers another");
    }
}

#[test]
fn every_alert_is_explained_in_the_manual_and_tested() {
    let (alerts, tests, manual) =
        (read("deploy/prometheus/alerts.yml"), read("deploy/prometheus/alerts_test.yml"), read("docs/MONITORING.md"));
    let names: Vec<&str> = alerts.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).collect();
    assert!(names.len() >= 14);
    for name in &names {
        assert!(manual.contains(&format!("\n#### {name}\n")), "docs/MONITORING.md does not explain {name}");
        let runbook = format!("runbook: docs/MONITORING.md#{}", name.to_lowercase());
        assert!(alerts.contains(&runbook), "{name} does not lead to its section");
        // one test in which it is silent, and one in which it fires with its section
        assert!(tests.contains(&format!("alertname: {name} }}")) && tests.contains(&runbook), "{name} has no test");
    }
    let sections = manual.lines().filter_map(|line| line.strip_prefix("#### Pinstack")).count();
    assert_eq!(sections, names.len(), "a section without an alert");
}

#[test]
#[ignore = "needs promtool"]
fn promtool_accepts_the_rules_and_their_tests_pass() {
    for arguments in [
        &["check", "rules", "alerts.yml"][..],
        &["check", "config", "prometheus.yml"],
        &["test", "rules", "alerts_test.yml"],
    ] {
        let done = Command::new("promtool").args(arguments).current_dir(root().join("deploy/prometheus")).output();
        let done = done.expect("promtool can be started");
        let told = format!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
        assert!(done.status.success(), "{arguments:?}: {told}");
    }
}
