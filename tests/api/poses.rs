//! Reports on camera poses.

use pinstack_science::{
    archive,
    types::{intrinsics::Intrinsics, view::ViewAngles},
};
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::app::{TestApp, problem};

/// Two rings of 18 views on a sphere of radius 2, as CSV.
fn csv() -> String {
    let mut text = "name,x,y,z\n".to_owned();
    for tilt_deg in [0.0, 12.0] {
        for pan in 0..18 {
            let angles = ViewAngles { pan_deg: 20.0 * f64::from(pan), tilt_deg };
            let [x, y, z] = angles.direction().map(|part| 2.0 * part);
            text.push_str(&format!("{}.png,{x},{y},{z}\n", angles.file_stem()));
        }
    }
    text
}

#[tokio::test]
async fn poses_are_reported_in_every_format() {
    let app = TestApp::start().await;
    let ask = async |query: &str| app.post(&format!("/v1/poses{query}")).body(csv()).send().await.unwrap();
    let report: Value = ask("?radius_mm=141&expected=40").await.json().await.unwrap();
    assert_eq!(
        (&report["registered"], &report["expected"], &report["format"]),
        (&json!(36), &json!(40), &json!("csv"))
    );
    assert_eq!((&report["scale"]["unit"], &report["scale"]["source"]), (&json!("mm"), &json!("known_radius")));
    assert!((report["scale"]["per_file_unit"].as_f64().unwrap() - 70.5).abs() < 1e-9);
    let step = |name: &str| report[name]["mean_deg"].as_f64().unwrap();
    assert!((step("pan_steps") - 20.0).abs() < 1e-6 && (step("tilt_steps") - 12.0).abs() < 1e-6, "{report}");
    assert!(report["surface"]["std_percent"].as_f64().unwrap() < 1e-6);
    for (format, kind, part) in [
        ("text", "text/plain; charset=utf-8", "radius of the sphere"),
        ("latex", "application/x-latex", "\\begin{tabular}"),
        ("html", "text/html; charset=utf-8", "<svg"),
    ] {
        let answer = ask(&format!("?format={format}")).await;
        assert_eq!((answer.status(), answer.headers()["content-type"].to_str().unwrap()), (StatusCode::OK, kind));
        let policy = answer.headers()["content-security-policy"].to_str().unwrap().to_owned();
        assert!(policy.starts_with("default-src 'none'"), "{policy}");
        let text = answer.text().await.unwrap();
        assert!(text.contains(part) && text.contains("do not check the focal length"), "{format}: {text}");
    }
}

#[tokio::test]
async fn the_focal_length_is_compared_with_the_principal_distance_of_the_scan() {
    let app = TestApp::start().await;
    with_measured_camera(&app, Some(0.2)).await;
    let centres: String = [0, 20, 40]
        .map(|pan| {
            let [x, y, z] = ViewAngles { pan_deg: f64::from(pan), tilt_deg: 0.0 }.direction();
            format!("v{pan},{x},{y},{z}\n")
        })
        .concat();
    let ask = |query: &'static str| {
        app.post(&format!("/v1/scans/bee/poses{query}")).body(format!("name,x,y,z\n{centres}")).send()
    };
    let report: Value = ask("").await.unwrap().json().await.unwrap();
    assert!(report["not_checked"].as_str().unwrap().contains("of the camera, 6500.0 px"), "{report}");
    let right: Value = ask("?focal_px=6520&focal_sigma_px=40").await.unwrap().json().await.unwrap();
    assert_eq!(
        (&right["not_checked"], right["focal_length"]["reconstruction_px"].as_f64()),
        (&Value::Null, Some(6520.0))
    );
    assert!(!right["findings"].to_string().contains("focal_length_disagrees"), "{right}");
    for (query, says) in [
        ("?focal_px=0", "focal_px must be greater than 0"),
        ("?focal_sigma_px=4", "focal_sigma_px needs focal_px"),
        ("?length_mm=4", "a known length needs length_from, length_to and length_mm"),
        ("?length_mm=4&length_from=1,2&length_to=1,2,3", "length_from must be three numbers"),
        ("?length_mm=4&length_from=1,2,3&length_to=1,2,NaN", "length_to must be three numbers"),
        ("?length_mm=4&length_from=1,2,3&length_to=1,2,4", "give radius_mm, or pair_from"),
    ] {
        let refused = problem(ask(query).await.unwrap(), 400, "invalid_request").await;
        assert!(refused["detail"].as_str().unwrap().contains(says), "{refused}");
    }
    let report: Value = ask("?focal_px=7800").await.unwrap().json().await.unwrap();
    let compared = &report["focal_length"];
    assert_eq!((&compared["camera_px"], &compared["camera_sigma_px"]), (&json!(6500.0), &json!(10.0)), "{report}");
    assert!(report["findings"].to_string().contains("focal_length_disagrees"), "{report}");
}

