//! Scans: the table of views, one zip with all views, reruns, bundles.

mod archive;
mod bundle;
mod cameras;
mod groupings;
mod misspelt;
mod outliers;
mod owners;

use reqwest::{Response, StatusCode};
use serde_json::{Value, json};

use crate::app::{TestApp, id, problem, stack_zip};

async fn scan(app: &TestApp, name: &str) -> Value {
    app.get(&format!("/v1/scans/{name}")).send().await.unwrap().json().await.unwrap()
}

async fn put(app: &TestApp, name: &str, body: Value) -> Response {
    app.put(&format!("/v1/scans/{name}")).json(&body).send().await.unwrap()
}

fn names(list: &Value) -> Vec<&str> {
    list.as_array().expect("a list").iter().map(|one| one["name"].as_str().expect("a name")).collect()
}

/// Finishes every queued stack.
async fn finish_all(app: &TestApp, stacks: usize) {
    for _ in 0..stacks {
        let job = app.claim().await;
        app.finish(&job).await;
    }
}

#[tokio::test]
async fn a_scan_is_created_read_changed_and_deleted() {
    let app = TestApp::start().await;
    let body =
        json!({ "rig": "rig", "lens": "lens", "expected_views": 2, "taxon": "Apis", "metadata": { "sex": "f" } });
    let created = put(&app, "bee", body.clone()).await;
    assert_eq!(created.status(), StatusCode::CREATED);
    assert_eq!(
        (&created.headers()["location"], &created.headers()["etag"]),
        (&"/v1/scans/bee".parse().unwrap(), &"\"1\"".parse().unwrap())
    );
    let shown = scan(&app, "bee").await;
    assert_eq!(
        (&shown["taxon"], &shown["metadata"]["sex"], &shown["version"]),
        (&json!("Apis"), &json!("f"), &json!(1))
    );
    assert_eq!((&shown["summary"]["expected"], &shown["summary"]["views"]), (&json!(2), &json!(0)));
    // what GET returns can be sent back
    let changed = app.put("/v1/scans/bee").header("if-match", "\"1\"").json(&shown).send().await.unwrap();
    assert_eq!(changed.status(), StatusCode::OK);
    let lost = app.put("/v1/scans/bee").header("if-match", "\"1\"").json(&shown).send().await.unwrap();
    problem(lost, 412, "precondition_failed").await;
    let list: Value = app.get("/v1/scans?lens=lens").send().await.unwrap().json().await.unwrap();
    assert_eq!(names(&list["items"]), ["bee"]);
    assert_eq!(app.delete("/v1/scans/bee").send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(app.get("/v1/scans/bee").send().await.unwrap(), 404, "scan_not_found").await;
    for (wrong, pointer) in [
        (json!({ "rig": "rig", "lens": "lens", "expected_views": 0 }), "/expected_views"),
        (json!({ "rig": "rig", "lens": "lens", "radius_mm": -1 }), "/radius_mm"),
        (json!({ "rig": "a b", "lens": "lens" }), "/rig"),
    ] {
        let refused = problem(put(&app, "bee", wrong).await, 400, "invalid_request").await;
        assert_eq!(refused["errors"][0]["pointer"], pointer, "{refused}");
    }
}

#[tokio::test]
async fn a_misspelt_scan_and_another_camera_are_noticed_before_the_upload() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee-42").await;
    let post = |query: &str| app.post(&format!("/v1/stacks?rig=rig&lens=lens{query}")).body(stack_zip(2, 2)).send();
    let missing = problem(post("&scan=bee42").await.unwrap(), 404, "scan_not_found").await;
    assert!(missing["detail"].as_str().unwrap().contains("there is 'bee-42'"), "{missing}");
    let other = json!({ "rig": "rig", "lens": "other" });
    assert!(put(&app, "wasp", other).await.status().is_success());
    problem(post("&scan=wasp").await.unwrap(), 422, "scan_mismatch").await;
    assert_eq!(app.jobs_with_blobs().await.len(), 0);
}

