//! The service below a sub-path, as a proxy publishes it that removes the sub-path from the URLs: nothing in an answer
//! leads out of it.

use std::collections::BTreeSet;

use pinstack::{
    contract::{Code, Fault},
    store::tokens::Scope,
};
use reqwest::{Method, RequestBuilder, Response, StatusCode};
use serde_json::{Value, json};

use crate::{
    access::token,
    app::{self, HEIGHT, TestApp, WIDTH, id, png, profile, stack_zip},
    pages::{HTML, still},
    uploads::client::{PIECE, of_rig},
};

const PREFIX: &str = "/lab-1/pinstack";

/// A request through the proxy.
fn through(app: &TestApp, method: Method, url: &str) -> RequestBuilder {
    let path = url.strip_prefix(PREFIX).unwrap_or_else(|| panic!("{url} is outside of the service"));
    still().request(method, format!("{}{path}", app.base)).header("x-forwarded-prefix", PREFIX).header("accept", HTML)
}

async fn document(app: &TestApp, path: &str) -> Value {
    through(app, Method::GET, &format!("{PREFIX}{path}")).send().await.unwrap().json().await.unwrap()
}

fn header<'a>(answer: &'a Response, name: &str) -> &'a str {
    answer.headers()[name].to_str().unwrap()
}

/// The paths in the attributes of a page, also those in JSON; and whether each is one that a browser gets.
fn links_of_page(page: &str) -> Vec<(String, bool)> {
    let mut found = Vec::new();
    for (marker, end) in [("=\"", "\""), ("&quot;", "&quot;")] {
        for (at, _) in page.match_indices(marker) {
            let value = page[at + marker.len()..].split(end).next().unwrap();
            let is_got = page[..at].ends_with("href") || page[..at].ends_with("src");
            if value.starts_with('/') {
                found.push((value.replace("&amp;", "&"), is_got));
            }
        }
    }
    found
}

/// Every text in a document that is a path.
fn links_of_document(value: &Value, found: &mut Vec<(String, bool)>) {
    match value {
        Value::String(text) if text.starts_with('/') => found.push((text.clone(), true)),
        Value::Array(items) => items.iter().for_each(|item| links_of_document(item, found)),
        Value::Object(members) => members.values().for_each(|item| links_of_document(item, found)),
        _ => {}
    }
}

/// Stacks that succeeded, failed and wait, one of them a rerun, a scan, a calibration, and an open upload.
async fn furnished() -> TestApp {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let stack = id(&app.with_stack("&scan=bee&pan_deg=10&tilt_deg=5").await);
    app.finish(&app.claim().await).await;
    let rerun = app.post(&format!("/v1/stacks/{stack}/rerun")).json(&json!({ "r1": 9 })).send().await.unwrap();
    assert_eq!(rerun.status(), StatusCode::ACCEPTED);
    app.fail(&app.claim().await, Fault::new(Code::InvalidImage, "the picture is torn")).await;
    let target = app.post("/v1/profiles/rig/lens/calibrations").body(stack_zip(2, 0)).send().await.unwrap();
    assert_eq!(target.status(), StatusCode::ACCEPTED);
    app.finish(&app.claim().await).await;
    app.with_stack("&scan=bee&pan_deg=20&tilt_deg=5").await;
    app
}