/// A scan of three views whose camera has a principal distance of 130 mm, 6500 px, with this standard deviation.
async fn with_measured_camera(app: &TestApp, sigma_mm: Option<f64>) {
    app.with_scan("bee").await;
    for pan in ["0", "20", "40"] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=0&label=v{pan}")).await;
        let job = app.claim().await;
        app.finish_stack(&job, |outcome| {
            outcome.image.intrinsics = Some(Intrinsics {
                principal_distance_px: 6500.0,
                principal_distance_mm: 130.0,
                principal_distance_sigma_mm: sigma_mm,
                pixel_pitch_mm: 0.02,
                principal_point_px: None,
                distortion: None,
            });
        })
        .await;
    }
}

/// A zip of a COLMAP model of that scan, with this focal length.
fn colmap_model(focal_px: f64) -> Vec<u8> {
    let images = [0, 20, 40].map(|pan: u32| {
        let half = f64::from(pan).to_radians() / 2.0;
        format!("{pan} {} 0 {} 0 0 0 1 4 v{pan}.png\n\n", half.cos(), half.sin())
    });
    let cameras = format!("4 PINHOLE 99 99 {} {} 50 50\n", focal_px - 10.0, focal_px + 10.0);
    let members = [("0/images.txt".to_owned(), images.concat()), ("0/cameras.txt".to_owned(), cameras)];
    let mut zip = std::io::Cursor::new(Vec::new());
    archive::pack(&mut zip, members.map(|(name, text)| (name, text.into_bytes())).into_iter()).unwrap();
    zip.into_inner()
}

#[tokio::test]
async fn the_focal_length_of_a_zipped_colmap_model_needs_no_typing() {
    let app = TestApp::start().await;
    with_measured_camera(&app, Some(0.2)).await;
    let ask = async |query: &str| -> Value {
        let model = colmap_model(7800.0);
        app.post(&format!("/v1/scans/bee/poses{query}")).body(model).send().await.unwrap().json().await.unwrap()
    };
    let report = ask("").await;
    assert_eq!((&report["format"], &report["registered"]), (&json!("colmap_text"), &json!(3)), "{report}");
    assert_eq!(report["focal_length"]["reconstruction_px"], json!(7800.0), "{report}");
    assert!(report["findings"].to_string().contains("focal_length_disagrees"), "{report}");
    let typed = ask("?focal_px=6520").await;
    assert_eq!(typed["focal_length"]["reconstruction_px"], json!(6520.0), "{typed}");
    assert!(!typed["findings"].to_string().contains("focal_length_disagrees"), "{typed}");
    // a known length checks it without the camera: 0.1 of the radius
    let length = ask("?radius_mm=141&length_from=0,0,0&length_to=0,0.1,0&length_mm=16.92").await;
    assert!((length["known_length"]["reconstruction_mm"].as_f64().unwrap() - 14.1).abs() < 1e-6, "{length}");
    assert!(length["findings"].to_string().contains("known_length_disagrees"), "{length}");
    assert_eq!(length["not_checked"], Value::Null, "{length}");
    let alone = app.post("/v1/poses").body(colmap_model(7800.0)).send().await.unwrap();
    assert_eq!(alone.status(), StatusCode::OK);
}

#[tokio::test]
async fn a_principal_distance_without_uncertainty_does_not_check_the_focal_length() {
    let app = TestApp::start().await;
    with_measured_camera(&app, None).await;
    let answer = app.post("/v1/scans/bee/poses").body(colmap_model(6520.0)).send().await.unwrap();
    let report: Value = answer.json().await.unwrap();
    assert_eq!(report["focal_length"]["camera_sigma_px"], Value::Null, "{report}");
    let said = report["not_checked"].as_str().unwrap();
    assert!(said.contains("the uncertainty of the principal distance of the camera is unknown"), "{report}");
}

