//! Uploads and jobs share one disk budget.

use std::time::Duration;

use reqwest::StatusCode;
use serde_json::Value;
use tokio::{io::AsyncWriteExt, net::TcpStream};

use crate::app::{TestApp, problem, stack_zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";
const GIB: u64 = 1 << 30;

/// Sends a POST that announces `length` bytes, and only its first bytes.
async fn announced(app: &TestApp, length: u64) -> TcpStream {
    let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    let head = format!(
        "POST {POST} HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/zip\r\ncontent-length: {length}\r\n\r\nP"
    );
    socket.write_all(head.as_bytes()).await.unwrap();
    socket
}

async fn until_reserved(app: &TestApp, holds: impl Fn(u64) -> bool) {
    while !holds(app.app.disk.reserved()) {
        tokio::time::sleep(std::time::Duration::from_millis(1)).await;
    }
}

async fn readiness(app: &TestApp) -> Value {
    app.get("/readyz").send().await.unwrap().json().await.unwrap()
}

#[tokio::test]
async fn an_upload_is_not_admitted_into_reserved_space() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    // a job has reserved all but 1 GiB
    let available = app.app.disk.state().await.unwrap().available();
    let job = app.app.disk.reserve(available - GIB).await.unwrap().granted().expect("it fits");
    let too_large = (8 * GIB).to_string();
    let request = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", &too_large);
    let request = request.header("upload-metadata", "rig cmln,lens bGVucw==");
    let told = problem(request.send().await.unwrap(), 507, "insufficient_storage").await;
    assert!(told["detail"].as_str().unwrap().contains(&format!("{} are reserved", job.bytes())), "{told}");
    let disk = readiness(&app).await["checks"]["disk"].clone();
    assert_eq!((&disk["ok"], disk["reserved_bytes"].as_u64()), (&true.into(), Some(job.bytes())));
    let page = app.get("/metrics").send().await.unwrap().text().await.unwrap();
    assert!(page.contains("pinstack_disk_reserved_bytes"), "{page}");
    assert_eq!(app.post(POST).body(stack_zip(2, 0)).send().await.unwrap().status(), StatusCode::ACCEPTED);
    assert_eq!(app.app.disk.reserved(), job.bytes(), "what the upload reserved went back");
}

#[tokio::test]
async fn announced_lengths_alone_do_not_exhaust_the_disk_budget() {
    let limit = 3 * GIB / 2;
    let app = TestApp::start_with(|policy| {
        policy.upload_reserve_bytes = limit;
        // the disk may be larger than the limit of uploads
        policy.max_upload_bytes = 1 << 60;
        policy.body_idle_timeout = Duration::from_secs(3600);
    })
    .await;
    app.with_profile(2).await;
    let free = app.app.disk.state().await.unwrap().free;
    let first = announced(&app, free / 2).await;
    until_reserved(&app, |reserved| reserved >= GIB - 1).await;
    let second = announced(&app, free / 4).await;
    until_reserved(&app, |reserved| reserved > GIB).await;
    let third = announced(&app, free / 4).await;
    // two resumable uploads that send nothing
    for _ in 0..2 {
        let request = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", free / 2);
        let begun = request.header("upload-metadata", "rig cmln,lens bGVucw==").send().await.unwrap();
        assert_eq!(begun.status(), StatusCode::CREATED);
    }
    assert_eq!(app.post(POST).body(stack_zip(2, 0)).send().await.unwrap().status(), StatusCode::ACCEPTED);
    assert!(app.app.disk.reserved() <= limit, "{} of {limit}", app.app.disk.reserved());
    drop((first, second, third));
    until_reserved(&app, |reserved| reserved == 0).await;
}
