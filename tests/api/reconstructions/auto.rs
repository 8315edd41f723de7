//! Scans that are reconstructed by themselves.

use std::time::Duration;

use pinstack::{contract::Code, contract::Fault, store::tokens::Scope};
use reqwest::StatusCode;
use serde_json::{Value, json};

use super::{WORKS, ended, program, text, view, workers};
use crate::{
    access::token,
    app::{TestApp, problem, profile, stack_zip},
};

async fn put(app: &TestApp, scan: &Value) -> reqwest::Response {
    app.put("/v1/scans/bee").json(scan).send().await.expect("an answer")
}

/// The reconstructions of the scan, newest first, once the service has nothing left to examine.
async fn made(app: &TestApp) -> Vec<Value> {
    while !app.store.metadata.settled_scans().await.expect("the rows answer").is_empty() {
        tokio::task::yield_now().await;
    }
    let list: Value = app.get("/v1/scans/bee/reconstructions").send().await.unwrap().json().await.unwrap();
    list["items"].as_array().expect("a list").clone()
}

#[tokio::test]
async fn a_scan_is_reconstructed_by_itself_once_for_each_set_of_views() {
    let app = TestApp::start_with(|policy| policy.poll_interval = Duration::from_millis(1)).await;
    let folder = tempfile::tempdir().expect("a folder");
    let scan = json!({ "rig": "rig", "lens": "lens", "expected_views": 4, "reconstruct": "auto" });
    assert_eq!(put(&app, &scan).await.status(), StatusCode::CREATED);
    assert!(text(&app, "/scans/bee").await.contains("begins by itself"));
    for pan in [0, 20, 40] {
        view(&app, pan).await;
    }
    assert_eq!(made(&app).await, [] as [Value; 0], "a view is missing");
    app.with_stack("&scan=bee&pan_deg=60&tilt_deg=0").await;
    let job = app.claim().await;
    app.fail(&job, Fault::new(Code::Internal, "a bug")).await;
    assert_eq!(made(&app).await, [] as [Value; 0], "the last view has no result");
    view(&app, 60).await;
    let first = made(&app).await;
    assert_eq!(first.len(), 1);

    let pool = workers(&app, Some(&program(&folder, WORKS)), Duration::from_secs(600));
    assert_eq!(ended(&app, &first[0]).await["result"]["registered"], 3);
    pool.shutdown(Duration::ZERO).await;
    // nothing about the views has changed
    let noted = json!({ "rig": "rig", "lens": "lens", "expected_views": 4, "reconstruct": "auto", "note": "new" });
    assert_eq!(put(&app, &noted).await.status(), StatusCode::OK);
    assert_eq!(made(&app).await.len(), 1);
    // a view is replaced, another is added: while one of them waits, nothing begins
    app.with_stack("&scan=bee&pan_deg=80&tilt_deg=0").await;
    let added = app.claim().await;
    view(&app, 40).await;
    assert_eq!(made(&app).await.len(), 1);
    app.finish_stack(&added, |outcome| outcome.image.intrinsics = Some(super::camera())).await;
    let second = made(&app).await;
    assert_eq!(second.len(), 2);
    // what a person deletes does not come back
    let path = second[0]["links"]["self"].as_str().expect("a path");
    assert_eq!(app.delete(path).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    assert_eq!(made(&app).await.len(), 1);
    // nor is made again what a person has asked for
    let asked = app.post("/v1/scans/bee/reconstructions").send().await.unwrap();
    assert_eq!(asked.status(), StatusCode::ACCEPTED);
    assert_eq!(put(&app, &scan).await.status(), StatusCode::OK);
    assert_eq!(made(&app).await.len(), 2);
}

#[tokio::test]
async fn it_needs_the_number_of_views_and_colmap() {
    let app = TestApp::start_with(|policy| policy.reconstructs = false).await;
    let scan = |views: Value| json!({ "rig": "rig", "lens": "lens", "expected_views": views, "reconstruct": "auto" });
    let endless = problem(put(&app, &scan(Value::Null)).await, 400, "invalid_request").await;
    assert_eq!(endless["errors"][0]["pointer"], "/expected_views", "{endless}");
    let refused = problem(put(&app, &scan(json!(2))).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("apt-get install colmap"), "{refused}");
    assert!(!text(&app, "/send").await.contains("name=\"reconstruct\""));
}

#[tokio::test]
async fn where_tokens_see_only_their_own_it_belongs_to_the_token_of_the_scan() {
    let app = TestApp::start_with(|policy| {
        (policy.auth_required, policy.isolate_tokens) = (true, true);
        policy.poll_interval = Duration::from_millis(1);
    })
    .await;
    let both = [Scope::StacksWrite, Scope::Read];
    let (ann, ben) = (token(&app, "ann", &both).await, token(&app, "ben", &both).await);
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    let send = async |request: reqwest::RequestBuilder, token: &str| {
        request.bearer_auth(token).send().await.expect("an answer")
    };
    assert!(send(app.put("/v1/profiles/rig/lens").json(&profile(2)), &admin).await.status().is_success());
    let scan = json!({ "rig": "rig", "lens": "lens", "expected_views": 1, "reconstruct": "auto" });
    assert_eq!(send(app.put("/v1/scans/bee").json(&scan), &ann).await.status(), 201);
    let stack = app.post("/v1/stacks?rig=rig&lens=lens&scan=bee&pan_deg=0&tilt_deg=0").body(stack_zip(2, 2));
    assert_eq!(send(stack, &ann).await.status(), 202);
    app.finish(&app.claim().await).await;
    let number = async |token: &str| {
        let list: Value = send(app.get("/v1/reconstructions"), token).await.json().await.expect("JSON");
        list["items"].as_array().expect("a list").len()
    };
    while number(&ann).await == 0 {
        tokio::task::yield_now().await;
    }
    assert_eq!((number(&ann).await, number(&ben).await, number(&admin).await), (1, 0, 1));
}
