//! Traces of OpenTelemetry: one trace from the request through the queue and a worker in another process to the
//! results; and a collector that does not work, which must not matter to any job.

use std::{collections::HashSet, path::Path, time::Duration};

use reqwest::Client;
use serde_json::Value;
use tempfile::TempDir;

use crate::{
    collector::{Collector, Received, hanging, nothing},
    input::{profile, zip},
    service::{LOOK, Service},
};

const TRACE: &str = "4bf92f3577b34da6a3ce929d0e0e4736";
const PARENT: &str = "00f067aa0ba902b7";

/// How long a process may take to end: the last spans have 3 s.
const SHUTDOWN: Duration = Duration::from_secs(20);

fn client() -> Client {
    Client::builder().no_proxy().build().expect("a client")
}

/// Sends a stack with a `traceparent`, and waits for its end.
async fn stack(client: &Client, url: &str) -> Value {
    client.put(format!("{url}/v1/profiles/rig/lens")).json(&profile()).send().await.expect("a profile");
    let posted = client.post(format!("{url}/v1/stacks?rig=rig&lens=lens"));
    let posted = posted.header("traceparent", format!("00-{TRACE}-{PARENT}-01")).header("tracestate", "lab=7");
    let posted = posted.body(zip()).send().await.expect("a stack");
    let path = posted.headers()["location"].to_str().expect("a path").to_owned();
    loop {
        let shown: Value = client.get(format!("{url}{path}")).send().await.expect("it").json().await.expect("JSON");
        if shown["state"] != "running" && shown["state"] != "queued" {
            return shown;
        }
        tokio::time::sleep(LOOK).await;
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The span of this name in the trace; there is exactly one.
fn one<'a>(spans: &'a [Received], name: &str) -> &'a Received {
    let found: Vec<_> = spans.iter().filter(|received| received.span.name == name).collect();
    assert_eq!(found.len(), 1, "{name} in {:?}", spans.iter().map(|received| &received.span.name).collect::<Vec<_>>());
    found[0]
}