#[tokio::test]
async fn no_page_and_no_document_leads_out_of_the_sub_path() {
    let app = furnished().await;
    let starts = ["/", "/v1/stacks", "/v1/calibrations", "/v1/scans", "/v1/profiles", "/v1/uploads", "/docs"];
    let mut open: Vec<String> = starts.map(|path| format!("{PREFIX}{path}")).into();
    let mut seen = BTreeSet::new();
    while let Some(url) = open.pop() {
        let url = url.split('#').next().unwrap().to_owned();
        // the stream of a job that waits does not end
        if url.ends_with("/events") || !seen.insert(url.clone()) {
            continue;
        }
        let answer = through(&app, Method::GET, &url).send().await.unwrap();
        let status = answer.status();
        assert!(status != StatusCode::NOT_FOUND && !status.is_server_error(), "{url}: {status}");
        let location = answer.headers().get("location").map(|to| (to.to_str().unwrap().to_owned(), true));
        let kind = answer.headers().get("content-type").map_or("", |kind| kind.to_str().unwrap()).to_owned();
        let mut links: Vec<_> = location.into_iter().collect();
        match kind.split(';').next().unwrap() {
            "text/html" => links.extend(links_of_page(&answer.text().await.unwrap())),
            // it describes paths below its server
            "application/json" if url.ends_with("/openapi.json") => {
                let document: Value = answer.json().await.unwrap();
                assert_eq!(document["servers"][0]["url"], format!("{PREFIX}/"));
            }
            "application/json" | "application/problem+json" => {
                links_of_document(&answer.json().await.unwrap(), &mut links);
            }
            _ => {}
        }
        for (link, is_got) in links {
            assert!(link.starts_with(&format!("{PREFIX}/")), "{url} leads to {link}");
            if is_got {
                open.push(link);
            }
        }
    }
    for (part, at_least) in [("/web/", 5), ("/guide/", 20), ("/stacks/", 2), ("/v1/stacks/", 10), ("/problems/", 1)] {
        let count = seen.iter().filter(|url| url.starts_with(&format!("{PREFIX}{part}"))).count();
        assert!(count >= at_least, "{part} has {count} of {seen:#?}");
    }
}

#[tokio::test]
async fn what_is_made_below_a_sub_path_is_found_below_it() {
    let app = TestApp::start().await;
    let rig = json!({ "rig": "rig", "lens": "lens" }).to_string().into_bytes();
    let (json, zip, slices) = ("application/json", "application/zip", stack_zip(2, 2));
    let member = |view: &str, i: usize| (format!("{view}/front/img_{i}.png"), png(WIDTH, HEIGHT, 3, i));
    let views = ["bee/pan000_tilt15", "bee/pan020_tilt15"];
    let views = app::zip(&views.map(|view| [member(view, 0), member(view, 1)]).concat());
    for (method, path, kind, body, made) in [
        (Method::PUT, "/v1/profiles/rig/lens", json, profile(2).to_string().into_bytes(), "/v1/profiles/rig/lens"),
        (Method::PUT, "/v1/scans/bee", json, rig, "/v1/scans/bee"),
        (Method::POST, "/v1/scans/bee/archive", zip, views, "/v1/scans/bee"),
        (Method::POST, "/v1/stacks?rig=rig&lens=lens", zip, slices.clone(), "/v1/stacks/"),
        (Method::POST, "/v1/profiles/rig/lens/calibrations", zip, slices, "/v1/calibrations/"),
        (Method::POST, "/v1/uploads", PIECE, Vec::new(), "/v1/uploads/"),
    ] {
        let request = through(&app, method, &format!("{PREFIX}{path}")).header("tus-resumable", "1.0.0");
        let request = request.header("upload-length", "1000").header("upload-metadata", of_rig());
        let answer = request.header("content-type", kind).body(body).send().await.unwrap();
        let location = answer.headers().get("location").cloned();
        assert!(answer.status().is_success(), "{path}: {}", answer.text().await.unwrap());
        let location = location.unwrap_or_else(|| panic!("{path} has no Location"));
        assert!(location.to_str().unwrap().starts_with(&format!("{PREFIX}{made}")), "{path}: {location:?}");
    }
}

