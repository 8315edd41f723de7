//! Calibrations from stacks that are stored: a JSON body names the stacks, or a scan.

use std::{sync::Arc, time::Duration};

use pinstack::{
    jobs::ScienceRunner,
    store::{Retention, gc::collect, tokens::Scope},
    worker::{Config, Deps, Pool},
};
use pinstack_science::{
    imaging::codec,
    synth::{Light, Rig, Scene, Stage},
};
use reqwest::{Response, StatusCode};
use serde_json::{Value, json};
use uuid::Uuid;

use crate::{
    access::token,
    app::{HEIGHT, TestApp, WIDTH, id, png, problem, profile, stack_zip, zip},
};

const POST: &str = "/v1/profiles/rig/lens/calibrations?source=stacks";
const STACK: &str = "/v1/stacks?rig=rig&lens=lens";

async fn calibrate(app: &TestApp, body: Value) -> Response {
    app.post(POST).json(&body).send().await.unwrap()
}

async fn accepted(answer: Response) -> Value {
    let status = answer.status();
    let text = answer.text().await.unwrap();
    assert_eq!(status, StatusCode::ACCEPTED, "{text}");
    serde_json::from_str(&text).unwrap()
}

/// Sends a stack whose pictures differ by `seed`.
async fn sent(app: &TestApp, query: &str, slices: usize, seed: usize) -> Uuid {
    let members: Vec<_> =
        (0..slices).map(|i| (format!("front/img_{i}.png"), png(WIDTH, HEIGHT, 3, 10 * seed + i))).collect();
    id(&accepted(app.post(&format!("{STACK}{query}")).body(zip(&members)).send().await.unwrap()).await)
}

/// A zip of a rendered stack with detail everywhere.
fn weave(rig: &Rig, seed: u64, reversed: bool) -> Vec<u8> {
    let stage = Stage::new(rig, &Scene::weave(seed));
    let slice = |i: usize| {
        let mut out = Vec::new();
        let shown = stage.render(Light::Front, if reversed { rig.slices() - 1 - i } else { i });
        codec::encode_png(&mut out, &shown, &codec::Metadata::default()).expect("encoded");
        (format!("front/{i}.png"), out)
    };
    zip(&(0..rig.slices()).map(slice).collect::<Vec<_>>())
}

fn workers(app: &TestApp) -> Pool {
    let (store, disk) = (app.store.clone(), Arc::clone(&app.app.disk));
    Pool::start(Deps { store, disk, runner: Arc::new(ScienceRunner::default()) }, Config::default())
}

