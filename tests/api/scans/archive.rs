//! One zip with all views of a scan.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::{names, scan};
use crate::app::{HEIGHT, TestApp, WIDTH, png, problem, stack_zip, zip};

/// The members of a scan: a folder per view, each with `slices` slices per light.
fn members(views: &[&str], slices: usize) -> Vec<(String, Vec<u8>)> {
    let of_view = |view: &str| {
        let view = view.to_owned();
        ["front", "back"].into_iter().flat_map(move |light| {
            let view = view.clone();
            (0..slices).map(move |at| (format!("scan/{view}/{light}/img_{at}.png"), png(WIDTH, HEIGHT, 3, at)))
        })
    };
    views.iter().flat_map(|view| of_view(view)).collect()
}

const VIEWS: [&str; 3] = ["pan000_tilt00", "pan020_tilt00", "pan040_tilt00"];

async fn ready() -> TestApp {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    app
}

#[tokio::test]
async fn one_zip_becomes_a_stack_per_view() {
    let app = ready().await;
    let mut all = members(&VIEWS, 2);
    all.push(("scan/notes.txt".into(), b"x".to_vec()));
    let body = zip(&all);
    let dry = app.post("/v1/scans/bee/archive?dry_run=true").body(body.clone()).send().await.unwrap();
    assert_eq!(dry.status(), StatusCode::OK);
    let dry: Value = dry.json().await.unwrap();
    assert_eq!(dry["views"].as_array().unwrap().len(), 3);
    assert_eq!(
        (&dry["views"][1]["pan_deg"], &dry["views"][1]["front"], &dry["views"][1]["stack"]),
        (&json!(20.0), &json!(2), &Value::Null)
    );
    assert!(dry["ignored"].as_array().unwrap().iter().any(|file| file["name"] == "scan/notes.txt"), "{dry}");
    assert_eq!(scan(&app, "bee").await["summary"]["views"], 0, "nothing is made");

    let made = app.put("/v1/scans/bee/archive?rig=rig&lens=lens&r1=30").body(body).send().await.unwrap();
    assert_eq!((made.status(), made.headers()["location"].to_str().unwrap()), (StatusCode::ACCEPTED, "/v1/scans/bee"));
    let made: Value = made.json().await.unwrap();
    let table = scan(&app, "bee").await;
    assert_eq!(names(&table["views"]), VIEWS);
    for (view, row) in made["views"].as_array().unwrap().iter().zip(table["views"].as_array().unwrap()) {
        assert_eq!(view["stack"], row["stack"]);
        let stack: Value = app.get(view["stack"].as_str().unwrap()).send().await.unwrap().json().await.unwrap();
        assert_eq!((&stack["options"]["r1"], &stack["options"]["scan"]), (&json!(30), &json!("bee")));
        assert_eq!(stack["slices"]["front"].as_array().unwrap().len(), 2);
        assert_eq!(stack["slices"]["back"].as_array().unwrap().len(), 2);
    }
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn a_refused_view_is_named_and_no_stack_is_made() {
    let app = ready().await;
    let mut all = members(&VIEWS[..2], 2);
    all.extend(members(&VIEWS[2..], 3));
    let refused = app.post("/v1/scans/bee/archive").body(zip(&all)).send().await.unwrap();
    let refused = problem(refused, 422, "slice_count_mismatch").await;
    assert!(refused["detail"].as_str().unwrap().contains("1 of 3 views"), "{refused}");
    assert!(refused["errors"][0]["file"].as_str().unwrap().contains("pan040_tilt00"), "{refused}");
    let mut torn = members(&VIEWS, 2);
    torn[5].1 = b"no picture".to_vec();
    let refused = app.post("/v1/scans/bee/archive").body(zip(&torn)).send().await.unwrap();
    problem(refused, 422, "invalid_image").await;
    assert_eq!(scan(&app, "bee").await["summary"]["views"], 0);
    assert!(app.jobs_with_blobs().await.is_empty());
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn a_view_of_another_size_is_named_and_no_stack_is_made() {
    let app = ready().await;
    let mut all = members(&VIEWS, 2);
    for (name, bytes) in all.iter_mut().filter(|(name, _)| name.contains("pan020")) {
        *bytes = png(WIDTH + 2, HEIGHT, 3, name.len());
    }
    let refused = app.post("/v1/scans/bee/archive").body(zip(&all)).send().await.unwrap();
    let refused = problem(refused, 422, "size_mismatch").await;
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.starts_with("1 of 3 views cannot be fused, so none was accepted"), "{detail}");
    assert!(detail.contains("26 x 18") && detail.contains("24 x 18"), "both sizes: {detail}");
    assert_eq!(refused["errors"].as_array().unwrap().len(), 1);
    assert!(refused["errors"][0]["file"].as_str().unwrap().contains("pan020_tilt00"), "{refused}");
    assert_eq!(scan(&app, "bee").await["summary"]["views"], 0);
}

#[tokio::test]
async fn two_views_at_the_same_angles_are_refused_by_name() {
    let app = ready().await;
    for (one, other) in [("pan020_tilt00", "pan020.0_tilt0"), ("head_pan020_tilt00", "tail_pan020_tilt00")] {
        let body = zip(&members(&[VIEWS[0], one, other], 2));
        for query in ["", "?dry_run=true"] {
            let refused = app.post(&format!("/v1/scans/bee/archive{query}")).body(body.clone()).send().await.unwrap();
            let refused = problem(refused, 422, "invalid_archive").await;
            let detail = refused["detail"].as_str().unwrap();
            assert!(detail.contains(one) && detail.contains(other), "{detail}");
            assert!(
                detail.contains("have the same angles") && detail.ends_with("remove one, or correct its angles"),
                "{detail}"
            );
        }
    }
    // the same by a manifest
    let mut all = members(&VIEWS[..2], 2);
    let slices = |view: &str| json!([format!("scan/{view}/front/img_0.png"), format!("scan/{view}/front/img_1.png")]);
    let views = VIEWS[..2]
        .iter()
        .zip(["head", "tail"])
        .map(|(view, label)| json!({ "label": label, "pan_deg": 20, "tilt_deg": 0, "front": slices(view) }));
    all.push(("manifest.json".into(), json!({ "views": views.collect::<Vec<_>>() }).to_string().into_bytes()));
    let refused = app.post("/v1/scans/bee/archive").body(zip(&all)).send().await.unwrap();
    let refused = problem(refused, 422, "invalid_archive").await;
    assert!(refused["detail"].as_str().unwrap().starts_with("head and tail have the same angles"), "{refused}");
    assert!(app.jobs_with_blobs().await.is_empty());
}

#[tokio::test]
async fn what_is_wrong_with_the_request_is_told_before_the_upload() {
    let app = ready().await;
    for (query, status, code) in [
        ("bea/archive", 404, "scan_not_found"),
        ("bee/archive?lens=other", 422, "scan_mismatch"),
        ("bee/archive?label=x", 400, "invalid_request"),
        ("bee/archive?x=pan&y=pan", 400, "invalid_request"),
        ("bee/archive?x_zero=inf", 400, "invalid_request"),
        ("bee/archive?r1=0", 400, "invalid_request"),
        ("bee/archive?profile_revision=9", 404, "profile_not_found"),
    ] {
        // the body would never end
        let endless = reqwest::Body::wrap_stream(futures::stream::pending::<Result<Vec<u8>, std::io::Error>>());
        let answer = app.post(&format!("/v1/scans/{query}")).body(endless).send().await.unwrap();
        problem(answer, status, code).await;
    }
}

#[tokio::test]
async fn a_repeated_request_gets_the_stacks_of_the_first() {
    let app = ready().await;
    let body = zip(&members(&VIEWS, 2));
    let send = || {
        let request = app.post("/v1/scans/bee/archive").header("idempotency-key", "k");
        request.body(body.clone()).send()
    };
    let first: Value = send().await.unwrap().json().await.unwrap();
    let again = send().await.unwrap();
    assert_eq!(again.headers()["idempotency-replayed"], "true");
    assert_eq!((again.status(), again.json::<Value>().await.unwrap()), (StatusCode::ACCEPTED, first.clone()));
    assert_eq!(scan(&app, "bee").await["summary"]["views"], 3);
    let other = app.post("/v1/scans/bee/archive?r1=9").header("idempotency-key", "k").body(body.clone());
    problem(other.send().await.unwrap(), 422, "idempotency_key_reused").await;
    let stack = first["views"][0]["stack"].as_str().unwrap();
    app.delete(stack).send().await.unwrap();
    problem(send().await.unwrap(), 409, "conflict").await;
}

#[tokio::test]
async fn a_repeat_after_a_calibration_gets_the_stacks_of_the_first() {
    let app = ready().await;
    let body = zip(&members(&VIEWS, 2));
    let send = |query: &str| {
        let request = app.post(&format!("/v1/scans/bee/archive{query}")).header("idempotency-key", "k");
        request.body(body.clone()).send()
    };
    let first: Value = send("").await.unwrap().json().await.unwrap();
    app.with_profile(2).await;
    let again = send("").await.unwrap();
    assert_eq!(
        (again.status(), &again.headers()["idempotency-replayed"]),
        (StatusCode::ACCEPTED, &"true".parse().unwrap())
    );
    assert_eq!(again.json::<Value>().await.unwrap(), first);
    for revision in [1, 2] {
        let other = send(&format!("?profile_revision={revision}")).await.unwrap();
        problem(other, 422, "idempotency_key_reused").await;
    }
    assert_eq!(scan(&app, "bee").await["summary"]["views"], 3);
    let stack: Value =
        app.get(first["views"][2]["stack"].as_str().unwrap()).send().await.unwrap().json().await.unwrap();
    assert_eq!(stack["profile_revision"], 1);
}

#[tokio::test]
async fn a_scan_that_does_not_fit_into_the_queue_makes_no_stack() {
    // three views, and two or three places: to wait does not help in the first case
    for (limit, waiting, status, code) in [(2, 0, 422, "archive_too_large"), (3, 1, 503, "queue_full")] {
        let app = TestApp::start_with(|policy| policy.queue_limit = limit).await;
        app.with_profile(2).await;
        app.with_scan("bee").await;
        for _ in 0..waiting {
            app.with_stack("").await;
        }
        let refused = app.post("/v1/scans/bee/archive").body(zip(&members(&VIEWS, 2))).send().await.unwrap();
        assert_eq!(refused.headers().contains_key("retry-after"), status == 503);
        problem(refused, status, code).await;
        assert_eq!(app.jobs_with_blobs().await.len(), waiting);
    }
}

#[tokio::test]
async fn a_scan_is_uploaded_in_pieces() {
    let app = ready().await;
    let body = zip(&members(&VIEWS, 2));
    let coded = |text: &str| base64::Engine::encode(&base64::prelude::BASE64_STANDARD, text);
    let metadata = format!("purpose {},scan {},options {}", coded("scan"), coded("bee"), coded("{\"r1\": 30}"));
    let begin = |metadata: &str| {
        let request = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-metadata", metadata);
        request.header("upload-length", body.len()).send()
    };
    let nowhere = format!("purpose {},scan {}", coded("scan"), coded("bea"));
    problem(begin(&nowhere).await.unwrap(), 404, "scan_not_found").await;
    problem(begin(&format!("purpose {}", coded("scan"))).await.unwrap(), 400, "invalid_request").await;
    let created = begin(&metadata).await.unwrap();
    assert_eq!(created.status(), StatusCode::CREATED);
    let location = created.headers()["location"].to_str().unwrap().to_owned();
    let half = body.len() / 2;
    let mut last = None;
    for (offset, piece) in [(0, &body[..half]), (half, &body[half..])] {
        let patch = app.client.patch(format!("{}{location}", app.base)).header("tus-resumable", "1.0.0");
        let patch = patch.header("upload-offset", offset).header("content-type", "application/offset+octet-stream");
        last = Some(patch.body(piece.to_vec()).send().await.unwrap());
    }
    let last = last.expect("two pieces");
    assert_eq!(
        (last.status(), &last.headers()["pinstack-job"]),
        (StatusCode::NO_CONTENT, &"/v1/scans/bee".parse().unwrap())
    );
    let shown: Value = app.get(&location).send().await.unwrap().json().await.unwrap();
    assert_eq!(
        (&shown["state"], &shown["purpose"], &shown["job"]),
        (&json!("complete"), &json!("scan"), &json!("/v1/scans/bee"))
    );
    let table = scan(&app, "bee").await;
    assert_eq!(names(&table["views"]), VIEWS);
    let stack: Value =
        app.get(table["views"][0]["stack"].as_str().unwrap()).send().await.unwrap().json().await.unwrap();
    assert_eq!(stack["options"]["r1"], 30);
    assert_eq!(app.jobs_with_blobs().await.len(), 3);
}

/// Garbage collection may take zips that are stored very slowly for leftovers, unless their upload has a row.
#[tokio::test]
async fn what_is_stored_too_slowly_is_refused_unless_it_is_a_resumable_upload() {
    let app = TestApp::start_with(|policy| policy.most_storing = std::time::Duration::ZERO).await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    let body = zip(&members(&VIEWS, 2));
    for (url, body) in [("/v1/scans/bee/archive", &body), ("/v1/stacks?rig=rig&lens=lens", &stack_zip(2, 0))] {
        let refused = problem(app.post(url).body(body.clone()).send().await.unwrap(), 413, "upload_too_large").await;
        assert!(refused["detail"].as_str().unwrap().contains("resumable upload"), "{refused}");
        assert!(app.jobs_with_blobs().await.is_empty(), "nothing is left behind");
    }
    let coded = |text: &str| base64::Engine::encode(&base64::prelude::BASE64_STANDARD, text);
    let request = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", body.len());
    let request = request.header("content-type", "application/offset+octet-stream");
    let scan = format!("purpose {},scan {}", coded("scan"), coded("bee"));
    let made = request.header("upload-metadata", scan).body(body).send().await.unwrap();
    assert_eq!(made.status(), StatusCode::CREATED);
    assert_eq!(app.jobs_with_blobs().await.len(), 3);
}

#[tokio::test]
async fn the_rules_for_names_travel_with_a_resumable_upload() {
    let app = ready().await;
    let members: Vec<(String, Vec<u8>)> = ["00000", "00100"]
        .into_iter()
        .flat_map(|steps| (0..2).map(move |at| (format!("_x_{steps}_y_00000_step_{at:05}_.png"), at)))
        .map(|(name, at)| (name, png(WIDTH, HEIGHT, 3, at)))
        .collect();
    let body = zip(&members);
    let coded = |text: &str| base64::Engine::encode(&base64::prelude::BASE64_STANDARD, text);
    let begin = |rules: &str| {
        let scan = format!("purpose {},scan {}", coded("scan"), coded("bee"));
        let request = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", body.len());
        let request = request.header("content-type", "application/offset+octet-stream").body(body.clone());
        request.header("upload-metadata", format!("{scan},{rules}")).send()
    };
    problem(begin(&format!("x_zero {}", coded("inf"))).await.unwrap(), 400, "invalid_request").await;
    let rules = [("x", "pan"), ("x_degrees_per_unit", "0.2"), ("y_degrees_per_unit", "0.1")];
    let rules = rules.map(|(name, value)| format!("{name} {}", coded(value))).join(",");
    let created = begin(&rules).await.unwrap();
    assert_eq!(created.status(), StatusCode::CREATED, "{:?}", created.text().await);
    assert_eq!(names(&scan(&app, "bee").await["views"]), ["pan000_tilt00", "pan020_tilt00"]);
}
