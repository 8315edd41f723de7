//! Bundles for reconstruction programs.

use std::io::{Cursor, Read};

use reqwest::StatusCode;
use serde_json::json;

use super::finish_all;
use crate::app::{TestApp, problem};

async fn ready() -> TestApp {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for pan in [0, 20] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=6")).await;
    }
    finish_all(&app, 2).await;
    app
}

fn member(zip: &[u8], name: &str) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(Cursor::new(zip)).expect("a zip");
    let names: Vec<String> = archive.file_names().map(|name| name.expect("UTF-8").into_owned()).collect();
    let mut bytes = Vec::new();
    let mut file = archive.by_name(name).unwrap_or_else(|_| panic!("no {name} in {names:?}"));
    file.read_to_end(&mut bytes).expect("with the right CRC");
    bytes
}

#[tokio::test]
async fn a_bundle_holds_the_stored_images_and_masks_and_can_be_resumed() {
    let app = ready().await;
    let get = || app.get("/v1/scans/bee/bundle?layout=colmap");
    let answer = get().send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let tag = answer.headers()["etag"].clone();
    assert_eq!(answer.headers()["content-disposition"], "inline; filename=\"bee_colmap.zip\"");
    let length: usize = answer.headers()["content-length"].to_str().unwrap().parse().unwrap();
    let whole = answer.bytes().await.unwrap();
    assert_eq!(whole.len(), length);
    let image = app.get("/v1/scans/bee").send().await.unwrap().json::<serde_json::Value>().await.unwrap();
    let stack = image["views"][1]["stack"].as_str().unwrap();
    let stored = app.get(&format!("{stack}/image")).send().await.unwrap().bytes().await.unwrap();
    assert_eq!(member(&whole, "images/pan020_tilt06.png"), stored);
    let mask = app.get(&format!("{stack}/mask")).send().await.unwrap().bytes().await.unwrap();
    assert_eq!(member(&whole, "masks/pan020_tilt06.png.png"), mask);
    assert!(!member(&whole, "README.txt").is_empty());

    let from = length / 3;
    let rest = get().header("range", format!("bytes={from}-")).header("if-range", tag.clone()).send().await.unwrap();
    assert_eq!(rest.status(), StatusCode::PARTIAL_CONTENT);
    assert_eq!(rest.bytes().await.unwrap(), whole[from..]);
    let same = get().header("if-none-match", tag.clone()).send().await.unwrap();
    assert_eq!(same.status(), StatusCode::NOT_MODIFIED);
    problem(get().header("range", format!("bytes={length}-")).send().await.unwrap(), 416, "range_not_satisfiable")
        .await;
    let other = app.get("/v1/scans/bee/bundle?layout=meshroom").send().await.unwrap();
    assert_ne!(other.headers()["etag"], tag);
}

#[tokio::test]
async fn every_layout_has_a_bundle() {
    let app = ready().await;
    for layout in ["meshroom", "colmap", "metashape", "realitycapture", "odm", "openmvg", "nerfstudio"] {
        let answer = app.get(&format!("/v1/scans/bee/bundle?layout={layout}")).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK, "{layout}");
        let whole = answer.bytes().await.unwrap();
        let readme = String::from_utf8(member(&whole, "README.txt")).unwrap();
        assert!(readme.contains("bee"), "{layout}: {readme}");
    }
    problem(app.get("/v1/scans/bee/bundle").send().await.unwrap(), 400, "invalid_request").await;
    problem(app.get("/v1/scans/bee/bundle?layout=blender").send().await.unwrap(), 400, "invalid_request").await;
    problem(app.get("/v1/scans/bea/bundle?layout=colmap").send().await.unwrap(), 404, "scan_not_found").await;
}

#[tokio::test]
async fn an_unfinished_scan_has_a_bundle_only_in_part() {
    let app = ready().await;
    app.with_stack("&scan=bee&pan_deg=40&tilt_deg=6").await;
    let get = |query: &str| app.get(&format!("/v1/scans/bee/bundle?layout=colmap{query}")).send();
    let refused = problem(get("").await.unwrap(), 409, "not_finished").await;
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("2 of 3 views") && detail.contains("pan040_tilt06"), "{detail}");
    let part = get("&partial=true").await.unwrap().bytes().await.unwrap();
    let archive = zip::ZipArchive::new(Cursor::new(&part)).unwrap();
    assert_eq!(archive.file_names().flatten().filter(|name| name.starts_with("images/")).count(), 2);
    let empty = TestApp::start().await;
    empty.with_scan("bee").await;
    let none = empty.get("/v1/scans/bee/bundle?layout=colmap").send().await.unwrap();
    problem(none, 404, "not_found").await;
}

#[tokio::test]
async fn views_of_another_profile_revision_are_named() {
    let app = ready().await;
    let mut profile = crate::app::profile(2);
    profile["homographies"][1][2] = json!(0.5);
    assert!(app.put("/v1/profiles/rig/lens").json(&profile).send().await.unwrap().status().is_success());
    let zip = crate::app::stack_zip(2, 2);
    let send = app.post("/v1/stacks?rig=rig&lens=lens&scan=bee&pan_deg=40&tilt_deg=6").body(zip).send();
    assert_eq!(send.await.unwrap().status(), StatusCode::ACCEPTED);
    finish_all(&app, 1).await;
    let refused = app.get("/v1/scans/bee/bundle?layout=colmap").send().await.unwrap();
    let refused = problem(refused, 422, "scan_mismatch").await;
    assert!(refused["detail"].as_str().unwrap().starts_with("pan040_tilt06"), "{refused}");
}