async fn ended(app: &TestApp, calibration: &Value) -> Value {
    let url = calibration["links"]["self"].as_str().expect("a link");
    loop {
        let answer = app.get(url).header("prefer", "wait=50").send().await.unwrap();
        let shown: Value = answer.json().await.unwrap();
        if ["succeeded", "failed", "cancelled"].contains(&shown["state"].as_str().unwrap()) {
            return shown;
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stored_stacks_calibrate_their_rig_until_their_pictures_are_gone() {
    let app = TestApp::start().await;
    let rig = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 5) };
    let mut input = profile(5);
    (input["image_width"], input["image_height"]) = (json!(420), json!(280));
    app.put("/v1/profiles/rig/lens").json(&input).send().await.unwrap().error_for_status().unwrap();
    let mut stacks = Vec::new();
    for (seed, order) in [(1, "name"), (2, "reverse")] {
        let body = weave(&rig, seed, order == "reverse");
        let request = app.post(&format!("{STACK}&order={order}")).body(body);
        stacks.push(id(&accepted(request.send().await.unwrap()).await));
    }
    for stack in &stacks {
        // the pictures do not depend on what becomes of the stack
        app.post(&format!("/v1/stacks/{stack}/cancel")).send().await.unwrap().error_for_status().unwrap();
    }
    let made = accepted(calibrate(&app, json!({ "stacks": stacks })).await).await;
    assert_eq!((&made["stacks"], &made["options"]["source"]), (&json!(stacks), &json!("stacks")));
    let pool = workers(&app);
    let shown = ended(&app, &made).await;
    assert_eq!(shown["state"], "succeeded", "{shown}");
    assert!(shown["result"]["verdict"].as_str().unwrap().contains("from 2 stacks"), "{shown}");
    let found: Value = app.get("/v1/profiles/rig/lens").send().await.unwrap().json().await.unwrap();
    assert_eq!(found["revision"], 2);
    for (i, matrix) in found["homographies"].as_array().unwrap().iter().enumerate() {
        let matrix: pinstack_science::types::Homography = serde_json::from_value(matrix.clone()).unwrap();
        let off = matrix.corner_distance(&rig.homography(i), 420, 280);
        assert!(off < 0.6, "slice {i} is {off} px off");
    }
    pool.shutdown(Duration::ZERO).await;

    // deleted while the calibration waits
    let waiting = accepted(calibrate(&app, json!({ "stacks": stacks })).await).await;
    let by_first = accepted(calibrate(&app, json!({ "stacks": [stacks[1]] })).await).await;
    app.delete(&format!("/v1/stacks/{}", stacks[1])).send().await.unwrap().error_for_status().unwrap();
    collect(&app.store, Duration::ZERO, &Retention::default()).await.unwrap();
    let _pool = workers(&app);
    let shown = ended(&app, &waiting).await;
    assert_eq!((&shown["state"], &shown["error"]["code"]), (&json!("failed"), &json!("upload_removed")), "{shown}");
    let detail = shown["error"]["detail"].as_str().unwrap();
    assert!(detail.contains(&stacks[1].to_string()) && detail.contains("without this stack"), "{detail}");
    // the pictures of the first are the calibration's own
    assert_eq!(ended(&app, &by_first).await["state"], "succeeded");
}

#[tokio::test]
async fn a_scan_is_named_as_a_whole_and_reruns_count_once() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    app.with_scan("bee").await;
    let none = problem(calibrate(&app, json!({ "scan": "bee" })).await, 410, "upload_removed").await;
    assert!(none["detail"].as_str().unwrap().contains("no view whose pictures are stored"), "{none}");
    let mut views = Vec::new();
    for pan in [0, 20, 40] {
        views.push(sent(&app, &format!("&scan=bee&pan_deg={pan}&tilt_deg=0"), 3, pan).await);
    }
    let failed = app.claim().await;
    app.fail(&failed, pinstack::contract::Fault::new(pinstack::contract::Code::InvalidImage, "torn")).await;
    let left: Vec<_> = views.iter().filter(|view| **view != failed.id).collect();
    let made = accepted(calibrate(&app, json!({ "scan": "bee" })).await).await;
    assert_eq!(made["stacks"], json!(left));
    let rerun = app.post(&format!("/v1/stacks/{}/rerun", left[0])).json(&json!({})).send().await.unwrap();
    let rerun = id(&accepted(rerun).await);
    let made = accepted(calibrate(&app, json!({ "stacks": [rerun, left[0], left[1]] })).await).await;
    assert_eq!(made["stacks"], json!([rerun, left[1]]));
    problem(calibrate(&app, json!({ "scan": "wasp" })).await, 404, "scan_not_found").await;
    // a stack that was sent is no stored one
    let shown = accepted(app.post(POST).body(stack_zip(3, 0)).send().await.unwrap()).await;
    assert_eq!(shown["stacks"], json!([]));
}

#[tokio::test]
async fn a_repeated_request_makes_no_second_calibration() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    let stacks = [sent(&app, "", 3, 1).await, sent(&app, "", 3, 2).await];
    let send = async |stacks: &[Uuid]| {
        let request = app.post(POST).header("idempotency-key", "once").json(&json!({ "stacks": stacks }));
        request.send().await.unwrap()
    };
    let first = accepted(send(&stacks).await).await;
    let again = send(&stacks).await;
    assert_eq!(again.headers()["idempotency-replayed"], "true");
    assert_eq!(accepted(again).await["id"], first["id"]);
    problem(send(&stacks[..1]).await, 422, "idempotency_key_reused").await;
}