#[tokio::test]
async fn the_table_shows_views_by_angle_and_the_newest_stack_that_did_not_fail() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let first = app.with_stack("&scan=bee&pan_deg=20&tilt_deg=6").await;
    app.with_stack("&scan=bee&pan_deg=0&tilt_deg=6").await;
    app.with_stack("&scan=bee&label=head").await;
    finish_all(&app, 3).await;
    let again = app.with_stack("&scan=bee&pan_deg=20&tilt_deg=6").await;
    let table = scan(&app, "bee").await;
    assert_eq!(names(&table["views"]), ["pan000_tilt06", "pan020_tilt06", "head"]);
    let view = &table["views"][1];
    assert_eq!(view["stack"], format!("/v1/stacks/{}", id(&again)));
    assert_eq!((&view["state"], &view["replaced"]), (&json!("queued"), &json!([format!("/v1/stacks/{}", id(&first))])));
    assert_eq!((&table["summary"]["succeeded"], &table["summary"]["replaced"]), (&json!(2), &json!(1)));
    let job = app.claim().await;
    app.fail(&job, pinstack::contract::Fault::new(pinstack::contract::Code::InvalidImage, "torn")).await;
    let table = scan(&app, "bee").await;
    let view = &table["views"][1];
    assert_eq!(view["stack"], format!("/v1/stacks/{}", id(&first)), "a failed repetition hides no result");
    assert_eq!(view["image_size_px"], json!([24, 18]));

    let csv = app.get("/v1/scans/bee/views.csv").send().await.unwrap();
    assert_eq!(csv.headers()["content-type"], "text/csv; charset=utf-8");
    let text = csv.text().await.unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 4);
    assert!(lines[0].starts_with("name,label,pan_deg,tilt_deg,stack,state,verdict,"), "{text}");
    assert!(lines[1].starts_with("pan000_tilt06,,0,6,/v1/stacks/"), "{text}");
    let verdict = table["views"][0]["verdict"].as_str().expect("it has succeeded");
    assert!(lines[1].contains(&format!(",succeeded,{verdict},")), "{text}");
}

#[tokio::test]
async fn a_scan_with_stacks_is_deleted_only_with_them() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    app.with_stack("&scan=bee&pan_deg=0&tilt_deg=0").await;
    let refused = problem(app.delete("/v1/scans/bee").send().await.unwrap(), 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("stacks=delete"), "{refused}");
    let moved = json!({ "rig": "rig", "lens": "other" });
    problem(put(&app, "bee", moved).await, 409, "conflict").await;
    let deleted = app.delete("/v1/scans/bee?stacks=delete").send().await.unwrap();
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    let stacks: Value = app.get("/v1/stacks").send().await.unwrap().json().await.unwrap();
    assert_eq!(stacks["items"], json!([]));
    assert!(app.jobs_with_blobs().await.is_empty());
}

#[tokio::test]
async fn a_rerun_fuses_every_view_again_under_the_same_name() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    app.with_stack("&scan=bee&pan_deg=0&tilt_deg=0").await;
    app.with_stack("&scan=bee").await;
    finish_all(&app, 2).await;
    let before = scan(&app, "bee").await;
    let rerun = |body: Value| app.post("/v1/scans/bee/rerun").json(&body).send();
    problem(rerun(json!({ "label": "x" })).await.unwrap(), 400, "invalid_request").await;
    problem(rerun(json!({ "r1": 0 })).await.unwrap(), 400, "invalid_request").await;
    let answer = rerun(json!({ "r1": 30 })).await.unwrap();
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    let made: Value = answer.json().await.unwrap();
    assert_eq!((names(&made["views"]), &made["skipped"]), (names(&before["views"]), &json!([])));
    let after = scan(&app, "bee").await;
    assert_eq!(names(&after["views"]), names(&before["views"]));
    for (view, old) in after["views"].as_array().unwrap().iter().zip(before["views"].as_array().unwrap()) {
        assert_eq!((&view["state"], &view["replaced"][0]), (&json!("queued"), &old["stack"]));
        let stack: Value = app.get(view["stack"].as_str().unwrap()).send().await.unwrap().json().await.unwrap();
        assert_eq!((&stack["options"]["r1"], &stack["options"]["scan"]), (&json!(30), &json!("bee")));
    }
    let empty = TestApp::start().await;
    empty.with_scan("bee").await;
    problem(empty.post("/v1/scans/bee/rerun").send().await.unwrap(), 404, "not_found").await;
}

#[tokio::test]
async fn a_rerun_that_does_not_fit_into_the_queue_makes_no_stack() {
    // three views, and two or three places: to wait does not help in the first case
    for (limit, waiting, status, code) in [(2, 0, 409, "conflict"), (3, 1, 503, "queue_full")] {
        let app = TestApp::start_with(|policy| policy.queue_limit = limit).await;
        app.with_scan("bee").await;
        for pan in 0..3 {
            app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=0")).await;
            finish_all(&app, 1).await;
        }
        for _ in 0..waiting {
            app.with_stack("").await;
        }
        let refused = app.post("/v1/scans/bee/rerun").json(&json!({})).send().await.unwrap();
        assert_eq!(refused.headers().contains_key("retry-after"), status == 503);
        problem(refused, status, code).await;
        assert_eq!(scan(&app, "bee").await["summary"]["replaced"], 0);
        assert_eq!(app.jobs_with_blobs().await.len(), 3 + waiting, "no blob is left behind");
        assert_eq!(app.spooled(), 0);
    }
}
