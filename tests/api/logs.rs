//! The log: one event per line, with reason, caller and place.

use reqwest::{Client, StatusCode};
use serde_json::Value;

use crate::{
    app::{profile, stack_zip},
    process::{Process, pinstack},
};

fn client() -> Client {
    Client::builder().no_proxy().build().expect("a client")
}

async fn with_profile(process: &Process) {
    let put = client().put(format!("{}/v1/profiles/rig/lens", process.base)).json(&profile(2)).send().await.unwrap();
    assert_eq!(put.status(), StatusCode::CREATED);
}

#[tokio::test]
async fn a_refusal_is_logged_with_its_reason_and_its_caller() {
    let folder = tempfile::tempdir().unwrap();
    let added =
        pinstack(&["token", "add", "rig-pc", "--scope", "admin"], &folder.path().join("data")).output().unwrap();
    let token = String::from_utf8(added.stdout).unwrap().trim().to_owned();
    let process = Process::start_in(folder, &[]).await;
    let send = |request: reqwest::RequestBuilder, id: &str| {
        request.header("x-request-id", id).header("x-forwarded-for", "10.1.2.3, 10.9.8.7").bearer_auth(&token).send()
    };
    let client = client();
    let put = client.put(format!("{}/v1/profiles/rig/lens", process.base)).json(&profile(2));
    assert_eq!(send(put, "first").await.unwrap().status(), StatusCode::CREATED);

    let post = client.post(format!("{}/v1/stacks?rig=rig&lens=lens", process.base)).body("no zip");
    assert_eq!(send(post, "find-me").await.unwrap().status(), StatusCode::UNPROCESSABLE_ENTITY);
    let line = process.logged(&["find-me", "refused"]).await;
    for told in
        ["token=rig-pc", "client=10.9.8.7", "rig=rig", "lens=lens", "status=422", "code=invalid_archive", "detail="]
    {
        assert!(line.contains(told), "{told} is not in {line}");
    }

    // a client cannot forge log lines
    let list = client.get(format!("{}/v1/stacks?x%0AERROR%20forged%1B[31m=1", process.base));
    assert_eq!(send(list, "forger").await.unwrap().status(), StatusCode::BAD_REQUEST);
    let line = process.logged(&["forger", "refused"]).await;
    assert!(line.contains("code=invalid_request") && line.contains("forged"), "{line}");
    let log = process.log();
    assert!(!log.contains('\u{1b}') && !log.lines().any(|line| line.starts_with("ERROR")), "{log}");

    // nor flood the log
    let long = client.get(format!("{}/v1/{}", process.base, "x".repeat(50_000)));
    assert_eq!(send(long, "long").await.unwrap().status(), StatusCode::NOT_FOUND);
    assert!(process.logged(&["long", "refused"]).await.len() < 3000);
    // the secret may contain underscores itself
    let secret = token.splitn(3, '_').nth(2).expect("a token has three parts");
    assert!(!process.log().contains(secret), "a secret is in the log");
}

#[tokio::test]
async fn a_job_that_fails_is_logged_with_its_reason() {
    let process = Process::start(&[]).await;
    let url = format!("{}/v1/profiles/desk/macro/calibrations", process.base);
    let post = client().post(url).header("x-request-id", "find-me").header("prefer", "wait=60").body(stack_zip(3, 0));
    let job: Value = post.send().await.unwrap().json().await.unwrap();
    assert_eq!(job["state"], "failed", "{job}");
    let id = job["id"].as_str().unwrap();
    let line = process.logged(&[id, "job leaves its worker"]).await;
    let code = job["error"]["code"].as_str().unwrap();
    for told in ["rig=desk", "lens=macro", &format!("code={code}"), "detail="] {
        assert!(line.contains(told), "{told} is not in {line}");
    }
    // the line of the request contains both ids
    let line = process.logged(&["find-me", &format!("job={id}"), "answered"]).await;
    assert_eq!(line.matches("rig=desk").count(), 1, "{line}");
}

#[tokio::test]
async fn every_log_line_of_a_request_has_its_id_at_level_warn_too() {
    let process = Process::start(&["--log", "warn"]).await;
    with_profile(&process).await;
    let uploads = process.folder.path().join("data/blobs/uploads");
    std::fs::remove_dir_all(&uploads).unwrap();
    std::fs::write(&uploads, "no folder").unwrap();
    let post = client().post(format!("{}/v1/stacks?rig=rig&lens=lens", process.base)).body(stack_zip(2, 0));
    let answer = post.header("x-request-id", "find-me").send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::INTERNAL_SERVER_ERROR);
    process.logged(&["find-me", "ERROR", "internal error"]).await;
    process.logged(&["find-me", "WARN", "code=internal"]).await;
    let log = process.log();
    let without: Vec<&str> = log.lines().filter(|line| line.contains("ERROR") && !line.contains("find-me")).collect();
    assert!(without.is_empty(), "{without:?}");
}

#[tokio::test]
async fn a_json_log_line_contains_each_field_once() {
    let process = Process::start(&["--log-format", "json"]).await;
    let answer = client().get(format!("{}/v1/nothing", process.base)).header("x-request-id", "find-me").send();
    assert_eq!(answer.await.unwrap().status(), StatusCode::NOT_FOUND);
    let line = process.logged(&["find-me"]).await;
    let told: Value = serde_json::from_str(&line).unwrap();
    assert_eq!((&told["span"]["id"], &told["fields"]["code"]), (&"find-me".into(), &"not_found".into()), "{line}");
    assert_eq!(line.matches("find-me").count(), 1, "{line}");
}