#[tokio::test]
async fn stacks_that_cannot_be_used_are_named() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    let (first, second) = (sent(&app, "", 3, 1).await, sent(&app, "", 3, 2).await);
    for body in
        [json!({}), json!({ "stacks": [] }), json!({ "stacks": [first], "scan": "bee" }), json!({ "stacks": ["x"] })]
    {
        problem(calibrate(&app, body).await, 400, "invalid_request").await;
    }
    let many: Vec<_> = (0..101).map(|_| Uuid::now_v7()).collect();
    problem(calibrate(&app, json!({ "stacks": many })).await, 400, "invalid_request").await;
    let target = app.post("/v1/profiles/rig/lens/calibrations").json(&json!({ "stacks": [first] }));
    let told = problem(target.send().await.unwrap(), 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("add source=stacks"), "{told}");
    let other = app.post("/v1/profiles/other/lens/calibrations?source=stacks").json(&json!({ "stacks": [first] }));
    let told = problem(other.send().await.unwrap(), 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("is of rig 'rig'"), "{told}");
    problem(calibrate(&app, json!({ "stacks": [Uuid::now_v7()] })).await, 404, "not_found").await;

    app.put("/v1/profiles/rig/lens").json(&profile(2)).send().await.unwrap().error_for_status().unwrap();
    let short = sent(&app, "", 2, 3).await;
    let told = problem(calibrate(&app, json!({ "stacks": [first, short] })).await, 422, "slice_count_mismatch").await;
    let detail = told["detail"].as_str().unwrap();
    assert!(detail.contains(&format!("the stack {short} has 2 slices")) && detail.contains("has 3 slices"), "{detail}");

    // the zip of a stack is removed at the end of its retention period
    let job = app.claim().await;
    assert_eq!(job.id, first);
    app.finish(&job).await;
    let keep = Retention { uploads: Some(Duration::ZERO), ..Retention::default() };
    collect(&app.store, Duration::ZERO, &keep).await.unwrap();
    let told = problem(calibrate(&app, json!({ "stacks": [second, first] })).await, 410, "upload_removed").await;
    assert!(
        told["detail"].as_str().unwrap().contains(&format!("the pictures of the stack {first} were removed")),
        "{told}"
    );
}

#[tokio::test]
async fn with_isolation_the_stacks_of_another_token_are_not_found() {
    let app = TestApp::start_with(|policy| (policy.auth_required, policy.isolate_tokens) = (true, true)).await;
    let all = [Scope::StacksWrite, Scope::ProfilesWrite, Scope::Read];
    let (ann, ben) = (token(&app, "ann", &all).await, token(&app, "ben", &all).await);
    let stored = app.put("/v1/profiles/rig/lens").json(&profile(2)).bearer_auth(&ann).send().await.unwrap();
    assert!(stored.status().is_success());
    let stack = app.post(STACK).body(stack_zip(2, 0)).bearer_auth(&ann).send().await.unwrap();
    let body = json!({ "stacks": [id(&accepted(stack).await)] });
    let calibrate = async |token: &str| app.post(POST).json(&body).bearer_auth(token).send().await.unwrap();
    problem(calibrate(&ben).await, 404, "not_found").await;
    accepted(calibrate(&ann).await).await;
}

