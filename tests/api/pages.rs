//! The web pages: every page without and with work, names that attack, rights, and what the pages cost.

use pinstack::{
    contract::{Code, Fault, request::JobRequest},
    store::{EnqueueAll, NewJob},
};
use reqwest::{Response, StatusCode, redirect::Policy as Redirects};
use serde_json::{Value, json};
use uuid::Uuid;

use crate::app::{TestApp, id, problem, profile, stack_zip};

const HOSTILE: &str = "<script>alert(1)</script>\"'&\u{202e}x";
pub const HTML: &str = "text/html,application/xhtml+xml,*/*;q=0.8";
pub const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// A page as a browser gets it.
pub async fn page(app: &TestApp, path: &str) -> String {
    let answer = app.get(path).header("accept", HTML).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK, "{path}");
    checked(answer).await
}

/// The text of a page, whose headers and content allow nothing from outside.
pub async fn checked(answer: Response) -> String {
    let headers = answer.headers().clone();
    assert_eq!(headers["content-type"], "text/html; charset=utf-8");
    let policy = headers["content-security-policy"].to_str().unwrap();
    assert!(policy.starts_with("default-src 'none'; script-src 'self'; style-src 'self';"), "{policy}");
    assert!(policy.contains("frame-ancestors 'none'") && !policy.contains("unsafe"), "{policy}");
    assert_eq!(headers["referrer-policy"], "same-origin");
    assert!(headers["cache-control"].to_str().unwrap().contains("private"));
    let text = answer.text().await.unwrap();
    for inline in ["<script>", "<style", " style=", "onclick=", "javascript:", "http://", "https://"] {
        assert!(!text.contains(inline), "{inline} in {text}");
    }
    text
}

/// A client that follows no redirects.
pub fn still() -> reqwest::Client {
    reqwest::Client::builder().no_proxy().redirect(Redirects::none()).build().unwrap()
}

#[tokio::test]
async fn every_page_of_an_empty_store_says_what_to_do() {
    let app = TestApp::start().await;
    for (path, words) in [
        ("/stacks", "There are no stacks yet"),
        ("/stacks?state=failed", "No stack matches"),
        ("/send", "Drop a zip or a folder here"),
        ("/scans", "There are no scans yet"),
        ("/profiles", "There are no profiles yet"),
        ("/plan", "Plan a capture"),
    ] {
        let text = page(&app, path).await;
        assert!(text.contains(words), "{path}: {text}");
        assert!(text.contains("<main id=\"content\"") && text.contains("aria-label=\"Main\""), "{path}");
    }
}

#[tokio::test]
async fn a_page_that_does_not_exist_says_so_in_words() {
    let app = TestApp::start().await;
    let none = Uuid::now_v7();
    for path in [
        &format!("/stacks/{none}"),
        "/scans/nothing",
        "/profiles/rig/lens",
        "/stacks/7",
        "/stacks?state=lost",
        "/stacks?cursor=x",
    ] {
        let answer = app.get(path).header("accept", HTML).send().await.unwrap();
        assert!(answer.status().is_client_error(), "{path}");
        let text = checked(answer).await;
        assert!(text.contains("<h1>") && text.contains("Code: "), "{path}: {text}");
    }
    // programs get problem documents
    problem(app.get(&format!("/stacks/{none}")).send().await.unwrap(), 404, "not_found").await;
    problem(app.get("/v1/nothing").header("accept", HTML).send().await.unwrap(), 404, "not_found").await;
}

#[tokio::test]
async fn a_stack_is_shown_from_waiting_to_done() {
    let app = TestApp::start().await;
    let first = id(&app.with_stack("&label=beetle").await);
    let second = id(&app.with_stack("&label=wasp").await);
    let text = page(&app, "/stacks").await;
    assert!(text.contains("beetle") && text.contains("next") && text.contains("2nd in the queue"), "{text}");
    let low = id(&app.with_stack("&priority=low").await);
    assert!(page(&app, "/stacks").await.contains("low priority"));
    app.store.metadata.cancel(low).await.unwrap();
    let job = app.claim().await;
    assert_eq!(job.id, first);
    assert!(page(&app, &format!("/stacks/{first}")).await.contains("id=\"cancel\""));
    app.finish(&job).await;
    let text = page(&app, "/stacks").await;
    assert!(text.contains(&format!("/stacks/{first}/thumbnail?v=")), "{text}");
    let text = page(&app, &format!("/stacks/{first}")).await;
    assert!(
        text.contains("data-scene=") && text.contains("Sharpest slice") && !text.contains("id=\"cancel\""),
        "{text}"
    );
    let job = app.claim().await;
    app.fail(&job, Fault::new(Code::SizeMismatch, "the slices <are> too small")).await;
    let text = page(&app, &format!("/stacks/{second}")).await;
    assert!(text.contains("The slices &lt;are&gt; too small"), "{text}");
    let failed = page(&app, "/stacks?state=failed&rig=rig").await;
    assert!(failed.contains("wasp") && !failed.contains("beetle"), "{failed}");
}

