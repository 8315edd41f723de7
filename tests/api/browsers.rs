//! Requests that web pages can make a browser send: none of them has an effect while the service requires no token.

use std::time::Duration;

use reqwest::{Method, StatusCode};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};

use pinstack::store::tokens::Scope;

use crate::{
    access::token,
    app::{TestApp, problem, profile, stack_zip},
};

const PROFILE: &str = "/v1/profiles/rig/lens";
const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// Sends bytes on a new connection and returns the whole response.
async fn raw(app: &TestApp, request: &str) -> String {
    let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    socket.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    socket.read_to_string(&mut answer).await.unwrap();
    answer
}

#[tokio::test]
async fn a_request_for_an_unknown_host_is_refused() {
    let app = TestApp::start_with(|policy| policy.hosts = vec!["lab-pc.example".into()]).await;
    app.with_profile(2).await;
    for (method, path) in [
        (Method::GET, "/v1/profiles"),
        (Method::GET, "/docs/"),
        (Method::GET, "/healthz"),
        (Method::DELETE, PROFILE),
        (Method::OPTIONS, "/v1/uploads"),
    ] {
        let request = app.client.request(method, format!("{}{path}", app.base)).header("host", "evil.example:8080");
        problem(request.send().await.unwrap(), 421, "misdirected_request").await;
    }
    for host in ["localhost", "localhost:99", "127.0.0.1", "[::1]:8080", "lab-pc.example", "LAB-PC.example:443"] {
        let answer = app.get("/v1/profiles").header("host", host).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK, "{host}");
    }
    // an absolute request target overrides the header
    let told =
        raw(&app, "GET http://evil.example/v1/profiles HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n");
    assert!(told.await.starts_with("HTTP/1.1 421"));
    // a page has no token, so any host name is harmless
    let guarded = TestApp::start_with(|policy| policy.auth_required = true).await;
    let answer = guarded.get("/v1/profiles").header("host", "lab.example").send().await.unwrap();
    problem(answer, 401, "unauthorized").await;
}