/// The profile of `rig` as numbers, with a camera that no stack knows.
fn numbers_of(rig: &Rig) -> Value {
    let homographies: Vec<_> = (0..rig.slices()).map(|i| rig.homography(i)).collect();
    json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "homographies": homographies, "capture_mode": "fixed_lens", "pixel_pitch_mm": 0.005, "magnification": 1.25,
        "principal_distance_mm": 121.5, "orientation": 1
    })
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stored_stacks_refine_a_revision_that_has_drifted_and_keep_its_camera() {
    let app = TestApp::start().await;
    let before = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 5) };
    let after = Rig { drift_px: [before.drift_px[0] + 5.0, before.drift_px[1] - 4.0], ..before.clone() };
    app.put("/v1/profiles/rig/lens").json(&numbers_of(&before)).send().await.unwrap().error_for_status().unwrap();
    let mut stacks = Vec::new();
    for (seed, rig) in [(1, &after), (2, &before)] {
        let stack = accepted(app.post(STACK).body(weave(rig, seed, false)).send().await.unwrap()).await;
        app.post(&format!("/v1/stacks/{}/cancel", id(&stack))).send().await.unwrap().error_for_status().unwrap();
        stacks.push(id(&stack));
    }
    let _pool = workers(&app);
    let refine = async |stack: &Uuid| {
        let request = app.post(&format!("{POST}&from=1")).json(&json!({ "stacks": [stack] }));
        ended(&app, &accepted(request.send().await.unwrap()).await).await
    };
    let shown = refine(&stacks[0]).await;
    assert_eq!((&shown["state"], &shown["options"]["from"]), (&json!("succeeded"), &json!(1)), "{shown}");
    let verdict = shown["result"]["verdict"].as_str().unwrap();
    assert!(verdict.contains("revision 1 refined (the worst image corner moved by"), "{verdict}");
    assert!(shown["warnings"][0]["detail"].as_str().unwrap().contains("has drifted since revision 1"), "{shown}");
    let found: Value = app.get("/v1/profiles/rig/lens").send().await.unwrap().json().await.unwrap();
    assert_eq!(found["revision"], 2);
    for (i, matrix) in found["homographies"].as_array().unwrap().iter().enumerate() {
        let matrix: pinstack_science::types::Homography = serde_json::from_value(matrix.clone()).unwrap();
        let [off, old] = [&after, &before].map(|rig| matrix.corner_distance(&rig.homography(i), 420, 280));
        assert!(
            off < 0.5 && (i == after.reference || old > 0.5),
            "slice {i} is {off} px off, and {old} px from before"
        );
    }
    for (name, value) in [("principal_distance_mm", 121.5), ("pixel_pitch_mm", 0.005), ("magnification", 1.25)] {
        assert_eq!(found[name], json!(value), "{name}");
    }
    let report = format!("{}?format=json", shown["links"]["report"].as_str().unwrap());
    let report: Value = app.get(&report).send().await.unwrap().json().await.unwrap();
    assert_eq!(report["camera"]["principal_distance_mm"], json!(121.5));
    assert!(report["drift"]["worst_px"].as_f64().unwrap() > 2.0, "{}", report["drift"]);

    // nothing has moved
    let shown = refine(&stacks[1]).await;
    assert!(shown["result"]["verdict"].as_str().unwrap().contains("no drift since revision 1"), "{shown}");
    let found: Value = app.get("/v1/profiles/rig/lens").send().await.unwrap().json().await.unwrap();
    assert_eq!(found["revision"], 3);
    let first: Value = app.get("/v1/profiles/rig/lens?revision=1").send().await.unwrap().json().await.unwrap();
    let drift: Value = app.get("/v1/profiles/rig/lens/drift?from=1&to=3").send().await.unwrap().json().await.unwrap();
    assert!(drift["worst_px"].as_f64().unwrap() < 1e-6, "{drift}");
    assert_eq!(first["optics_digest"], found["optics_digest"]);
}

#[tokio::test]
async fn stacks_that_cannot_refine_a_revision_are_refused_with_a_reason() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    let stack = sent(&app, "", 3, 1).await;
    let post = async |query: &str| app.post(&format!("{POST}{query}")).json(&json!({ "stacks": [stack] })).send().await;
    let told = problem(post("&from=7").await.unwrap(), 404, "profile_not_found").await;
    assert!(told["detail"].as_str().unwrap().contains("has no revision 7"), "{told}");
    let told = problem(post("&from=1&focal_mm=65&rail_step_mm=0.5").await.unwrap(), 400, "invalid_request").await;
    let told = told.to_string();
    assert!(told.contains("focal_mm cannot be combined with from") && told.contains("rail_step_mm cannot"), "{told}");
    let target = app.post("/v1/profiles/rig/lens/calibrations?from=1").body(stack_zip(3, 0)).send().await.unwrap();
    let told = problem(target, 400, "invalid_request").await;
    assert!(told.to_string().contains("from is for source=stacks"), "{told}");

    app.put("/v1/profiles/rig/lens").json(&profile(2)).send().await.unwrap().error_for_status().unwrap();
    let told = problem(post("&from=2").await.unwrap(), 422, "slice_count_mismatch").await;
    let detail = told["detail"].as_str().unwrap();
    assert!(
        detail.contains("has 3 slices") && detail.contains("revision 2") && detail.contains("2 slices"),
        "{detail}"
    );
    let mut larger = profile(3);
    larger["image_width"] = json!(2 * WIDTH);
    app.put("/v1/profiles/rig/lens").json(&larger).send().await.unwrap().error_for_status().unwrap();
    let told = problem(post("&from=3").await.unwrap(), 422, "size_mismatch").await;
    assert!(told["detail"].as_str().unwrap().contains("omit from"), "{told}");
    accepted(post("&from=1&allow_new_size=true").await.unwrap()).await;
}