#[tokio::test]
async fn names_that_attack_stay_text() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    let mut input = json!({ "rig": "rig", "lens": "lens", "specimen": HOSTILE, "note": HOSTILE });
    let put = app.put("/v1/scans/bee").json(&input).send().await.unwrap();
    assert!(put.status().is_success(), "{}", put.text().await.unwrap());
    input = profile(2);
    input["note"] = json!(HOSTILE);
    assert!(app.put("/v1/profiles/rig/lens").json(&input).send().await.unwrap().status().is_success());
    let request = app.post(POST).query(&[("label", HOSTILE), ("scan", "bee"), ("pan_deg", "0"), ("tilt_deg", "0")]);
    let stack: Value = request.body(stack_zip(2, 2)).send().await.unwrap().json().await.unwrap();
    app.finish(&app.claim().await).await;
    let stack = format!("/stacks/{}", id(&stack));
    for path in ["/", "/stacks", stack.as_str(), "/scans", "/scans/bee", "/profiles", "/profiles/rig/lens", "/send"] {
        let text = page(&app, path).await;
        assert!(!text.contains("alert(1)</script>") && !text.contains('\u{202e}'), "{path}: {text}");
    }
    assert!(page(&app, &stack).await.contains("&lt;script&gt;alert(1)"));
}

#[tokio::test]
async fn the_rows_are_sent_again_only_when_they_changed() {
    let app = TestApp::start().await;
    app.with_stack("").await;
    let rows = app.get("/stacks?part=rows").send().await.unwrap();
    let tag = rows.headers()["etag"].clone();
    assert!(rows.text().await.unwrap().starts_with("<ol class=\"rows\">"));
    let again = async || app.get("/stacks?part=rows").header("if-none-match", &tag).send().await.unwrap().status();
    assert_eq!(again().await, StatusCode::NOT_MODIFIED);
    app.claim().await;
    assert_eq!(again().await, StatusCode::OK);
}

#[tokio::test]
async fn the_views_of_a_scan_are_shown_with_gaps_and_bundles() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for (pan, tilt) in [(0, 0), (20, 0), (40, 0), (0, 10), (40, 10)] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg={tilt}")).await;
        app.finish(&app.claim().await).await;
    }
    let text = page(&app, "/scans/bee").await;
    assert!(text.contains("5 views") && text.contains("<span class=\"gap\">missing</span>"), "{text}");
    assert!(text.contains("/v1/scans/bee/bundle?layout=colmap") && text.contains("views.csv"), "{text}");
    assert!(page(&app, "/scans").await.contains("href=\"/scans/bee\""));
    let part = app.get("/scans/bee?part=views").send().await.unwrap().text().await.unwrap();
    assert!(part.starts_with("<p class=\"lead\"") && !part.contains("<html"), "{part}");
}

#[tokio::test]
async fn profiles_show_revisions_and_how_far_the_rig_moved() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let mut moved = profile(2);
    moved["homographies"][1][2] = json!(0.6);
    assert!(app.put("/v1/profiles/rig/lens").json(&moved).send().await.unwrap().status().is_success());
    let text = page(&app, "/profiles/rig/lens").await;
    assert!(text.contains("Drift over time") && text.contains("0.60 px"), "{text}");
    assert!(text.contains("/v1/profiles/rig/lens/export?revision=1"), "{text}");
    assert!(page(&app, "/profiles").await.contains("href=\"/profiles/rig/lens\""));
    let sent = app.post("/v1/profiles/rig/lens/calibrations").body(stack_zip(2, 0)).send().await.unwrap();
    let calibration: Value = sent.json().await.unwrap();
    let path = format!("/calibrations/{}", id(&calibration));
    assert!(page(&app, &path).await.contains("id=\"cancel\""));
    app.finish(&app.claim().await).await;
    let text = page(&app, &path).await;
    assert!(text.contains("Good") && !text.contains("id=\"cancel\""), "{text}");
}

