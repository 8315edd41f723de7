//! Reruns of stacks, and downloads of their zips.

use std::time::Duration;

use pinstack::store::{
    Retention,
    gc::collect,
    verify::{Depth, verify},
};
use reqwest::{Response, StatusCode};
use serde_json::{Value, json};

use crate::app::{TestApp, id, problem, profile, stack_zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

async fn rerun(app: &TestApp, stack: &Value, changes: Value) -> Response {
    app.post(&format!("/v1/stacks/{}/rerun", id(stack))).json(&changes).send().await.unwrap()
}

async fn accepted(answer: Response) -> Value {
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    answer.json().await.unwrap()
}

/// Sends a stack with a zip of this file name. Returns both.
async fn sent(app: &TestApp, query: &str) -> (Value, Vec<u8>) {
    app.with_profile(2).await;
    let zip = stack_zip(2, 2);
    let request = app.post(&format!("{POST}{query}")).body(zip.clone());
    let named = request.header("content-disposition", "attachment; filename=\"view 1.zip\"");
    (accepted(named.send().await.unwrap()).await, zip)
}

async fn upload_of(app: &TestApp, stack: &Value) -> Response {
    app.get(stack["links"]["upload"].as_str().expect("a link")).send().await.unwrap()
}

/// Checks that garbage collection removes all garbage and nothing that is in use.
async fn cleaned(app: &TestApp) {
    collect(&app.store, Duration::ZERO, &Retention::default()).await.unwrap();
    let report = verify(&app.store, Depth::Digests).await.unwrap();
    assert_eq!((report.faults, report.orphans), (Vec::new(), 0));
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn a_rerun_makes_another_stack_from_the_same_zip() {
    let app = TestApp::start().await;
    let (first, zip) = sent(&app, "&r1=20&label=bee&keep_days=3").await;
    let answer = rerun(&app, &first, json!({ "r1": 30, "label": null, "format": "tiff" })).await;
    let location = answer.headers()["location"].to_str().unwrap().to_owned();
    let again = accepted(answer).await;
    assert_eq!(location, format!("/v1/stacks/{}", id(&again)));
    assert_ne!(id(&again), id(&first));
    assert_eq!((&again["state"], &again["rerun_of"]), (&json!("queued"), &json!(id(&first))));
    let options = &again["options"];
    assert_eq!((&options["r1"], &options["format"], &options["label"]), (&json!(30), &json!("tiff"), &Value::Null));
    assert_eq!(options["keep_days"], 3, "what is not named stays");
    for same in ["upload", "slices", "profile_revision", "profile_digest", "rig", "lens"] {
        assert_eq!(again[same], first[same], "{same}");
    }
    let shown: Value = app.get(&format!("/v1/stacks/{}", id(&first))).send().await.unwrap().json().await.unwrap();
    assert_eq!(shown, first, "the first stays as it is");

    // each keeps the zip: deleting one does not affect the other, waiting or running
    let deleted = app.delete(&format!("/v1/stacks/{}", id(&first))).send().await.unwrap();
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    cleaned(&app).await;
    let job = app.claim().await;
    assert_eq!(job.id, id(&again));
    let found = app.blob(&job.request.upload().key).await.expect("the worker finds the zip");
    assert_eq!(found, zip);
    app.finish(&job).await;
    assert_eq!(upload_of(&app, &again).await.bytes().await.unwrap(), zip);
    let third = accepted(rerun(&app, &again, json!({})).await).await;
    assert_eq!((&third["options"]["r1"], &third["rerun_of"]), (&json!(30), &json!(id(&again))));
    cleaned(&app).await;
}

#[tokio::test]
async fn the_zip_can_be_downloaded_as_it_was_sent() {
    let app = TestApp::start().await;
    let (stack, zip) = sent(&app, "").await;
    let answer = upload_of(&app, &stack).await;
    assert_eq!(answer.status(), StatusCode::OK);
    let header = |answer: &Response, name: &str| answer.headers()[name].to_str().unwrap().to_owned();
    assert_eq!(header(&answer, "content-type"), "application/zip");
    assert_eq!(header(&answer, "content-disposition"), "attachment; filename=\"view 1.zip\"");
    assert!(header(&answer, "repr-digest").starts_with("sha-256=:"));
    let tag = header(&answer, "etag");
    assert_eq!(tag.trim_matches('"'), stack["upload"]["sha256"]);
    assert_eq!(answer.bytes().await.unwrap(), zip);
    let url = format!("/v1/stacks/{}/upload", id(&stack));
    let part = app.get(&url).header("range", "bytes=2-5").send().await.unwrap();
    assert_eq!(part.status(), StatusCode::PARTIAL_CONTENT);
    assert_eq!(part.bytes().await.unwrap(), zip[2..6]);
    let known = app.get(&url).header("if-none-match", tag).send().await.unwrap();
    assert_eq!(known.status(), StatusCode::NOT_MODIFIED);
}

#[tokio::test]
async fn a_rerun_is_checked_like_a_new_stack() {
    let app = TestApp::start_with(|policy| policy.queue_limit = 2).await;
    let (stack, _) = sent(&app, "").await;
    for (changes, code) in [
        (json!({ "radius": 1 }), "invalid_request"),
        (json!({ "r1": 0 }), "invalid_request"),
        (json!({ "crop": "0,0,1000,1000" }), "invalid_request"),
        (json!([1]), "invalid_request"),
    ] {
        problem(rerun(&app, &stack, changes).await, 400, code).await;
    }
    let url = format!("/v1/stacks/{}/rerun", id(&stack));
    problem(app.post(&format!("{url}?r1=3")).send().await.unwrap(), 400, "invalid_request").await;
    problem(app.post(&url).body("{").send().await.unwrap(), 400, "invalid_request").await;
    let text = app.post(&url).header("content-type", "text/plain").body("{}").send().await.unwrap();
    problem(text, 415, "unsupported_media_type").await;
    problem(rerun(&app, &stack, json!({ "profile_revision": 7 })).await, 404, "profile_not_found").await;
    let unknown = json!({ "id": "0196e1b4-2f0a-7c3e-9a51-6d1f0c2b7a10" });
    problem(rerun(&app, &unknown, json!({})).await, 404, "not_found").await;

    // a revision with more slices than the zip has
    let put = app.put("/v1/profiles/rig/lens").json(&profile(3)).send().await.unwrap();
    assert_eq!(put.status(), StatusCode::OK);
    problem(rerun(&app, &stack, json!({ "profile_revision": 2 })).await, 422, "slice_count_mismatch").await;
    problem(rerun(&app, &stack, json!({ "profile_revision": null })).await, 422, "slice_count_mismatch").await;
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 1);
    cleaned(&app).await;

    accepted(rerun(&app, &stack, json!({})).await).await;
    problem(rerun(&app, &stack, json!({})).await, 503, "queue_full").await;
}

#[tokio::test]
async fn a_rerun_uses_the_revision_of_the_stack_unless_another_is_given() {
    let app = TestApp::start().await;
    let (stack, _) = sent(&app, "").await;
    app.with_profile(2).await;
    for (changes, revision) in
        [(json!({}), 1), (json!({ "profile_revision": null }), 2), (json!({ "profile_revision": 2 }), 2)]
    {
        let again = accepted(rerun(&app, &stack, changes).await).await;
        assert_eq!(again["profile_revision"], revision);
    }
    assert!(app.delete("/v1/profiles/rig/lens").send().await.unwrap().status().is_success());
    let again = accepted(rerun(&app, &stack, json!({})).await).await;
    assert_eq!(again["profile_revision"], 1, "what was used can be used again");
    problem(rerun(&app, &stack, json!({ "profile_revision": null })).await, 404, "profile_not_found").await;
}

#[tokio::test]
async fn a_repeated_rerun_returns_the_first_new_stack() {
    let app = TestApp::start().await;
    let (stack, zip) = sent(&app, "").await;
    let url = format!("/v1/stacks/{}/rerun", id(&stack));
    let send = |changes: Value| app.post(&url).header("idempotency-key", "again").json(&changes).send();
    let first = accepted(send(json!({ "r1": 9 })).await.unwrap()).await;
    let repeated = send(json!({ "r1": 9 })).await.unwrap();
    assert_eq!(repeated.headers()["idempotency-replayed"], "true");
    assert_eq!(accepted(repeated).await, first);
    problem(send(json!({ "r1": 10 })).await.unwrap(), 422, "idempotency_key_reused").await;
    // a different request with the same effect is not a repeat
    let posted = app.post(&format!("{POST}&r1=9&profile_revision=1")).header("idempotency-key", "again").body(zip);
    problem(posted.send().await.unwrap(), 422, "idempotency_key_reused").await;
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 2);
    cleaned(&app).await;
}

#[tokio::test]
async fn a_rerun_without_the_zip_is_refused() {
    let app = TestApp::start().await;
    let (stack, zip) = sent(&app, "").await;
    app.finish(&app.claim().await).await;
    // made before the zip expires: it keeps the zip
    let again = accepted(rerun(&app, &stack, json!({})).await).await;
    let over = Retention { uploads: Some(Duration::ZERO), ..Retention::default() };
    let swept = collect(&app.store, Duration::ZERO, &over).await.unwrap();
    assert_eq!(swept.uploads, 1);
    let url = format!("/v1/stacks/{}", id(&stack));
    let told = problem(rerun(&app, &stack, json!({})).await, 410, "upload_removed").await;
    assert!(told["detail"].as_str().unwrap().contains("send the zip again"), "{told}");
    problem(app.get(&format!("{url}/upload")).send().await.unwrap(), 410, "upload_removed").await;
    let shown: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert!(shown["links"].get("rerun").is_none() && shown["links"].get("upload").is_none(), "{}", shown["links"]);
    assert_eq!(upload_of(&app, &again).await.bytes().await.unwrap(), zip);
    cleaned(&app).await;
}