fn log_of(data: &Path) -> String {
    std::fs::read_to_string(data.with_extension("log")).expect("a log")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_trace_leads_from_the_request_through_a_worker_elsewhere_to_the_results() {
    let collector = Collector::start().await;
    let folder = TempDir::new().expect("a folder");
    let data = folder.path().join("data");
    let flags = ["--otlp-endpoint", &collector.url];
    let api = Service::start(&data, None, &[&["--workers", "0"][..], &flags].concat()).await.expect("it listens");
    let worker = Service::start_worker(&data, None, &flags);
    let ended = stack(&client(), &api.url).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    // the last spans are sent before a process ends
    api.stop().await;
    worker.stop().await;

    let spans: Vec<_> = collector.spans().into_iter().filter(|it| hex(&it.span.trace_id) == TRACE).collect();
    let request = one(&spans, "POST /v1/stacks");
    let job = one(&spans, "run stack");
    assert_eq!(hex(&request.span.parent_span_id), PARENT, "the request continues the trace of the client");
    assert!(spans.iter().all(|it| it.span.trace_state == "lab=7"), "the state of the trace goes along");
    let below = |parent: &Received, names: &[&str]| {
        for name in names {
            let child = one(&spans, name);
            assert_eq!(child.span.parent_span_id, parent.span.span_id, "{name}");
            assert!(child.is_within(parent), "{name}");
            assert_eq!(child.of_process("service.instance.id"), parent.of_process("service.instance.id"), "{name}");
        }
    };
    below(request, &["receive upload", "inspect archive", "store upload", "enqueue"]);
    below(job, &["admit", "fetch input", "store results", "publish"]);
    // some once for each light
    for stage in ["reading", "aligning", "fusing", "masking", "writing"] {
        let visits: Vec<_> = spans.iter().filter(|it| it.span.name == stage).collect();
        assert!(!visits.is_empty(), "{stage}");
        assert!(visits.iter().all(|it| it.span.parent_span_id == job.span.span_id && it.is_within(job)), "{stage}");
    }
    for name in ["wait in queue", "run stack"] {
        assert_eq!(one(&spans, name).span.parent_span_id, request.span.span_id, "{name}");
    }
    assert_ne!(
        request.of_process("service.instance.id"),
        job.of_process("service.instance.id"),
        "two processes have made the trace"
    );
    for it in [request, job] {
        assert_eq!(it.of_process("service.name"), "pinstack");
        assert_eq!(it.of_process("service.version"), env!("CARGO_PKG_VERSION"));
        assert_eq!(it.of_process("deployment.environment.name"), "test", "the variables of OpenTelemetry count");
    }
    assert_eq!(request.attribute("http.response.status_code"), "202");
    assert_eq!(request.attribute("http.route"), "/v1/stacks");
    assert_eq!(request.attribute("url.path"), "/v1/stacks", "without the query");
    let id = ended["id"].as_str().expect("an id");
    assert_eq!(
        (job.attribute("pinstack.job.id"), job.attribute("pinstack.job.ending")),
        (id.into(), "succeeded".into())
    );
    let ids: HashSet<_> = spans.iter().map(|it| it.span.span_id.clone()).collect();
    assert_eq!(ids.len(), spans.len(), "every span was sent once");
    let probes = collector.spans().iter().filter(|it| it.span.name.ends_with("z")).count();
    assert_eq!(probes, 0, "health checks are no traces");

    let log = log_of(&data);
    for line in ["answered", "job claimed", "job leaves its worker"] {
        let told = log.lines().any(|it| it.contains(line) && it.contains(&format!("trace_id={TRACE}")));
        assert!(told, "'{line}' lacks the trace: {log}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_attempt_has_a_span_and_a_refused_request_says_why() {
    let collector = Collector::start().await;
    let folder = TempDir::new().expect("a folder");
    let data = folder.path().join("data");
    // the disk is full at the first attempt
    let armed = Some("artifact.make=1*return(full)->off");
    let service = Service::start(&data, armed, &["--otlp-endpoint", &collector.url]).await.expect("it listens");
    let client = client();
    let missing = client.get(format!("{}/v1/stacks/{}", service.url, uuid::Uuid::now_v7())).send().await;
    assert_eq!(missing.expect("an answer").status().as_u16(), 404);
    let ended = stack(&client, &service.url).await;
    assert_eq!((ended["state"].as_str(), ended["attempt"].as_u64()), (Some("succeeded"), Some(2)), "{ended}");
    service.stop().await;
    let spans = collector.spans();
    let refused = spans.iter().find(|it| it.attribute("http.response.status_code") == "404").expect("a span");
    assert_eq!(refused.attribute("error.type"), "not_found");
    assert!(refused.span.parent_span_id.is_empty(), "a request without traceparent begins a trace");
    let mut attempts: Vec<_> = spans.iter().filter(|it| it.span.name == "run stack").collect();
    attempts.sort_by_key(|it| it.span.start_time_unix_nano);
    let told: Vec<_> =
        attempts.iter().map(|it| (it.attribute("pinstack.job.attempt"), it.attribute("pinstack.job.ending"))).collect();
    assert_eq!(told, [("1".into(), "released".into()), ("2".into(), "succeeded".into())]);
    assert!(attempts.iter().all(|it| hex(&it.span.trace_id) == TRACE));
    one(&spans, "wait in queue");
}

/// A stack succeeds, and the process ends in time, although the collector is at this address.
async fn does_not_matter(address: &str) {
    let folder = TempDir::new().expect("a folder");
    let data = folder.path().join("data");
    let service = Service::start(&data, None, &["--otlp-endpoint", address]).await.expect("it listens");
    let client = client();
    let ended = stack(&client, &service.url).await;
    assert_eq!((ended["state"].as_str(), ended["attempt"].as_u64()), (Some("succeeded"), Some(1)), "{ended}");
    let lost = || async {
        let metrics = client.get(format!("{}/metrics", service.url)).send().await.expect("it answers");
        let metrics = metrics.text().await.expect("text");
        let line = metrics.lines().find(|line| line.starts_with("pinstack_trace_spans_total{outcome=\"lost\"}"));
        line.and_then(|line| line.rsplit(' ').next()?.parse::<u64>().ok()).expect("the series")
    };
    while lost().await == 0 {
        tokio::time::sleep(LOOK).await;
    }
    let warnings = log_of(&data).matches("the collector of traces takes no spans").count();
    assert_eq!(warnings, 1, "it is logged once");
    tokio::time::timeout(SHUTDOWN, service.stop()).await.expect("the process ends in time");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_collector_that_is_away_does_not_matter() {
    does_not_matter(&nothing().await).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_collector_that_hangs_does_not_matter() {
    does_not_matter(&hanging().await).await;
}