#[tokio::test]
async fn poses_of_a_scan_are_compared_with_its_views() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for (pan, label) in [("0", "head"), ("20", "left"), ("40", "tail"), ("60", "lost")] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=0&label={label}")).await;
    }
    let mut text = "name,x,y,z\n".to_owned();
    for (pan_deg, name) in [(0.0, "head.png"), (20.0, "left.png"), (40.0, "tail.png"), (80.0, "wasp.png")] {
        let [x, y, z] = ViewAngles { pan_deg, tilt_deg: 0.0 }.direction();
        text.push_str(&format!("{name},{x},{y},{z}\n"));
    }
    let answer = app.post("/v1/scans/bee/poses").body(text).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let report: Value = answer.json().await.unwrap();
    assert_eq!((&report["registered"], &report["expected"]), (&json!(3), &json!(4)));
    assert_eq!((&report["not_registered"], &report["unknown"]), (&json!(["lost"]), &json!(["wasp.png"])));
    assert_eq!(report["views"][1]["commanded_pan_deg"], json!(20.0));
    assert_eq!((&report["surface"]["kind"], &report["pan_steps"]["count"]), (&json!("circle"), &json!(2)));
    let findings: Vec<&Value> = report["findings"].as_array().unwrap().iter().collect();
    let told = |code: &str| findings.iter().find(|f| f["code"] == code).expect(code)["detail"].as_str().unwrap();
    assert_eq!(told("unknown_views"), "1 registered view is not a view of this scan: wasp.png");
    assert_eq!(told("not_registered"), "1 view is not registered: lost");
    problem(app.post("/v1/scans/wasp/poses").body(csv()).send().await.unwrap(), 404, "scan_not_found").await;
}

#[tokio::test]
async fn poses_of_another_scan_are_refused_with_a_name_of_each() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for label in ["head", "left", "tail"] {
        app.with_stack(&format!("&scan=bee&label={label}")).await;
    }
    let refused = app.post("/v1/scans/bee/poses").body(csv()).send().await.unwrap();
    let refused = problem(refused, 422, "invalid_poses").await;
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.starts_with("none of the 36 views of the file is a view of this scan"), "{detail}");
    assert!(detail.contains("the file has 'pan000_tilt00.png', the scan has 'head'"), "{detail}");
    assert_eq!(app.post("/v1/poses").body(csv()).send().await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn poses_of_a_scan_without_views_are_refused() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let refused = app.post("/v1/scans/bee/poses").body(csv()).send().await.unwrap();
    let refused = problem(refused, 422, "invalid_poses").await;
    let wanted =
        "the scan 'bee' has no views yet; send its stacks first, or ask for a report without a scan (POST /v1/poses)";
    assert_eq!(refused["detail"], wanted, "{refused}");
}

#[tokio::test]
async fn what_is_no_file_of_poses_is_refused_with_the_reason() {
    let app = TestApp::start().await;
    let ask =
        async |query: &str, body: Vec<u8>| app.post(&format!("/v1/poses{query}")).body(body).send().await.unwrap();
    let torn = problem(ask("", b"1 0.9 0.1 0 0 1 2\n".to_vec()).await, 422, "invalid_poses").await;
    assert!(torn["detail"].as_str().unwrap().contains("COLMAP images.txt"), "{torn}");
    let torn =
        problem(ask("?file_format=colmap_text", b"1 0.9 0.1 0 0 1 2\n".to_vec()).await, 422, "invalid_poses").await;
    assert!(torn["detail"].as_str().unwrap().starts_with("line 1: value 8 is ''"), "{torn}");
    problem(ask("", Vec::new()).await, 422, "invalid_poses").await;
    for (query, pointer) in [
        ("?format=pdf", Some("format")),
        ("?radius_mm=x", Some("radius_mm")),
        ("?radius_mm=-141", Some("radius_mm")),
        ("?expected=0", Some("expected")),
        ("?pair_mm=3", None),
    ] {
        let refused = problem(ask(query, csv().into()).await, 400, "invalid_request").await;
        assert_eq!(refused["errors"][0]["pointer"].as_str(), pointer, "{refused}");
    }
    let pair = "?pair_from=pan000_tilt00&pair_to=pan999_tilt00&pair_mm=4";
    let refused = problem(ask(pair, csv().into()).await, 400, "invalid_request").await;
    assert_eq!(refused["errors"][0]["pointer"], "pair_to", "{refused}");
    let left: Vec<_> = std::fs::read_dir(app.store.workspace.path()).unwrap().collect();
    assert!(left.is_empty(), "the files are removed: {left:?}");
}
