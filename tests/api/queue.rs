//! The order of the queue over HTTP.

use serde_json::{Value, json};

use crate::app::{TestApp, id, problem, profile, stack_zip};

#[tokio::test]
async fn a_stack_of_another_rig_and_one_in_a_hurry_do_not_wait_for_a_scan() {
    let app = TestApp::start().await;
    let mut sent = Vec::new();
    for (rig, priority) in [("a", ""), ("a", ""), ("a", ""), ("b", ""), ("a", "&priority=low"), ("a", "&priority=high")]
    {
        app.put(&format!("/v1/profiles/{rig}/lens")).json(&profile(2)).send().await.unwrap();
        let made = app.post(&format!("/v1/stacks?rig={rig}&lens=lens{priority}")).body(stack_zip(2, 0)).send().await;
        sent.push(id(&made.unwrap().json::<Value>().await.unwrap()));
    }
    let mut claimed = Vec::new();
    for _ in &sent {
        let job = app.claim().await;
        app.finish(&job).await;
        claimed.push(job.id);
    }
    let [first, second, third, other, low, high] = sent[..] else { panic!("six were sent") };
    assert_eq!(claimed, [high, first, other, second, third, low]);
}

#[tokio::test]
async fn the_priority_is_an_option_of_a_stack_and_of_its_reruns() {
    let app = TestApp::start().await;
    let stack = app.with_stack("").await;
    assert_eq!(stack["options"]["priority"], "normal");
    let rerun = format!("/v1/stacks/{}/rerun", id(&stack));
    let again = app.post(&rerun).json(&json!({ "priority": "low" })).send().await.unwrap();
    assert_eq!(again.json::<Value>().await.unwrap()["options"]["priority"], "low");
    let refused = app.post(&rerun).json(&json!({ "priority": "urgent" })).send().await.unwrap();
    let told = problem(refused, 400, "invalid_request").await;
    let detail = told["detail"].as_str().unwrap();
    assert!(detail.contains("priority") && detail.contains("high"), "{detail}");
}

#[tokio::test]
async fn many_requests_that_wait_for_one_job_all_learn_that_another_process_ended_it() {
    let app = TestApp::start_with(|policy| policy.poll_interval = std::time::Duration::from_millis(20)).await;
    let stack = app.with_stack("").await;
    let events = format!("/v1/stacks/{}/events", id(&stack));
    let mut streams = Vec::new();
    for _ in 0..20 {
        streams.push(app.get(&events).send().await.unwrap());
    }
    app.metadata_of_another_process().await.cancel(id(&stack)).await.unwrap();
    for stream in streams {
        assert!(stream.text().await.unwrap().contains("\"state\":\"cancelled\""));
    }
}
