//! `GET /metrics`: every line is valid, and `docs/MONITORING.md` lists exactly the series that exist.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};

use pinstack::{
    jobs::ScienceRunner,
    telemetry::{ALL, series::OTHER_STAGE},
    worker::{Config, Deps, Pool},
};

use crate::app::{HEIGHT, TestApp, WIDTH, png, stack_zip, zip};

type Labels = BTreeMap<String, String>;

/// A metric family of the text format.
#[derive(Debug, Default)]
struct Family {
    kind: String,
    samples: Vec<(String, Labels, f64)>,
}

/// Parses the text format 0.0.4 strictly. It refuses what the format forbids, and also a family without HELP and TYPE,
/// a sample outside its family, a repeated sample, and a histogram that is not cumulative.
fn parse(text: &str) -> BTreeMap<String, Family> {
    let mut families: BTreeMap<String, Family> = BTreeMap::new();
    let (mut helped, mut current) = (String::new(), String::new());
    assert!(text.ends_with('\n'), "the last line ends");
    for line in text.lines().filter(|line| !line.is_empty()) {
        if let Some(rest) = line.strip_prefix("# HELP ") {
            let (name, help) = rest.split_once(' ').unwrap_or_else(|| panic!("{line}"));
            assert!(!help.is_empty() && !families.contains_key(name), "{line}");
            helped = name.to_owned();
        } else if let Some(rest) = line.strip_prefix("# TYPE ") {
            let (name, kind) = rest.split_once(' ').unwrap_or_else(|| panic!("{line}"));
            assert!(["counter", "gauge", "histogram"].contains(&kind) && name == helped, "{line}: HELP comes before");
            current = name.to_owned();
            families.insert(current.clone(), Family { kind: kind.to_owned(), samples: Vec::new() });
        } else {
            let (name, labels, value) = sample(line);
            let family = families.get_mut(&current).unwrap_or_else(|| panic!("no TYPE before {line}"));
            let suffix = name.strip_prefix(current.as_str()).unwrap_or_else(|| panic!("{line} is not of {current}"));
            let allowed: &[&str] = if family.kind == "histogram" { &["_bucket", "_sum", "_count"] } else { &[""] };
            assert!(allowed.contains(&suffix), "{line}");
            let twice = family.samples.iter().any(|(n, l, _)| (n, l) == (&name, &labels));
            assert!(!twice, "{line} is there twice");
            family.samples.push((name, labels, value));
        }
    }
    for (name, family) in families.iter().filter(|(_, family)| family.kind == "histogram") {
        check_histogram(name, family);
    }
    families
}

fn sample(line: &str) -> (String, Labels, f64) {
    let end = line.find(['{', ' ']).unwrap_or_else(|| panic!("{line}"));
    let (name, mut rest) = line.split_at(end);
    assert!(name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_'), "{line}");
    let mut labels = Labels::new();
    if let Some(inside) = rest.strip_prefix('{') {
        let (mut key, mut value, mut at) = (String::new(), None::<String>, inside.char_indices());
        loop {
            let (i, c) = at.next().unwrap_or_else(|| panic!("{line}"));
            match (&mut value, c) {
                (None, '=') => {
                    assert!(matches!(at.next(), Some((_, '"'))), "{line}");
                    value = Some(String::new());
                }
                (None, '}') if key.is_empty() => {
                    rest = &inside[i + 1..];
                    break;
                }
                (None, ',') if key.is_empty() => {}
                (None, c) => key.push(c),
                (Some(text), '\\') => match at.next() {
                    Some((_, 'n')) => text.push('\n'),
                    Some((_, c @ ('\\' | '"'))) => text.push(c),
                    other => panic!("{line}: {other:?} after a backslash"),
                },
                (Some(text), '"') => {
                    assert!(labels.insert(std::mem::take(&mut key), std::mem::take(text)).is_none(), "{line}");
                    value = None;
                }
                (Some(text), c) => text.push(c),
            }
        }
    }
    let value = rest.strip_prefix(' ').unwrap_or_else(|| panic!("{line}"));
    (name.to_owned(), labels, value.parse().unwrap_or_else(|_| panic!("{line}: '{value}' is not a number")))
}

fn check_histogram(name: &str, family: &Family) {
    let mut counts: BTreeMap<Labels, Vec<(f64, f64)>> = BTreeMap::new();
    let of = |suffix: &str, labels: &Labels| {
        let found = family.samples.iter().find(|(n, l, _)| *n == format!("{name}{suffix}") && l == labels);
        found.unwrap_or_else(|| panic!("{name}{suffix} is missing for {labels:?}")).2
    };
    for (_, labels, count) in family.samples.iter().filter(|(n, ..)| n.ends_with("_bucket")) {
        let mut labels = labels.clone();
        let bound = labels.remove("le").unwrap_or_else(|| panic!("{name}: a bucket without le"));
        counts.entry(labels).or_default().push((bound.parse().expect("a bound"), *count));
    }
    for (labels, buckets) in counts {
        assert!(buckets.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 <= pair[1].1), "{name}: {buckets:?}");
        let (last, count) = buckets[buckets.len() - 1];
        assert!(last == f64::INFINITY && count == of("_count", &labels), "{name} {labels:?}");
        assert!(of("_sum", &labels) >= 0.0, "{name} {labels:?}");
    }
}