/// Pages of other sites have no token. A server need not be restarted after the first one was made.
#[tokio::test]
async fn once_there_is_a_token_any_host_name_is_accepted() {
    let app = TestApp::start_with(|policy| policy.auth_once_there_are_tokens = true).await;
    let request = || app.get("/v1/profiles").header("host", "lab.example");
    problem(request().send().await.unwrap(), 421, "misdirected_request").await;
    let admin = token(&app, "admin", &[Scope::Admin]).await;
    problem(request().send().await.unwrap(), 401, "unauthorized").await;
    assert_eq!(request().bearer_auth(admin).send().await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn a_request_must_name_exactly_one_host() {
    for auth_required in [false, true] {
        let app = TestApp::start_with(|policy| policy.auth_required = auth_required).await;
        for hosts in
            ["", "host: localhost\r\nhost: localhost\r\n", "host: a b\r\n", "host: me@localhost\r\n", "host:\r\n"]
        {
            let told = raw(&app, &format!("GET /healthz HTTP/1.1\r\n{hosts}connection: close\r\n\r\n")).await;
            assert!(told.starts_with("HTTP/1.1 400"), "{hosts:?}: {told}");
            assert!(told.contains("\"code\":\"invalid_request\"") && told.contains("Host header"), "{told}");
        }
        // HTTP/1.0 has no Host header
        assert!(raw(&app, "GET /healthz HTTP/1.0\r\n\r\n").await.starts_with("HTTP/1.0 200"));
    }
}

#[tokio::test]
async fn writes_from_pages_of_other_origins_are_refused() {
    let app = TestApp::start_with(|policy| policy.cors_origins = vec!["https://lab.example".into()]).await;
    app.with_profile(2).await;
    let foreign = [
        &[("origin", "https://evil.example")][..],
        &[("origin", "null")],
        &[("origin", "http://127.0.0.1:1")],
        &[("sec-fetch-site", "cross-site")],
        &[("sec-fetch-site", "same-site")],
        &[("origin", "https://evil.example"), ("sec-fetch-site", "cross-site")],
    ];
    for headers in foreign {
        for (method, path) in [(Method::PUT, PROFILE), (Method::POST, POST), (Method::DELETE, PROFILE)] {
            let mut request = app.client.request(method, format!("{}{path}", app.base));
            for (name, value) in headers {
                request = request.header(*name, *value);
            }
            problem(request.body(vec![0; 1000]).send().await.unwrap(), 403, "cross_origin_request").await;
        }
    }
    // the page may be one of the service, behind a proxy that changed `Host`; a browser says that the others are not
    for (headers, names_the_proxy) in [
        (&[("origin", "http://lab.example:8080")][..], true),
        (&[("origin", "http://lab.example:8080"), ("sec-fetch-site", "same-origin")], true),
        (&[("origin", "http://lab.example:8080"), ("sec-fetch-site", "cross-site")], false),
        (&[("origin", "null")], false),
        (&[("sec-fetch-site", "cross-site")], false),
    ] {
        let request = headers.iter().fold(app.delete(PROFILE), |request, (name, value)| request.header(*name, *value));
        let told = problem(request.send().await.unwrap(), 403, "cross_origin_request").await;
        let detail = told["detail"].as_str().unwrap();
        let host = app.base.trim_start_matches("http://");
        let names = detail.contains(&format!("a proxy has changed the header Host to '{host}'"));
        assert_eq!((names, detail.contains("proxy_set_header Host $http_host")), (names_the_proxy, names_the_proxy));
        assert!(detail.contains("'cors_origins'"), "{detail}");
    }
    // the own page ("try it out"), an allowed origin, and a program that sends no origin
    let own = app.base.clone();
    let good = [
        &[("origin", own.as_str()), ("sec-fetch-site", "same-origin")][..],
        &[("origin", "https://lab.example"), ("sec-fetch-site", "cross-site")],
        &[("sec-fetch-site", "none")],
        &[],
    ];
    for headers in good {
        let mut request = app.put(PROFILE).json(&profile(2));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        assert_eq!(request.send().await.unwrap().status(), StatusCode::OK, "{headers:?}");
    }
    // the browser itself prevents pages from reading the response
    let read = app.get(PROFILE).header("origin", "https://evil.example").send().await.unwrap();
    assert_eq!(read.status(), StatusCode::OK);
    assert!(!read.headers().contains_key("access-control-allow-origin"));
    assert_eq!(read.headers()["cross-origin-resource-policy"], "same-origin");
}

#[tokio::test]
async fn bodies_that_need_no_preflight_are_accepted_neither_as_json_nor_as_a_zip() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let json = serde_json::to_vec(&profile(2)).unwrap();
    let import = format!("{PROFILE}/import");
    let parameters = format!("{PROFILE}/rig-parameters");
    for kind in ["application/x-www-form-urlencoded", "text/plain", "multipart/form-data; boundary=x"] {
        for request in [app.put(PROFILE), app.post(&import), app.post(&parameters)] {
            let refused = request.header("content-type", kind).body(json.clone()).send().await.unwrap();
            let told = problem(refused, 415, "unsupported_media_type").await;
            assert!(told["detail"].as_str().unwrap().contains("application/json"), "{told}");
        }
    }
    for kind in ["application/x-www-form-urlencoded", "text/plain; charset=utf-8"] {
        for path in [POST, "/v1/profiles/rig/lens/calibrations"] {
            let refused = app.post(path).header("content-type", kind).body(stack_zip(2, 0)).send().await.unwrap();
            let told = problem(refused, 415, "unsupported_media_type").await;
            let detail = told["detail"].as_str().unwrap();
            assert!(detail.contains("application/zip"), "{told}");
            assert_eq!(detail.contains("-T"), kind.contains("urlencoded"), "curl's users hear what to do: {told}");
        }
    }
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 0);
}

#[tokio::test]
async fn a_json_body_that_stalls_times_out() {
    let app = TestApp::start_with(|policy| policy.body_idle_timeout = Duration::from_millis(50)).await;
    for (method, path) in [
        ("PUT", PROFILE.to_owned()),
        ("POST", format!("{PROFILE}/import")),
        ("POST", format!("{PROFILE}/rig-parameters")),
    ] {
        let told = raw(
            &app,
            &format!(
                "{method} {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-type: application/json\r\n\
                 content-length: 1000\r\n\r\n{{"
            ),
        )
        .await;
        assert!(told.starts_with("HTTP/1.1 400") && told.contains("upload_incomplete"), "{told}");
    }
}

#[tokio::test]
async fn a_url_has_a_limited_number_of_parameters() {
    let app = TestApp::start().await;
    let query = |count: usize| (0..count).map(|i| format!("p{i}=1")).collect::<Vec<_>>().join("&");
    let told =
        problem(app.get(&format!("/v1/stacks?{}", query(65))).send().await.unwrap(), 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("more than 64"), "{told}");
    let told =
        problem(app.get(&format!("/v1/stacks?{}", query(64))).send().await.unwrap(), 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("unknown parameter 'p0'"), "{told}");
}
