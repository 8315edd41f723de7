//! Limits and timeouts of connections; cross-origin requests.

use std::{process::Command, time::Duration};

use futures::FutureExt;
use reqwest::{Method, StatusCode};
use rustix::process::Signal;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpSocket, TcpStream},
};

use pinstack::{
    contract::Name,
    store::tokens::{NewToken, Scope, mint},
};

use crate::{
    app::{TestApp, id, problem},
    process::{Process, pinstack as program},
};

async fn connected(app: &TestApp) -> TcpStream {
    TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap()
}

/// Sends a request and leaves the connection open. Returns the status and the body.
async fn ask_for(socket: &mut TcpStream, path: &str) -> (u16, String) {
    socket.write_all(format!("GET {path} HTTP/1.1\r\nhost: localhost\r\n\r\n").as_bytes()).await.unwrap();
    let head = head(socket).await;
    let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")).expect("a length");
    let mut body = vec![0; length.parse().unwrap()];
    socket.read_exact(&mut body).await.unwrap();
    (head[9..12].parse().unwrap(), String::from_utf8(body).unwrap())
}

/// The head of a response.
async fn head(socket: &mut TcpStream) -> String {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        head.push(socket.read_u8().await.expect("an answer"));
    }
    String::from_utf8(head).unwrap().to_lowercase()
}

/// Sends a request that needs a slot.
async fn ask(socket: &mut TcpStream) {
    assert_eq!(ask_for(socket, "/v1/info").await.0, 200);
}

/// Requests a large response and reads only its beginning.
async fn ask_and_do_not_read(app_base: &str) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.set_recv_buffer_size(4096).unwrap();
    let mut socket = socket.connect(app_base.trim_start_matches("http://").parse().unwrap()).await.unwrap();
    let request = "GET /docs/swagger-ui-bundle.js HTTP/1.1\r\nhost: localhost\r\n\r\n".repeat(8);
    socket.write_all(request.as_bytes()).await.unwrap();
    assert!(head(&mut socket).await.starts_with("http/1.1 200"));
    socket
}

#[tokio::test]
async fn a_client_that_sends_its_head_byte_by_byte_is_disconnected() {
    let app = TestApp::start_with(|policy| policy.header_timeout = Duration::from_millis(50)).await;
    let mut socket = connected(&app).await;
    socket.write_all(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nx-slow: ").await.unwrap();
    let mut told = Vec::new();
    // the end of the connection; a server that waits would never get here
    socket.read_to_end(&mut told).await.unwrap_or_default();
    assert!(!told.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&told));
    // and a connection that is idle after one request
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
        // the first two are answered, the third is not
        ask(&mut first).await;
        ask(&mut second).await;
        assert!((&mut waiting).now_or_never().is_none());
    }
    drop(first);
    waiting.await;
}

#[tokio::test]
async fn health_is_answered_while_all_slots_are_taken() {
    let app = TestApp::start_with(|policy| policy.max_connections = 1).await;
    let mut first = connected(&app).await;
    ask(&mut first).await;
    // more connections than the reserve holds, without requests
    let mut silent = Vec::new();
    for _ in 0..100 {
        silent.push(connected(&app).await);
        let mut check = connected(&app).await;
        assert_eq!(ask_for(&mut check, "/healthz").await.0, 200);
        assert_eq!(ask_for(&mut check, "/readyz").await.0, 200);
    }
    // the oldest of them was closed
    assert_eq!(silent[0].read_to_end(&mut Vec::new()).await.unwrap_or_default(), 0);
    ask(&mut first).await;
}

