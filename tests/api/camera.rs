//! The camera over HTTP: the calibration with the target moved, and the pupil ratio of rig parameters.

use serde_json::{Value, json};

use crate::{
    app::{HEIGHT, TestApp, WIDTH, id, png, problem, stack_zip, zip},
    pages::page,
};

const POST: &str = "/v1/profiles/rig/lens/calibrations";

#[tokio::test]
async fn a_calibration_takes_the_dot_pitch_of_the_one_with_the_target_moved() {
    let app = TestApp::start().await;
    let near: Value = app
        .post("/v1/profiles/rig/near/calibrations")
        .body(stack_zip(2, 0))
        .send()
        .await
        .unwrap()
        .json()
        .await
        .unwrap();
    let near = id(&near);
    let send = |slices: usize, query: String| app.post(&format!("{POST}?{query}")).body(stack_zip(slices, 0)).send();
    let with_it = format!("target_advance_mm=5&moved_target={near}");

    let early = problem(send(2, with_it.clone()).await.unwrap(), 400, "invalid_request").await;
    assert!(early["detail"].as_str().unwrap().contains("has no succeeded calibration with this id"), "{early}");
    let job = app.claim().await;
    app.finish(&job).await;
    let ended: Value = app.get(&format!("/v1/calibrations/{near}")).send().await.unwrap().json().await.unwrap();
    let pitch = &ended["result"]["dot_pitch_px"];
    let shown: Value = send(2, with_it.clone()).await.unwrap().json().await.unwrap();
    assert!(pitch.is_f64(), "{ended}");
    assert_eq!(&shown["options"]["moved_target_pitch_px"], pitch, "{shown}");
    assert_eq!(shown["options"]["target_advance_mm"], 5.0);

    let other = problem(send(5, with_it).await.unwrap(), 400, "invalid_request").await;
    assert!(other["detail"].as_str().unwrap().contains("the same number of slices"), "{other}");
    let alone = problem(send(2, format!("moved_target={near}")).await.unwrap(), 400, "invalid_request").await;
    assert!(alone.to_string().contains("target_advance_mm is missing"), "{alone}");
    let unknown = send(2, "target_advance_mm=5&moved_target=near".into()).await.unwrap();
    problem(unknown, 400, "invalid_request").await;
}

#[tokio::test]
async fn a_moved_target_is_a_folder_of_the_zip_with_one_picture_or_as_many_as_slices() {
    let app = TestApp::start().await;
    let send = |moved: usize, query: &'static str| {
        let folder = |name: &'static str, count: usize| {
            (0..count).map(move |i| (format!("{name}/{i}.png"), png(WIDTH, HEIGHT, 3, i)))
        };
        let zip = zip(&folder("front", 3).chain(folder("moved", moved)).collect::<Vec<_>>());
        app.post(&format!("{POST}?{query}")).body(zip).send()
    };
    for moved in [1, 3] {
        let sent: Value = send(moved, "target_advance_mm=5").await.unwrap().json().await.unwrap();
        assert_eq!(sent["state"], "queued", "{sent}");
    }
    let other = "target_advance_mm=5&moved_target_pitch_px=30";
    for (moved, query, status, code, says) in [
        (1, "", 400, "invalid_request", "target_advance_mm is missing, but the zip has a folder of the moved target"),
        (
            0,
            "target_advance_mm=5",
            400,
            "invalid_request",
            "add one picture with the rail where it was for the reference slice (index 1)",
        ),
        (1, other, 400, "invalid_request", "omit one of them"),
        (2, "target_advance_mm=5", 422, "slice_count_mismatch", "has 2 pictures, and the calibration 3 slices"),
    ] {
        let refused = problem(send(moved, query).await.unwrap(), status, code).await;
        assert!(refused["detail"].as_str().unwrap().contains(says), "{refused}");
    }
    let page = app.get("/send").header("accept", "text/html").send().await.unwrap().text().await.unwrap();
    assert!(
        page.contains("The target, moved towards the lens by a known distance") && page.contains("target_advance_mm")
    );
    app.with_profile(3).await;
    let files: Vec<_> = ["1", "2", "3", "moved/1"].map(|name| (format!("{name}.png"), png(WIDTH, HEIGHT, 3, 1))).into();
    let stack = app.post("/v1/stacks?rig=rig&lens=lens").body(zip(&files)).send().await.unwrap();
    let refused = problem(stack, 422, "invalid_archive").await;
    assert!(refused["detail"].as_str().unwrap().contains("moved target of a calibration"), "{refused}");
}

