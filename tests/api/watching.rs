use std::time::Duration;

use pinstack::contract::Progress;
use reqwest::StatusCode;
use serde_json::Value;

use crate::app::{TestApp, id, stack_zip};

/// The events of a finished event stream: kind, id, data.
fn events(text: &str) -> Vec<(String, Option<i64>, Value)> {
    let field = |block: &str, name: &str| {
        block
            .lines()
            .find_map(|line| line.strip_prefix(name).map(|value| value.trim_start_matches(':').trim().to_owned()))
    };
    text.split("\n\n")
        .filter(|block| block.contains("data:"))
        .map(|block| {
            let id = field(block, "id").and_then(|id| id.parse().ok());
            let data = serde_json::from_str(&field(block, "data").unwrap()).unwrap();
            (field(block, "event").unwrap(), id, data)
        })
        .collect()
}

#[tokio::test]
async fn the_event_stream_contains_the_state_the_progress_and_the_end() {
    let app = TestApp::start().await;
    let stack = app.with_stack("").await;
    let url = format!("/v1/stacks/{}/events", id(&stack));
    let mut stream = app.get(&url).send().await.unwrap();
    assert_eq!(stream.headers()["content-type"], "text/event-stream");
    let mut text = String::new();
    // each step waits until the previous one was sent
    let mut hear = async |until: &str| {
        while !text.contains(until) {
            let Some(chunk) = stream.chunk().await.unwrap() else { break };
            text.push_str(&String::from_utf8_lossy(&chunk));
        }
        assert!(text.contains(until), "{until} is not in {text}");
    };
    hear("\"state\":\"queued\"").await;
    let job = app.claim().await;
    hear("\"state\":\"running\"").await;
    let progress = Progress { stage: "fusing".into(), completed: 1, total: 2, fraction: 0.5 };
    app.store.metadata.heartbeat(job.id, job.lease_token, Duration::from_secs(60), &progress).await.unwrap();
    hear("\"fraction\":0.5").await;
    app.finish(&job).await;
    hear("\"state\":\"succeeded\"").await;
    assert!(stream.chunk().await.unwrap().is_none(), "the stream ends with the job");

    let told = events(&text);
    let states: Vec<&Value> =
        told.iter().filter(|(kind, ..)| kind == "state").map(|(.., data)| &data["state"]).collect();
    assert_eq!(states, ["queued", "running", "succeeded"]);
    assert_eq!(told.last().map(|(kind, ..)| kind.as_str()), Some("state"));
    let ids: Vec<i64> = told.iter().filter_map(|(_, id, _)| *id).collect();
    assert!(ids.windows(2).all(|w| w[0] < w[1]), "{ids:?}");

    // a client that has the last event gets 204; a client that has less gets the end
    let last = ids.last().unwrap().to_string();
    assert_eq!(app.get(&url).header("last-event-id", last).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    let late = app.get(&url).header("last-event-id", ids[0].to_string()).send().await.unwrap().text().await.unwrap();
    assert!(late.contains("\"state\":\"succeeded\"") && !late.contains("\"state\":\"queued\""), "{late}");
}

#[tokio::test]
async fn a_change_by_another_process_is_sent_as_an_event() {
    let app = TestApp::start_with(|policy| policy.poll_interval = Duration::from_millis(20)).await;
    let stack = app.with_stack("").await;
    let stream = app.get(&format!("/v1/stacks/{}/events", id(&stack))).send().await.unwrap();
    app.metadata_of_another_process().await.cancel(id(&stack)).await.unwrap();
    assert!(stream.text().await.unwrap().contains("\"state\":\"cancelled\""));
}

#[tokio::test]
async fn a_client_that_prefers_to_wait_gets_the_finished_stack() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let post = |wait: &'static str| {
        app.post("/v1/stacks?rig=rig&lens=lens").header("prefer", wait).body(stack_zip(2, 0)).send()
    };
    let mut changes = app.store.metadata.changes();
    let worker = async {
        changes.recv().await.unwrap();
        let job = app.claim().await;
        app.finish(&job).await;
    };
    let (answer, ()) = tokio::join!(post("wait=30"), worker);
    let answer = answer.unwrap();
    assert_eq!(
        (answer.status(), &answer.headers()["preference-applied"]),
        (StatusCode::OK, &"wait=30".parse().unwrap())
    );
    assert_eq!(answer.json::<Value>().await.unwrap()["state"], "succeeded");

    let late = post("wait=0").await.unwrap();
    assert_eq!(
        (late.status(), &late.headers()["preference-applied"]),
        (StatusCode::ACCEPTED, &"wait=0".parse().unwrap())
    );
    assert_eq!(late.json::<Value>().await.unwrap()["state"], "queued");
}