#[tokio::test]
async fn events_problems_and_the_document_of_the_api_know_the_sub_path() {
    let app = TestApp::start().await;
    let stack = id(&app.with_stack("").await);
    let job = app.claim().await;
    app.finish(&job).await;
    let events = through(&app, Method::GET, &format!("{PREFIX}/v1/stacks/{stack}/events")).send().await.unwrap();
    let text = events.text().await.unwrap();
    assert!(text.contains(&format!("\"self\":\"{PREFIX}/v1/stacks/{stack}\"")), "{text}");
    let problem = document(&app, "/v1/stacks/none").await;
    assert_eq!(
        (&problem["type"], &problem["instance"]),
        (&json!(format!("{PREFIX}/problems/not_found")), &json!(format!("{PREFIX}/v1/stacks/none")))
    );
    let tag = async |request: RequestBuilder| request.send().await.unwrap().headers()["etag"].clone();
    let below = tag(through(&app, Method::GET, &format!("{PREFIX}/openapi.json"))).await;
    assert_ne!(below, tag(app.get("/openapi.json")).await);
    let again = through(&app, Method::GET, &format!("{PREFIX}/openapi.json")).header("if-none-match", below);
    assert_eq!(again.send().await.unwrap().status(), StatusCode::NOT_MODIFIED);
    let script = through(&app, Method::GET, &format!("{PREFIX}/docs/swagger-initializer.js")).send().await.unwrap();
    let script = script.text().await.unwrap();
    assert!(script.contains("\"../openapi.json\""), "{script}");
}

#[tokio::test]
async fn a_person_signs_in_below_the_sub_path_and_other_services_do_not_get_the_token() {
    let app = TestApp::start_with(|policy| policy.auth_required = true).await;
    let secret = token(&app, "technician", &[Scope::Read]).await;
    let url = |path: &str| format!("{PREFIX}{path}");
    let asked = through(&app, Method::GET, &url("/scans?rig=a")).send().await.unwrap();
    assert_eq!(header(&asked, "location"), url("/sign-in?next=%2Fscans%3Frig%3Da"));
    let form = |proto: &str| {
        let request = through(&app, Method::POST, &url("/sign-in")).header("origin", app.base.clone());
        request.header("x-forwarded-proto", proto).body(format!("token={secret}&next=%2Fscans%3Frig%3Da"))
    };
    let plain = form("http").send().await.unwrap();
    assert_eq!(header(&plain, "location"), url("/scans?rig=a"));
    let rules = format!("Path={PREFIX}; HttpOnly; SameSite=Strict");
    assert_eq!(header(&plain, "set-cookie"), format!("pinstack_token={secret}; {rules}"));
    let secure = form("https").send().await.unwrap();
    assert_eq!(header(&secure, "set-cookie"), format!("__Secure-pinstack_token={secret}; {rules}; Secure"));
    // a service at the root of the same host has a cookie of its own
    for (cookie, status) in [
        (format!("__Host-pinstack_token=x; __Secure-pinstack_token={secret}"), StatusCode::OK),
        (format!("pinstack_token={secret}; pinstack_token=x"), StatusCode::OK),
        (format!("__Host-pinstack_token={secret}"), StatusCode::UNAUTHORIZED),
    ] {
        let asked = through(&app, Method::GET, &url("/v1/stacks")).header("cookie", &cookie).send().await.unwrap();
        assert_eq!(asked.status(), status, "{cookie}");
    }
}

#[tokio::test]
async fn only_a_trusted_proxy_says_where_the_service_is_and_it_names_a_path() {
    let links = async |app: &TestApp, prefix: &str| {
        let list = app.get("/v1/scans/bee").header("x-forwarded-prefix", prefix).send().await.unwrap();
        list.json::<Value>().await.unwrap()["links"]["self"].clone()
    };
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    for prefix in ["/a", "/a/", "/a/b-1_2.3~4", "/v1"] {
        assert_eq!(links(&app, prefix).await, format!("{}/v1/scans/bee", prefix.trim_end_matches('/')));
    }
    for prefix in ["", "/", "a", "//evil.example", "/a//b", "/..", "/a/./b", "/a b", "/a\"", "/%2e%2e", "/a,/b", "/<b>"]
    {
        assert_eq!(links(&app, prefix).await, "/v1/scans/bee", "{prefix}");
    }
    let app = TestApp::start_with(|policy| policy.trusted_proxies = Vec::new()).await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    assert_eq!(links(&app, "/a").await, "/v1/scans/bee");
}