#[tokio::test]
async fn a_client_without_a_slot_in_time_gets_the_reason() {
    let app = TestApp::start_with(|policy| {
        policy.max_connections = 1;
        policy.header_timeout = Duration::from_millis(100);
    })
    .await;
    let stack = app.with_stack("").await;
    let request = format!("GET /v1/stacks/{}/events HTTP/1.1\r\nhost: localhost\r\n\r\n", id(&stack));
    // once the connections before have ended, an event stream holds the only slot
    let _stream = loop {
        let mut socket = connected(&app).await;
        socket.write_all(request.as_bytes()).await.unwrap();
        if head(&mut socket).await.starts_with("http/1.1 200") {
            break socket;
        }
    };
    let mut late = connected(&app).await;
    let (status, body) = ask_for(&mut late, "/v1/info").await;
    assert_eq!(status, 503, "{body}");
    assert!(body.contains("\"code\":\"unavailable\"") && body.contains("connections"), "{body}");
    assert_eq!(late.read_to_end(&mut Vec::new()).await.unwrap_or_default(), 0, "it is hung up on");
    // a client that sends first, and reads then
    let mut sender = connected(&app).await;
    let told = send_then_read(&mut sender, "POST").await;
    assert!(told.starts_with("http/1.1 503") && told.contains("connection: close"), "{told}");
}

/// Sends a body that fits into no buffer of a socket, and reads the head of the answer when all of it is sent.
async fn send_then_read(socket: &mut TcpStream, method: &str) -> String {
    const BODY: usize = 32 << 20;
    let request = format!("{method} /v1/stacks HTTP/1.1\r\nhost: localhost\r\ncontent-length: {BODY}\r\n\r\n");
    socket.write_all(request.as_bytes()).await.unwrap();
    socket.write_all(&vec![0; BODY]).await.expect("the body is read to its end");
    head(socket).await
}

#[tokio::test]
async fn a_client_that_sends_a_body_with_an_unknown_method_gets_the_reason() {
    let app = TestApp::start().await;
    let told = send_then_read(&mut connected(&app).await, "BREW").await;
    assert!(told.starts_with("http/1.1 501"), "{told}");
}

#[tokio::test]
async fn one_address_has_a_share_of_the_connections() {
    let app = TestApp::start_with(|policy| {
        policy.max_connections = 8;
        policy.trusted_proxies = Vec::new();
    })
    .await;
    let (mut first, mut second, mut third) = (connected(&app).await, connected(&app).await, connected(&app).await);
    ask(&mut first).await;
    ask(&mut second).await;
    let mut waiting = Box::pin(ask(&mut third));
    let other = TcpSocket::new_v4().unwrap();
    other.bind("127.0.0.2:0".parse().unwrap()).unwrap();
    let mut other = other.connect(app.base.trim_start_matches("http://").parse().unwrap()).await.unwrap();
    for _ in 0..20 {
        // other addresses are not affected
        ask(&mut other).await;
        assert!((&mut waiting).now_or_never().is_none());
    }
    drop(first);
    waiting.await;

    // behind a proxy many clients have one address
    let behind = TestApp::start_with(|policy| policy.max_connections = 8).await;
    let mut all = Vec::new();
    for _ in 0..8 {
        let mut socket = connected(&behind).await;
        ask(&mut socket).await;
        all.push(socket);
    }
}

#[tokio::test]
async fn one_token_has_a_share_of_the_requests_in_progress() {
    let app = TestApp::start_with(|policy| policy.connections_per_client = Some(2)).await;
    let stack = app.with_stack("").await;
    let guarded = app.asking_for_tokens().await;
    let mut tokens = Vec::new();
    for name in ["ann", "ben"] {
        let (id, secret, text) = mint().unwrap();
        let scopes = vec![Scope::Read];
        let new = NewToken { id, name: Name::new(name).unwrap(), digest: secret.digest(), scopes, quota_bytes: None };
        assert!(app.store.metadata.add_token(&new).await.unwrap());
        tokens.push(text);
    }
    let events = format!("{guarded}/v1/stacks/{}/events", id(&stack));
    let watch = |token: &str| app.client.get(&events).bearer_auth(token).send();
    let (first, _second) = (watch(&tokens[0]).await.unwrap(), watch(&tokens[0]).await.unwrap());
    assert_eq!(first.status(), StatusCode::OK);
    let refused = watch(&tokens[0]).await.unwrap();
    assert!(refused.headers().contains_key("retry-after"));
    let told = problem(refused, 429, "too_many_requests").await;
    assert!(told["detail"].as_str().unwrap().contains("'ann' has 2 requests"), "{told}");
    assert_eq!(watch(&tokens[1]).await.unwrap().status(), StatusCode::OK, "another token is not kept out");
    drop(first);
    while watch(&tokens[0]).await.unwrap().status() != StatusCode::OK {}
}