/// Name, type and labels of the rows of the table in MONITORING.md.
fn documented() -> BTreeSet<(String, String, Vec<String>)> {
    let text = include_str!("../../docs/MONITORING.md");
    let section =
        text.split("\n## ").find(|section| section.starts_with("Metrics for Prometheus\n")).expect("the section");
    let rows = section.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        assert_eq!(cells.len(), 4, "{row}");
        let labels = cells[2].split('`').skip(1).step_by(2).map(str::to_owned).collect();
        (cells[0].trim_matches('`').to_owned(), cells[1].to_owned(), labels)
    })
    .collect()
}

#[test]
fn the_documented_series_are_those_of_the_program() {
    let labels = |labels: &[&str]| labels.iter().map(|label| (*label).to_owned()).collect();
    let of_program: BTreeSet<_> =
        ALL.iter().map(|s| (s.name.to_owned(), s.kind.as_str().to_owned(), labels(s.labels))).collect();
    assert_eq!(documented(), of_program);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_series_exists_and_no_label_comes_from_a_client() {
    let app = TestApp::start().await;
    pinstack::telemetry::recorder().expect("the recorder of this process");
    let (store, disk) = (app.store.clone(), Arc::clone(&app.app.disk));
    let deps = Deps { store, disk, runner: Arc::new(ScienceRunner::default()) };
    let pool = Pool::start(deps, Config::default());
    app.with_profile(2).await;
    let send = async |path: &str, body: Vec<u8>| {
        let answer = app.post(path).header("prefer", "wait=50").body(body).send().await.expect("an answer");
        answer.json::<serde_json::Value>().await.expect("JSON")
    };
    let done = send("/v1/stacks?rig=rig&lens=lens&label=unmistakable", stack_zip(2, 0)).await;
    assert_eq!(done["state"], "succeeded", "{done}");
    // only decoding shows that the second slice is damaged
    let (whole, mut damaged) = (png(WIDTH, HEIGHT, 3, 0), png(WIDTH, HEIGHT, 3, 1));
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0xff;
    let slices = [("front/img_0.png".to_owned(), whole), ("front/img_1.png".to_owned(), damaged)];
    let failed = send("/v1/stacks?rig=rig&lens=lens", zip(&slices)).await;
    assert_eq!(failed["error"]["code"], "invalid_image", "{failed}");
    let none = send("/v1/profiles/rig/unmistakable/calibrations", stack_zip(2, 0)).await;
    assert_eq!(none["state"], "failed", "{none}");
    app.get("/v1/profiles/unmistakable/lens").send().await.expect("an answer");

    let text = app.get("/metrics").send().await.expect("an answer").text().await.expect("text");
    assert!(!text.contains("unmistakable") && !text.contains(done["id"].as_str().expect("an id")), "{text}");
    let families = parse(&text);
    let names: BTreeSet<&str> = families.keys().map(String::as_str).collect();
    assert_eq!(names, ALL.iter().map(|series| series.name).collect());
    for series in ALL {
        let family = &families[series.name];
        assert_eq!(family.kind, series.kind.as_str(), "{}", series.name);
        let wanted: BTreeSet<&str> = series.labels.iter().copied().collect();
        assert!(!family.samples.is_empty(), "{} has no sample", series.name);
        for (name, labels, value) in &family.samples {
            let keys: BTreeSet<&str> = labels.keys().map(String::as_str).filter(|key| *key != "le").collect();
            assert_eq!(keys, wanted, "{name}");
            assert!(*value >= 0.0, "{name} is {value}");
        }
    }
    let value = |name: &str, wanted: &[(&str, &str)]| {
        let is_it = |(n, labels, _): &&(String, Labels, f64)| {
            n == name && wanted.iter().all(|(key, text)| labels.get(*key).map(String::as_str) == Some(*text))
        };
        families.values().flat_map(|f| &f.samples).find(is_it).map(|(.., value)| *value)
    };
    assert_eq!(value("pinstack_jobs", &[("kind", "stack"), ("state", "failed")]), Some(1.0));
    assert_eq!(value("pinstack_oldest_queued_job_seconds", &[("kind", "stack")]), Some(0.0));
    assert!(value("pinstack_stored_bytes", &[("content", "result")]).is_some_and(|bytes| bytes > 0.0));
    assert!(value("pinstack_job_failures_total", &[("kind", "stack"), ("code", "invalid_image")]) >= Some(1.0));
    assert!(value("pinstack_http_wait_seconds_count", &[("route", "/v1/stacks"), ("on", "job")]) >= Some(2.0));
    assert!(value("pinstack_job_stage_seconds_count", &[("kind", "stack"), ("stage", "fusing")]) >= Some(1.0));
    assert_eq!(value("pinstack_job_stage_seconds_count", &[("stage", OTHER_STAGE)]), None, "every stage has a label");
    assert!(value("process_resident_memory_bytes", &[]) > Some(1e6));
    pool.shutdown(Duration::from_secs(10)).await;
}

#[tokio::test]
async fn a_waiting_job_has_an_age() {
    let app = TestApp::start().await;
    app.with_stack("").await;
    let text = app.get("/metrics").send().await.expect("an answer").text().await.expect("text");
    let families = parse(&text);
    let ages = &families["pinstack_oldest_queued_job_seconds"].samples;
    let age = ages.iter().find(|(_, labels, _)| labels["kind"] == "stack").map(|(.., age)| *age);
    assert!(age.is_some_and(|age| age > 0.0), "{ages:?}");
}

#[test]
fn the_parser_refuses_what_the_format_does_not_allow() {
    let good = "# HELP a_total x\n# TYPE a_total counter\na_total{b=\"c\\\"d\"} 1\n";
    assert_eq!(parse(good)["a_total"].samples[0].1["b"], "c\"d");
    for bad in [
        "a_total 1\n",
        "# TYPE a_total counter\na_total 1\n",
        "# HELP a_total x\n# TYPE a_total counter\nb_total 1\n",
        "# HELP a_total x\n# TYPE a_total counter\na_total 1\na_total 2\n",
        "# HELP a_total x\n# TYPE a_total counter\na_total{b=\"c} 1\n",
        "# HELP a x\n# TYPE a histogram\na_bucket{le=\"1\"} 2\na_bucket{le=\"+Inf\"} 1\na_sum 1\na_count 1\n",
        "# HELP a x\n# TYPE a histogram\na_bucket{le=\"1\"} 1\na_sum 1\na_count 1\n",
    ] {
        assert!(std::panic::catch_unwind(|| parse(bad)).is_err(), "{bad}");
    }
}
