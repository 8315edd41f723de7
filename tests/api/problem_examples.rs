//! The examples of `GET /problems/{code}` are sentences that the service sends.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::app::{HEIGHT, TestApp, WIDTH, id, png, stack_zip, zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// A sentence without the values in it: names in quotes, numbers and ids.
fn shape(sentence: &str) -> String {
    let unquoted: String = sentence.split('\'').step_by(2).collect::<Vec<_>>().join("''");
    let words = unquoted.split(' ').map(|word| {
        let is_value = word.chars().any(|c| c.is_ascii_digit()) || word.starts_with('/');
        if is_value { "#" } else { word }
    });
    words.collect::<Vec<_>>().join(" ")
}

/// The problems of many wrong requests, by code.
async fn provoked() -> BTreeMap<String, Vec<String>> {
    let app = TestApp::start_with(|policy| {
        policy.queue_limit = 2;
        policy.max_upload_bytes = 20_000;
    })
    .await;
    let no_profile = app.post(POST).body(stack_zip(2, 0)).send().await;
    app.with_profile(2).await;
    app.with_scan("bee-42").await;
    let with_key = |back: usize| app.post(POST).header("idempotency-key", "k").body(stack_zip(2, back)).send();
    let stack: Value = with_key(0).await.unwrap().json().await.unwrap();
    let url = format!("/v1/stacks/{}", id(&stack));
    let image = format!("{url}/image");
    let job = app.claim().await;
    let unfinished = app.get(&image).send().await;
    app.finish_stack(&job, |outcome| outcome.artifacts.retain(|artifact| artifact.name != "mask")).await;
    let wide = |i| (format!("front/img_{i}.png"), png(WIDTH + 2, HEIGHT, 3, i));
    let mut answers = vec![
        no_profile,
        unfinished,
        app.post(&format!("{POST}&mask=yes")).body(stack_zip(2, 0)).send().await,
        app.get("/v1/stacks/0196e1b4-2f0a-7c3e-9a51-6d1f0c2b7a10").send().await,
        app.post("/v1/info").send().await,
        app.post(&format!("{POST}&scan=bee-24")).body(stack_zip(2, 0)).send().await,
        app.post(POST).header("content-type", "image/jpeg").body("x").send().await,
        app.post(POST).body(stack_zip(3, 0)).send().await,
        app.post(POST).body(zip(&[wide(0), wide(1)])).send().await,
        app.post(&format!("{POST}&mask=required")).body(stack_zip(2, 0)).send().await,
        app.post(POST).body(vec![0; 20_001]).send().await,
        app.get(&image).header("range", "bytes=9000000-").send().await,
        app.get(&format!("{url}/mask")).send().await,
        app.post(&format!("{url}/cancel")).send().await,
        app.put("/v1/profiles/rig/lens").header("if-match", "\"7\"").json(&crate::app::profile(2)).send().await,
        with_key(2).await,
    ];
    for _ in 0..2 {
        app.with_stack("").await;
    }
    answers.push(app.post(POST).body(stack_zip(2, 0)).send().await);
    let mut sent: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for answer in answers {
        let problem: Value = answer.unwrap().json().await.unwrap();
        let text = |name: &str| problem[name].as_str().unwrap_or_else(|| panic!("no {name}: {problem}")).to_owned();
        sent.entry(text("code")).or_default().push(text("detail"));
    }
    sent
}

#[tokio::test]
async fn examples_of_problems_are_sentences_that_the_service_sends() {
    let sent = provoked().await;
    assert_eq!(sent.len(), 17, "{:?}", sent.keys());
    let app = TestApp::start().await;
    for (code, details) in sent {
        let kind: Value = app.get(&format!("/problems/{code}")).send().await.unwrap().json().await.unwrap();
        let example =
            kind["example"]["detail"].as_str().or(kind["example"].as_str()).unwrap_or_else(|| panic!("{kind}"));
        let shapes: Vec<String> = details.iter().map(|detail| shape(detail)).collect();
        assert!(shapes.contains(&shape(example)), "{code}: {example}: {}", json!(details));
    }
}