#[tokio::test]
async fn a_client_that_does_not_read_is_disconnected() {
    let app = TestApp::start_with(|policy| {
        policy.max_connections = 1;
        policy.body_idle_timeout = Duration::from_millis(50);
    })
    .await;
    let _lazy = ask_and_do_not_read(&app.base).await;
    // the only slot becomes free
    ask(&mut connected(&app).await).await;
}

#[tokio::test]
async fn a_second_signal_ends_the_server_at_once() {
    let mut process = Process::start(&[]).await;
    let _lazy = ask_and_do_not_read(&process.base).await;
    process.signal(Signal::TERM);
    process.logged(&["shutting down"]).await;
    process.signal(Signal::TERM);
    assert_eq!(process.ended().await.code(), Some(143));
}

#[tokio::test]
async fn the_limit_of_open_files_is_raised_and_connections_fit_into_it() {
    let limited = |limits: &str| {
        let folder = tempfile::tempdir().unwrap();
        let server = program(&["serve"], &folder.path().join("data"));
        let mut shell = Command::new("sh");
        shell
            .arg("-c")
            .arg(format!("{limits} && exec \"$@\""))
            .arg("sh")
            .arg(server.get_program())
            .args(server.get_args());
        Process::of(shell, folder)
    };
    let process = limited("ulimit -Sn 200 && ulimit -Hn 1000").await;
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", process.id())).unwrap();
    let open = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    assert_eq!(open.split_whitespace().nth(3), Some("1000"), "{open}");
    process.logged(&["WARN", "max_connections is lowered", "fit=372"]).await;
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
async fn pages_of_other_origins_need_a_configured_origin() {
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
    // an error is a response too: the page must be able to read it
    let refused = open.get("/v1/stacks").header("origin", "https://lab.example").send().await.unwrap();
    assert_eq!(refused.status(), StatusCode::UNAUTHORIZED);
    assert_eq!(refused.headers()["access-control-allow-origin"], "https://lab.example");
    assert!(refused.headers()["access-control-expose-headers"].to_str().unwrap().contains("upload-offset"));
    // OPTIONS of tus is still answered
    let told = open.client.request(Method::OPTIONS, format!("{}/v1/uploads", open.base)).send().await.unwrap();
    assert_eq!(told.headers()["tus-version"], "1.0.0");
}

#[tokio::test]
async fn much_of_a_refused_body_is_read_behind_a_trusted_proxy_alone() {
    // MiB that are taken, of 128
    let taken = async |is_trusted: bool| {
        let app = TestApp::start_with(|policy| policy.trusted_proxies.retain(|_| is_trusted)).await;
        let mut socket = connected(&app).await;
        let head = "GUESS /v1/info HTTP/1.1\r\nhost: localhost\r\nx-forwarded-for: 10.1.2.3\r\ncontent-length: 1000000000\r\n\r\n";
        socket.write_all(head.as_bytes()).await.unwrap();
        let (chunk, mut taken) = (vec![0; 1 << 20], 0);
        while taken < 128 && socket.write_all(&chunk).await.is_ok() {
            taken += 1;
        }
        taken
    };
    assert_eq!(taken(true).await, 128);
    let untrusted = taken(false).await;
    assert!(untrusted < 100, "{untrusted} MiB");
}
