use pinstack::contract::{Code, Fault};
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::app::{TestApp, id, problem, stack_zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

#[tokio::test]
async fn a_stack_goes_from_queued_to_succeeded() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 2);
    let request =
        app.post(&format!("{POST}&label=bee&r1=20")).header("content-disposition", "attachment; filename=b.zip");
    let answer = request.body(zip.clone()).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    let location = answer.headers()["location"].to_str().unwrap().to_owned();
    let stack: Value = answer.json().await.unwrap();
    assert_eq!(location, format!("/v1/stacks/{}", id(&stack)));
    assert_eq!((&stack["state"], &stack["attempt"], &stack["image"]), (&json!("queued"), &json!(0), &Value::Null));
    assert_eq!((&stack["options"]["r1"], &stack["options"]["r2"]), (&json!(20), &json!(7)));
    assert_eq!(stack["slices"]["front"].as_array().unwrap().len(), 2);
    assert_eq!(stack["upload"]["bytes"].as_u64(), Some(zip.len() as u64));
    assert_eq!((&stack["upload"]["filename"], &stack["profile_revision"]), (&json!("b.zip"), &json!(1)));
    assert!(stack["upload"].get("key").is_none(), "keys of blobs are internal");
    assert!(stack["links"]["cancel"].is_string() && stack["links"].get("image").is_none());
    problem(app.get(&format!("{location}/metrics")).send().await.unwrap(), 409, "not_finished").await;
    problem(app.get(&format!("{location}/image")).send().await.unwrap(), 409, "not_finished").await;

    let job = app.claim().await;
    let running: Value = app.get(&location).send().await.unwrap().json().await.unwrap();
    assert_eq!((&running["state"], &running["attempt"]), (&json!("running"), &json!(1)));
    assert!(running["started_at"].is_string());

    app.finish(&job).await;
    let ended: Value = app.get(&location).send().await.unwrap().json().await.unwrap();
    assert_eq!((&ended["state"], &ended["error"]), (&json!("succeeded"), &Value::Null));
    assert_eq!(ended["image"]["crop_offset_px"], json!([0, 0]));
    assert_eq!(ended["links"]["mask"], format!("{location}/mask"));
    assert!(ended["links"].get("cancel").is_none());
    let metrics: Value = app.get(&format!("{location}/metrics")).send().await.unwrap().json().await.unwrap();
    assert_eq!(metrics, ended["metrics"]);
}

#[tokio::test]
async fn a_failed_stack_has_a_reason_and_no_results() {
    let app = TestApp::start().await;
    let stack = app.with_stack("").await;
    let job = app.claim().await;
    app.fail(&job, Fault::new(Code::InvalidImage, "img_1.png is torn").in_file("img_1.png", Some(1))).await;
    let url = format!("/v1/stacks/{}", id(&stack));
    let ended: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert_eq!((&ended["state"], &ended["error"]["code"]), (&json!("failed"), &json!("invalid_image")));
    assert_eq!((&ended["error"]["instance"], &ended["error"]["errors"][0]["slice"]), (&json!(url), &json!(1)));
    let told = problem(app.get(&format!("{url}/image")).send().await.unwrap(), 404, "no_result").await;
    assert!(told["detail"].as_str().unwrap().contains("img_1.png is torn"), "{told}");
    problem(app.get(&format!("{url}/metrics")).send().await.unwrap(), 404, "no_result").await;
}

#[tokio::test]
async fn a_waiting_stack_is_cancelled_at_once_and_an_ended_one_cannot_be() {
    let app = TestApp::start().await;
    let stack = app.with_stack("").await;
    let url = format!("/v1/stacks/{}", id(&stack));
    for _ in 0..2 {
        let answer = app.post(&format!("{url}/cancel")).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::ACCEPTED);
        assert_eq!(answer.json::<Value>().await.unwrap()["state"], "cancelled");
    }
    problem(app.get(&format!("{url}/image")).send().await.unwrap(), 404, "no_result").await;

    app.post(POST).body(stack_zip(2, 0)).send().await.unwrap();
    let job = app.claim().await;
    app.finish(&job).await;
    problem(app.post(&format!("/v1/stacks/{}/cancel", job.id)).send().await.unwrap(), 409, "conflict").await;
}

#[tokio::test]
async fn a_running_stack_shows_that_cancellation_was_requested() {
    let app = TestApp::start().await;
    app.with_stack("").await;
    let job = app.claim().await;
    let answer = app.post(&format!("/v1/stacks/{}/cancel", job.id)).send().await.unwrap();
    let shown: Value = answer.json().await.unwrap();
    assert_eq!((&shown["state"], &shown["cancel_requested"]), (&json!("running"), &json!(true)));
}