#[tokio::test]
async fn the_planner_answers_or_says_what_is_wrong() {
    let app = TestApp::start().await;
    let query = "focal_mm=65&f_number=5%2C6&magnification=1&pixel_pitch_um=4.14&object_depth_mm=5&mode=fixed_lens";
    let text = page(&app, &format!("/plan?{query}&image_width=8688&image_height=5792&slice_count=")).await;
    assert!(text.contains("slices, one every") && text.contains("/v1/targets/dots?"), "{text}");
    let text = page(&app, "/plan?focal_mm=long").await;
    assert!(text.contains("role=\"alert\"") && text.contains("focal_mm"), "{text}");
}

#[tokio::test]
async fn the_first_page_is_small_and_its_files_are_kept() {
    let app = TestApp::start().await;
    app.with_stack("").await;
    app.finish(&app.claim().await).await;
    let text = page(&app, "/stacks").await;
    let mut bytes = text.len();
    let mut urls: Vec<String> = text.split('"').filter(|part| part.starts_with("/web/")).map(str::to_owned).collect();
    urls.dedup();
    // the modules that the module of the page imports lie beside it
    let folder = urls[0].rsplit_once('/').unwrap().0.to_owned();
    urls.extend(["page.js", "live.js"].map(|name| format!("{folder}/{name}")));
    assert!(urls.len() >= 5, "{urls:?}");
    for url in &urls {
        let answer = app.get(url).send().await.unwrap();
        assert_eq!(answer.headers()["cache-control"], "public, max-age=31536000, immutable", "{url}");
        let tag = answer.headers()["etag"].clone();
        bytes += answer.bytes().await.unwrap().len();
        let again = app.get(url).header("if-none-match", tag).send().await.unwrap();
        assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    }
    assert!(bytes < 100_000, "{bytes} bytes");
    // a page of an older version still works, and its files are not kept
    let other = app.get("/web/000000000000/app.css").send().await.unwrap();
    assert_eq!((other.status(), &other.headers()["cache-control"]), (StatusCode::OK, &"no-cache".parse().unwrap()));
    problem(app.get("/web/0/nothing.js").send().await.unwrap(), 404, "not_found").await;
    problem(app.get("/web/0/..%2Fmod.rs").send().await.unwrap(), 404, "not_found").await;
}

#[tokio::test]
async fn a_page_of_the_list_has_few_stacks_however_many_there_are() {
    const STACKS: usize = 10_000;
    let app = TestApp::start().await;
    app.with_stack("&label=number-0").await;
    let first = app.claim().await;
    app.finish(&first).await;
    let job = |number: usize| {
        let mut request = first.request.clone();
        if let JobRequest::Stack(stack) = &mut request {
            stack.options.label = Some(format!("number-{number}"));
        }
        let (rig, lens) = (first.rig.clone(), first.lens.clone());
        let (warnings, id) = (Vec::new(), Uuid::now_v7());
        NewJob { id, rig, lens, request, warnings, idempotency: None, owner: None, trace: None }
    };
    let jobs: Vec<NewJob> = (1..STACKS).map(job).collect();
    let seeded = app.store.metadata.enqueue_all(&jobs, 1 << 20).await.unwrap();
    assert!(matches!(seeded, EnqueueAll::Accepted(_)));
    let mut path = "/stacks?rig=rig".to_owned();
    for at in 0..3 {
        let text = page(&app, &path).await;
        assert_eq!(text.matches("<li id=\"job-").count(), 24);
        assert!(text.len() < 60_000, "{} bytes", text.len());
        assert!(text.contains(&format!("number-{}<", STACKS - 1 - 24 * at)), "{text}");
        let link = text.split("rel=\"next\"").next().unwrap();
        path = link.rsplit("href=\"").next().unwrap().split('"').next().unwrap().replace("&amp;", "&");
        assert!(path.starts_with("/stacks?rig=rig&cursor="), "{path}");
    }
    let done = page(&app, "/stacks?state=succeeded").await;
    assert_eq!(done.matches("<li id=\"job-").count(), 1);
}