#[tokio::test]
async fn rig_parameters_use_the_pupil_ratio_and_say_when_it_is_assumed() {
    let app = &TestApp::start().await;
    let mut body = json!({
        "image_width": 640, "image_height": 480, "slice_count": 3, "rail_step_mm": 0.5, "focal_mm": 65, "magnification": 1,
        "pixel_pitch_mm": 0.01, "capture_mode": "fixed_lens"
    });
    let send = |body: Value| async move {
        let answer = app.post("/v1/profiles/rig/lens/rig-parameters").json(&body).send().await.unwrap();
        answer.json::<Value>().await.unwrap()
    };
    let assumed = send(body.clone()).await;
    assert_eq!(assumed["warnings"][0]["code"], "pupil_ratio_assumed", "{assumed}");
    assert_eq!(assumed["principal_distance_source"], "focal_length");
    body["pupil_ratio"] = json!(1.6);
    let given = send(body).await;
    assert_eq!(given["warnings"], json!([]), "{given}");
    // f (1 + M / P), f (M + P) and f (1 / M + 1 / P)
    for (name, expected) in [
        ("principal_distance_mm", 105.625),
        ("exit_pupil_distance_mm", 169.0),
        ("entrance_pupil_distance_mm", 105.625),
        ("pupil_ratio", 1.6),
    ] {
        assert!((given[name].as_f64().unwrap() - expected).abs() < 1e-9, "{name}: {given}");
    }
    assert_eq!(given["principal_distance_source"], "pupil_ratio");
    assert_eq!(given["principal_distance_sigma_mm"], Value::Null);

    // a profile of an older version has none of the members, and is stored and read without them
    let old = json!({
        "image_width": 640, "image_height": 480, "reference_index": 0, "homographies": [[1, 0, 0, 0, 1, 0, 0, 0, 1],
        [1, 0, 1, 0, 1, 0, 0, 0, 1]], "principal_distance_mm": 130, "pixel_pitch_mm": 0.01
    });
    let stored: Value = app.put("/v1/profiles/rig/old").json(&old).send().await.unwrap().json().await.unwrap();
    assert_eq!(stored["principal_distance_mm"], 130.0, "{stored}");
    assert_eq!((&stored["principal_distance_source"], &stored["pupil_ratio"]), (&Value::Null, &Value::Null));
}

#[tokio::test]
async fn a_profile_gets_its_camera_later_and_the_pages_say_so() {
    let app = &TestApp::start().await;
    app.with_profile(3).await;
    app.with_scan("bee").await;
    let line = "No camera: reconstruction must estimate the focal length";
    for path in ["/profiles/rig/lens", "/scans/bee"] {
        assert!(page(app, path).await.contains(line), "{path}");
    }
    let url = "/v1/profiles/rig/lens/camera";
    let told = problem(app.post(url).json(&json!({})).send().await.unwrap(), 422, "invalid_profile").await;
    assert!(told["detail"].as_str().unwrap().contains("give pixel_pitch_mm"), "{told}");
    problem(app.post(url).json(&json!({ "focal_mm": -1 })).send().await.unwrap(), 400, "invalid_request").await;
    problem(app.post(url).json(&json!({ "focal": 65 })).send().await.unwrap(), 400, "invalid_request").await;
    problem(app.post("/v1/profiles/rig/none/camera").json(&json!({})).send().await.unwrap(), 404, "profile_not_found")
        .await;

    let before: Value = app.get("/v1/profiles/rig/lens").send().await.unwrap().json().await.unwrap();
    let numbers = json!({ "focal_mm": 65, "magnification": 1, "pixel_pitch_mm": 0.01 });
    let stale = app.post(url).header("if-match", "\"9\"").json(&numbers).send().await.unwrap();
    problem(stale, 412, "precondition_failed").await;
    // the second time nothing is new
    for _ in 0..2 {
        let answer = app.post(url).json(&numbers).send().await.unwrap();
        assert_eq!(answer.headers()["etag"], "\"2\"");
        let with: Value = answer.json().await.unwrap();
        assert_eq!((&with["revision"], &with["digest"]), (&json!(2), &before["digest"]), "{with}");
        assert_ne!(with["optics_digest"], before["optics_digest"]);
        assert_eq!((&with["principal_distance_mm"], &with["slices"]), (&json!(130.0), &before["slices"]));
        assert!(with["principal_distance_sigma_mm"].as_f64().unwrap() > 10.0, "it is told to be rough: {with}");
    }
    let text = page(app, "/profiles/rig/lens").await;
    assert!(
        text.contains("130.000 ± ") && text.contains("rough, from the focal length") && !text.contains(line),
        "{text}"
    );
    assert!(!page(app, "/scans/bee").await.contains(line));
}