#[tokio::test]
async fn deleting_a_stack_deletes_its_upload_and_results() {
    let app = TestApp::start().await;
    app.with_stack("").await;
    let job = app.claim().await;
    app.finish(&job).await;
    let url = format!("/v1/stacks/{}", job.id);
    assert_eq!(app.delete(&url).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(app.get(&url).send().await.unwrap(), 404, "not_found").await;
    problem(app.delete(&url).send().await.unwrap(), 404, "not_found").await;
    assert_eq!(app.blob(&job.request.upload().key).await, None);
    assert!(app.jobs_with_blobs().await.is_empty());
}

#[tokio::test]
async fn a_repeat_with_the_same_key_returns_the_first_stack() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let send = |options: &str, zip: Vec<u8>| {
        app.post(&format!("{POST}{options}")).header("idempotency-key", "night run 7").body(zip).send()
    };
    let first: Value = send("", stack_zip(2, 2)).await.unwrap().json().await.unwrap();
    let again = send("", stack_zip(2, 2)).await.unwrap();
    assert_eq!(
        (again.status(), &again.headers()["idempotency-replayed"]),
        (StatusCode::ACCEPTED, &"true".parse().unwrap())
    );
    assert_eq!(id(&again.json().await.unwrap()), id(&first));
    problem(send("&r1=20", stack_zip(2, 2)).await.unwrap(), 422, "idempotency_key_reused").await;
    problem(send("", stack_zip(2, 0)).await.unwrap(), 422, "idempotency_key_reused").await;
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 1);
    assert_eq!(app.spooled(), 0);
    assert_eq!(app.jobs_with_blobs().await.len(), 1);
}

#[tokio::test]
async fn stacks_are_listed_newest_first_and_by_state() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let first = app.with_stack("&scan=bee").await;
    let second: Value = app.post(POST).body(stack_zip(2, 0)).send().await.unwrap().json().await.unwrap();
    app.claim().await;
    let ids = |query: &'static str| {
        let request = app.get(&format!("/v1/stacks{query}"));
        async move {
            let page: Value = request.send().await.unwrap().json().await.unwrap();
            page["items"].as_array().unwrap().iter().map(id).collect::<Vec<_>>()
        }
    };
    assert_eq!(ids("").await, [id(&second), id(&first)]);
    assert_eq!(ids("?state=running").await, [id(&first)]);
    assert_eq!(ids("?scan=bee&rig=rig&lens=lens").await, [id(&first)]);
    assert!(ids("?rig=other").await.is_empty());
    problem(app.get("/v1/stacks?state=done").send().await.unwrap(), 400, "invalid_request").await;
    assert!(app.get("/v1/calibrations").send().await.unwrap().text().await.unwrap().contains("\"items\":[]"));
}

#[tokio::test]
async fn a_calibration_is_a_job_of_its_own_kind() {
    let app = TestApp::start().await;
    let post = "/v1/profiles/rig/lens/calibrations";
    let answer =
        app.post(&format!("{post}?target_pitch_mm=1.5&note=new%20target")).body(stack_zip(2, 0)).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    let location = answer.headers()["location"].to_str().unwrap().to_owned();
    let shown: Value = answer.json().await.unwrap();
    assert_eq!((&shown["options"]["target_pitch_mm"], &shown["options"]["note"]), (&json!(1.5), &json!("new target")));
    problem(app.get(&format!("/v1/stacks/{}", id(&shown))).send().await.unwrap(), 404, "not_found").await;
    problem(app.get(&format!("{location}/overlay")).send().await.unwrap(), 409, "not_finished").await;
    let job = app.claim().await;
    app.finish(&job).await;
    let ended: Value = app.get(&location).send().await.unwrap().json().await.unwrap();
    assert_eq!((&ended["result"]["verdict"], &ended["result"]["reference_index"]), (&json!("good"), &json!(1)));
    assert_eq!(ended["links"]["profile"], "/v1/profiles/rig/lens?revision=1");
    let overlay = |query: &'static str| app.get(&format!("{location}/overlay{query}")).send();
    let reference = overlay("").await.unwrap().bytes().await.unwrap();
    assert_eq!(reference, overlay("?slice=1").await.unwrap().bytes().await.unwrap());
    assert_ne!(reference, overlay("?slice=0").await.unwrap().bytes().await.unwrap());
    problem(overlay("?slice=9").await.unwrap(), 404, "no_result").await;
    problem(
        app.post(&format!("{post}?reference_index=5")).body(stack_zip(2, 0)).send().await.unwrap(),
        400,
        "invalid_request",
    )
    .await;
    problem(
        app.post(&format!("{post}?pixel_pitch_mm=-1")).body(stack_zip(2, 0)).send().await.unwrap(),
        400,
        "invalid_request",
    )
    .await;
}
