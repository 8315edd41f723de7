//! Reconstructions of scans, by a program that a test writes in place of COLMAP.

mod auto;
mod mesh;

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use pinstack::{
    contract::JobKind,
    jobs::{ScienceRunner, reconstruction::Colmap},
    worker::{Config, Deps, Pool},
};
use pinstack_science::types::intrinsics::Intrinsics;
use reqwest::StatusCode;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::app::{TestApp, problem};

/// What COLMAP does, as far as a reconstruction needs it: its model are the commanded poses of the bundle, but of the
/// last view. Every view sees one point, half a pixel beside the place at which it is projected.
const WORKS: &str = r#"
case "$1" in
help) echo "COLMAP 3.8 -- Structure-from-Motion" ;;
feature_extractor)
    n=0
    for image in images/*; do
        n=$((n + 1))
        printf 'Processed file [%s/4]\n  Name:            %s\n  Features:        %s\n' $n "${image#images/}" $((400 + n))
    done ;;
matches_importer) test -s pairs.txt && echo "Matching block [1/1]" ;;
mapper)
    mkdir -p model/0
    printf '\003\000\000\000\000\000\000\000' > model/0/images.bin
    echo "Registering image #3 (3)" ;;
model_converter)
    cp sparse/0/cameras.txt text/
    sed 's/^$/12.5 9 1/' sparse/0/images.txt | head -n 8 > text/images.txt
    echo "1 0 0 0 255 128 0 0.5 1 0 2 0 3 0" > text/points3D.txt ;;
esac
"#;

/// Writes a program.
fn program(folder: &TempDir, text: &str) -> PathBuf {
    let path = folder.path().join("colmap");
    fs::write(&path, format!("#!/bin/sh\n{text}")).expect("a script");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("a mode");
    path
}

/// The program that works, but for one command.
fn program_that(folder: &TempDir, command: &str, does: &str) -> PathBuf {
    program(folder, &format!("if [ \"$1\" = {command} ]; then\n{does}\nfi\n{WORKS}"))
}

/// A server whose scan `bee` has four views of a known camera with results.
async fn with_views() -> TestApp {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for pan in [0, 20, 40, 60] {
        view(&app, pan).await;
    }
    app
}

/// Adds a view with a result to the scan.
async fn view(app: &TestApp, pan: u32) {
    app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=0")).await;
    let job = app.claim().await;
    app.finish_stack(&job, |outcome| outcome.image.intrinsics = Some(camera())).await;
}

fn camera() -> Intrinsics {
    Intrinsics {
        principal_distance_px: 100.0,
        principal_distance_mm: 50.0,
        principal_distance_sigma_mm: Some(0.1),
        pixel_pitch_mm: 0.5,
        principal_point_px: None,
        distortion: None,
    }
}

/// Workers with this program.
fn workers(app: &TestApp, program: Option<&Path>, most_time: Duration) -> Pool {
    workers_with(app, program, Vec::new(), most_time)
}

/// Workers with this program, and a command for meshes.
fn workers_with(app: &TestApp, program: Option<&Path>, mesh_command: Vec<String>, most_time: Duration) -> Pool {
    let colmap =
        program.map(|program| Colmap { program: program.to_owned(), mesh_command, most_time, most_memory: 1 << 30 });
    let runner = ScienceRunner { threads: 1, colmap, ..ScienceRunner::default() };
    let deps = Deps { store: app.store.clone(), disk: Arc::clone(&app.app.disk), runner: Arc::new(runner) };
    let poll = Duration::from_millis(20);
    Pool::start(deps, Config { poll, beat: poll, progress_gap: poll, ..Config::default() })
}

async fn post(app: &TestApp) -> Value {
    let answer = app.post("/v1/scans/bee/reconstructions").send().await.expect("an answer");
    assert_eq!(answer.status(), StatusCode::ACCEPTED, "{}", answer.text().await.unwrap_or_default());
    let location = answer.headers()["location"].to_str().expect("a path").to_owned();
    let made: Value = answer.json().await.expect("JSON");
    assert_eq!(made["links"]["self"], location);
    made
}

/// The job when it has ended.
async fn ended(app: &TestApp, job: &Value) -> Value {
    loop {
        let request = app.get(job["links"]["self"].as_str().expect("a path")).header("prefer", "wait=20");
        let now: Value = request.send().await.expect("an answer").json().await.expect("JSON");
        if now["finished_at"].is_string() {
            return now;
        }
    }
}

/// The job when it is in a stage.
async fn in_stage(app: &TestApp, job: &Value, stage: &str) {
    let mut changes = app.store.metadata.changes();
    loop {
        let url = job["links"]["self"].as_str().expect("a path");
        let now: Value = app.get(url).send().await.expect("an answer").json().await.expect("JSON");
        assert!(now["finished_at"].is_null(), "{now}");
        if now["progress"]["stage"] == stage {
            return;
        }
        let _ = tokio::time::timeout(Duration::from_secs(1), changes.recv()).await;
    }
}

async fn text(app: &TestApp, path: &str) -> String {
    let answer = app.get(path).send().await.expect("an answer");
    assert_eq!(answer.status(), StatusCode::OK, "{path}");
    String::from_utf8_lossy(&answer.bytes().await.expect("a body")).into_owned()
}

#[tokio::test]
async fn a_scan_becomes_cameras_points_a_report_and_findings() {
    let (app, folder) = (with_views().await, tempfile::tempdir().expect("a folder"));
    let pool = workers(&app, Some(&program(&folder, WORKS)), Duration::from_secs(600));
    let made = ended(&app, &post(&app).await).await;
    assert_eq!(made["state"], "succeeded", "{made}");
    let result = &made["result"];
    assert_eq!((&result["registered"], &result["expected"], &result["points"]), (&json!(3), &json!(4), &json!(1)));
    assert_eq!((&result["program"], &result["focal_px"]), (&json!("COLMAP 3.8"), &json!(100.0)));
    assert!((result["mean_error_px"].as_f64().expect("an error") - 0.5).abs() < 1e-9, "{result}");
    let [first, .., last] = result["views"].as_array().expect("views").as_slice() else { panic!("{result}") };
    assert_eq!(
        (&first["name"], &first["features"], &first["points"]),
        (&json!("pan000_tilt00"), &json!(401), &json!(1))
    );
    assert_eq!((&last["registered"], &last["points"]), (&json!(false), &Value::Null));
    let lost = result["findings"].as_array().expect("a list").iter().find(|one| one["code"] == "not_registered");
    let lost = lost.expect("a finding");
    assert_eq!(lost["views"], json!(["pan060_tilt00"]));
    assert!(lost["detail"].as_str().expect("a sentence").contains("404 features"), "{lost}");

    let url = made["links"]["self"].as_str().expect("a path");
    let points = app.get(&format!("{url}/points")).send().await.unwrap().bytes().await.unwrap();
    let (head, body) = points.split_at(points.len() - 15);
    assert!(head.starts_with(b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n"), "{head:?}");
    assert_eq!((&body[..12], &body[12..]), ([0; 12].as_slice(), [255, 128, 0].as_slice()));
    let cameras: Value = serde_json::from_str(&text(&app, &format!("{url}/cameras")).await).unwrap();
    let camera = &cameras["cameras"][0];
    assert_eq!((&camera["width"], &camera["principal_point"]), (&json!(24), &json!([11.5, 8.5])), "{camera}");
    assert!((camera["center"][0].as_f64().unwrap() - 1.0).abs() < 1e-9, "{camera}");
    assert_eq!(camera["rotation"].as_array().map(Vec::len), Some(9));
    assert_eq!((&cameras["cameras"][3]["registered"], &cameras["cameras"][3]["center"]), (&json!(false), &Value::Null));
    assert!(text(&app, &format!("{url}/poses?format=latex")).await.contains("tabular"));
    assert!(text(&app, &format!("{url}/log")).await.contains("Processed file [4/4]"));
    assert!(text(&app, &format!("{url}/model")).await.starts_with("PK"));
    let page = text(&app, "/scans/bee?part=reconstructions").await;
    assert!(page.contains("3 of 4 views registered") && page.contains("/points"), "{page}");
    let list: Value = app.get("/v1/scans/bee/reconstructions").send().await.unwrap().json().await.unwrap();
    assert_eq!(list["items"][0]["id"], made["id"]);
    // its stacks are not deleted with it, and it is deleted with its scan
    assert_eq!(app.delete("/v1/scans/bee?stacks=delete").send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(app.get(url).send().await.unwrap(), 404, "not_found").await;
    assert!(app.jobs_with_blobs().await.is_empty());
    pool.shutdown(Duration::ZERO).await;
}

#[tokio::test]
async fn a_program_that_fails_or_exceeds_a_limit_is_named_with_what_it_said() {
    let app = with_views().await;
    let hour = Duration::from_secs(3600);
    for (command, does, most_time, says) in [
        (
            "mapper",
            "echo 'no more eggs' >&2; exit 3",
            hour,
            "mapper of COLMAP failed (exit status: 3); its last words: ",
        ),
        ("mapper", "echo 'no more eggs' >&2; exit 3", hour, "no more eggs"),
        ("matches_importer", "kill -SEGV $$", hour, "matches_importer of COLMAP failed (signal: 11"),
        ("feature_extractor", "head -c 200000000 /dev/zero > big; exec sleep 1000", hour, "wrote more than the"),
        (
            "model_converter",
            "echo '1 PINHOLE' > text/cameras.txt; exit 0",
            hour,
            "cannot be read: cameras.txt has the line",
        ),
        (
            "feature_extractor",
            "exec sleep 1000",
            Duration::from_millis(300),
            "raise the setting reconstruction_minutes",
        ),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let pool = workers(&app, Some(&program_that(&folder, command, does)), most_time);
        let failed = ended(&app, &post(&app).await).await;
        assert_eq!((&failed["state"], &failed["error"]["code"]), (&json!("failed"), &json!("reconstruction_failed")));
        let detail = failed["error"]["detail"].as_str().expect("a sentence");
        assert!(detail.contains(says), "{detail}");
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(app.spooled(), 0, "nothing is left of {does}");
    }
}

#[tokio::test]
async fn no_views_that_fit_together_are_a_result_with_a_log() {
    let (app, folder) = (with_views().await, tempfile::tempdir().expect("a folder"));
    let does = "echo '  => No good initial image pair found.'; exit 1";
    let pool = workers(&app, Some(&program_that(&folder, "mapper", does)), Duration::from_secs(600));
    let made = ended(&app, &post(&app).await).await;
    assert_eq!((&made["state"], &made["result"]["registered"]), (&json!("succeeded"), &json!(0)), "{made}");
    assert_eq!(made["result"]["findings"][0]["code"], "no_model");
    let url = made["links"]["self"].as_str().expect("a path");
    problem(app.get(&format!("{url}/points")).send().await.unwrap(), 404, "no_result").await;
    assert!(text(&app, &format!("{url}/log")).await.contains("No good initial image pair"));
    assert!(made["links"].get("points").is_none() && made["links"]["log"].is_string(), "{made}");
    pool.shutdown(Duration::ZERO).await;
}

#[tokio::test]
async fn a_cancelled_reconstruction_ends_the_program_and_its_children() {
    let app = with_views().await;
    for (command, stage) in
        [("feature_extractor", "extracting features"), ("matches_importer", "matching"), ("mapper", "mapping")]
    {
        let folder = tempfile::tempdir().expect("a folder");
        let child = folder.path().join("child");
        let does = format!("sleep 1000 & echo $! > {}; wait", child.display());
        let pool = workers(&app, Some(&program_that(&folder, command, &does)), Duration::from_secs(600));
        let job = post(&app).await;
        in_stage(&app, &job, stage).await;
        let number = loop {
            match fs::read_to_string(&child) {
                Ok(text) if text.ends_with('\n') => break text.trim().to_owned(),
                _ => tokio::task::yield_now().await,
            }
        };
        let cancelled = app.post(job["links"]["cancel"].as_str().expect("a path")).send().await.unwrap();
        assert_eq!(cancelled.status(), StatusCode::ACCEPTED);
        assert_eq!(ended(&app, &job).await["state"], "cancelled");
        // a killed process may still wait for its parent to take note of it
        let status = fs::read_to_string(format!("/proc/{number}/stat")).unwrap_or_default();
        assert!(status.is_empty() || status.contains(") Z "), "the child lives: {status}");
        pool.shutdown(Duration::from_secs(10)).await;
        assert_eq!(app.spooled(), 0);
    }
}

#[tokio::test]
async fn without_colmap_reconstructions_wait_or_are_refused_with_what_to_install() {
    let app = with_views().await;
    let job = post(&app).await;
    assert!(
        app.store.metadata.claim(Duration::from_secs(9), 3, Some(JobKind::Reconstruction)).await.unwrap().is_none()
    );
    let pool = workers(&app, None, Duration::from_secs(600));
    // a later job passes it
    let stack = app.with_stack("").await;
    assert!(ended(&app, &stack).await["finished_at"].is_string());
    let url = job["links"]["self"].as_str().expect("a path");
    let waiting: Value = app.get(url).send().await.unwrap().json().await.unwrap();
    assert_eq!((&waiting["state"], &waiting["attempt"]), (&json!("queued"), &json!(0)));
    pool.shutdown(Duration::ZERO).await;
    let without = TestApp::start_with(|policy| policy.reconstructs = false).await;
    without.with_scan("bee").await;
    let refused = without.post("/v1/scans/bee/reconstructions").send().await.unwrap();
    let refused = problem(refused, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("apt-get install colmap"), "{refused}");
    assert!(text(&without, "/scans/bee").await.contains("apt-get install colmap"));
}

#[tokio::test]
async fn a_request_is_repeated_by_its_key_and_wrong_ones_are_refused() {
    let app = with_views().await;
    let ask =
        |body: Value| app.post("/v1/scans/bee/reconstructions").header("idempotency-key", "one").json(&body).send();
    let first: Value = ask(json!({})).await.unwrap().json().await.unwrap();
    let again = ask(json!({})).await.unwrap();
    assert_eq!(again.headers()["idempotency-replayed"], "true");
    assert_eq!(again.json::<Value>().await.unwrap()["id"], first["id"]);
    problem(ask(json!({ "max_error_px": 4 })).await.unwrap(), 422, "idempotency_key_reused").await;
    problem(ask(json!({ "max_error_px": 99 })).await.unwrap(), 400, "invalid_request").await;
    problem(ask(json!({ "limit": 1 })).await.unwrap(), 400, "invalid_request").await;
    app.with_stack("&scan=bee&pan_deg=80&tilt_deg=0").await;
    let late = app.post("/v1/scans/bee/reconstructions").send().await.unwrap();
    problem(late, 409, "not_finished").await;
    let partial = app.post("/v1/scans/bee/reconstructions").json(&json!({ "partial": true })).send().await.unwrap();
    assert_eq!(partial.status(), StatusCode::ACCEPTED);
    let elsewhere = app.post("/v1/scans/wasp/reconstructions").send().await.unwrap();
    problem(elsewhere, 404, "scan_not_found").await;
}

#[tokio::test]
async fn a_stack_that_is_deleted_meanwhile_is_named() {
    let (app, folder) = (with_views().await, tempfile::tempdir().expect("a folder"));
    let job = post(&app).await;
    let scan: Value = app.get("/v1/scans/bee").send().await.unwrap().json().await.unwrap();
    let stack = scan["views"][2]["stack"].as_str().expect("a stack");
    assert!(app.delete(stack).send().await.unwrap().status().is_success());
    let pool = workers(&app, Some(&program(&folder, WORKS)), Duration::from_secs(600));
    let failed = ended(&app, &job).await;
    assert_eq!(failed["error"]["code"], "upload_removed", "{failed}");
    assert!(failed["error"]["detail"].as_str().unwrap().contains("images/pan040_tilt00.png"), "{failed}");
    pool.shutdown(Duration::ZERO).await;
}
