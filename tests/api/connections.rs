//! Connections: limited, and not held for ever by clients that say nothing. Pages of other origins.

use std::time::Duration;

use futures::FutureExt;
use reqwest::{Method, StatusCode};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};

use crate::app::TestApp;

async fn connected(app: &TestApp) -> TcpStream {
    TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap()
}

/// Asks for health on a connection and leaves it open.
async fn ask(socket: &mut TcpStream) {
    socket.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\n\r\n").await.unwrap();
    let mut told = Vec::new();
    while !told.ends_with(b"}") {
        told.push(socket.read_u8().await.unwrap());
    }
    assert!(told.starts_with(b"HTTP/1.1 200"));
}

#[tokio::test]
async fn a_client_that_sends_its_head_byte_by_byte_is_hung_up_on() {
    let app = TestApp::start_with(|policy| policy.header_timeout = Duration::from_millis(50)).await;
    let mut socket = connected(&app).await;
    socket.write_all(b"GET /healthz HTTP/1.1\r\nhost: x\r\nx-slow: ").await.unwrap();
    let mut told = Vec::new();
    // the end of the connection; a server that waits would never get here
    socket.read_to_end(&mut told).await.unwrap_or_default();
    assert!(!told.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&told));
    // and one that asked once and then nothing more
    let mut socket = connected(&app).await;
    ask(&mut socket).await;
    assert_eq!(socket.read_to_end(&mut Vec::new()).await.unwrap_or_default(), 0);
}

#[tokio::test]
async fn a_connection_over_the_limit_waits_for_one_to_end() {
    let app = TestApp::start_with(|policy| policy.max_connections = 2).await;
    let (mut first, mut second) = (connected(&app).await, connected(&app).await);
    ask(&mut first).await;
    ask(&mut second).await;
    let mut third = connected(&app).await;
    let mut waiting = Box::pin(ask(&mut third));
    for _ in 0..20 {
        // the others are answered as before, the third is not
        ask(&mut first).await;
        ask(&mut second).await;
        assert!((&mut waiting).now_or_never().is_none());
    }
    drop(first);
    waiting.await;
}

#[tokio::test]
async fn requests_in_progress_end_before_the_server_does() {
    let app = TestApp::start().await;
    let mut idle = connected(&app).await;
    ask(&mut idle).await;
    app.app.shutdown.cancel();
    assert_eq!(idle.read_to_end(&mut Vec::new()).await.unwrap(), 0, "nothing is asked on it, so it ends at once");
}

#[tokio::test]
async fn pages_of_other_origins_are_answered_only_where_so_configured() {
    let preflight = |app: &TestApp, origin: &str| {
        let request = app.client.request(Method::OPTIONS, format!("{}/v1/uploads", app.base)).header("origin", origin);
        let request = request.header("access-control-request-method", "POST");
        request.header("access-control-request-headers", "authorization, tus-resumable").send()
    };
    let closed = TestApp::start().await;
    let answer = preflight(&closed, "https://lab.example").await.unwrap();
    assert!(!answer.headers().contains_key("access-control-allow-origin"));

    let open = TestApp::start_with(|policy| {
        policy.auth_required = true;
        policy.cors_origins = vec!["https://lab.example".into()];
    })
    .await;
    let answer = preflight(&open, "https://lab.example").await.unwrap();
    assert_eq!(answer.status(), StatusCode::NO_CONTENT);
    assert_eq!(answer.headers()["access-control-allow-origin"], "https://lab.example");
    assert_eq!(answer.headers()["access-control-allow-headers"], "authorization, tus-resumable");
    assert!(!answer.headers().contains_key("access-control-allow-credentials"));
    for origin in ["https://evil.example", "https://lab.example.evil.example", "null"] {
        let answer = preflight(&open, origin).await.unwrap();
        assert!(!answer.headers().contains_key("access-control-allow-origin"), "{origin}");
        assert_eq!(answer.headers()["vary"], "origin");
    }
    // an error is an answer too: the page shall see why
    let refused = open.get("/v1/stacks").header("origin", "https://lab.example").send().await.unwrap();
    assert_eq!(refused.status(), StatusCode::UNAUTHORIZED);
    assert_eq!(refused.headers()["access-control-allow-origin"], "https://lab.example");
    assert!(refused.headers()["access-control-expose-headers"].to_str().unwrap().contains("upload-offset"));
    // what tus asks is still answered
    let told = open.client.request(Method::OPTIONS, format!("{}/v1/uploads", open.base)).send().await.unwrap();
    assert_eq!(told.headers()["tus-version"], "1.0.0");
}
