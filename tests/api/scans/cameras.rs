//! One canvas and one camera for all views of a scan: what differs is named, and no bundle is made.

use pinstack::contract::outcome::ImageInfo;
use pinstack_science::types::intrinsics::Intrinsics;
use reqwest::StatusCode;
use serde_json::Value;

use super::scan;
use crate::app::{TestApp, problem};

fn pinhole(principal_distance_mm: f64, principal_point_px: [f64; 2]) -> Option<Intrinsics> {
    let pixel_pitch_mm = 0.0061;
    Some(Intrinsics {
        principal_distance_px: principal_distance_mm / pixel_pitch_mm,
        principal_distance_mm,
        principal_distance_sigma_mm: None,
        pixel_pitch_mm,
        principal_point_px: Some(principal_point_px),
        distortion: None,
    })
}

/// A scan of four views, the last of which has another image.
async fn with_an_odd_view(change: impl FnOnce(&mut ImageInfo)) -> TestApp {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let usual = |image: &mut ImageInfo| image.intrinsics = pinhole(121.0, [11.5, 8.5]);
    for pan in [0, 20, 40] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=6")).await;
        app.finish_stack(&app.claim().await, |outcome| usual(&mut outcome.image)).await;
    }
    app.with_stack("&scan=bee&pan_deg=60&tilt_deg=6").await;
    let job = app.claim().await;
    let changed = |image: &mut ImageInfo| {
        usual(image);
        change(image);
    };
    app.finish_stack(&job, |outcome| changed(&mut outcome.image)).await;
    app
}

async fn refused(app: &TestApp) -> String {
    let answer = app.get("/v1/scans/bee/bundle?layout=colmap").send().await.unwrap();
    let refused = problem(answer, 422, "scan_mismatch").await;
    let detail = refused["detail"].as_str().unwrap().to_owned();
    assert!(detail.contains("POST /v1/scans/bee/rerun"), "it says what to do: {detail}");
    detail
}

fn findings(table: &Value) -> Vec<(&str, &str)> {
    let all = table["findings"].as_array().expect("a list");
    let all = all.iter().map(|finding| (finding["code"].as_str().unwrap(), finding["detail"].as_str().unwrap()));
    // the test sends one zip for all views
    all.filter(|(code, _)| *code != "same_pictures").collect()
}

#[tokio::test]
async fn views_with_one_camera_have_a_bundle_and_no_finding() {
    let app = with_an_odd_view(|_| {}).await;
    let answer = app.get("/v1/scans/bee/bundle?layout=colmap").send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    assert_eq!(findings(&scan(&app, "bee").await), []);
}

#[tokio::test]
async fn a_view_of_another_size_is_named() {
    let app = with_an_odd_view(|image| (image.width, image.crop_offset_px) = (20, [2, 0])).await;
    let detail = refused(&app).await;
    assert!(detail.starts_with("pan060_tilt06 (20 x 18 px) differ"), "{detail}");
    let table = scan(&app, "bee").await;
    let [("mixed_sizes", told)] = findings(&table)[..] else { panic!("{table}") };
    assert!(told.starts_with("another size than most: pan060_tilt06;"), "{told}");
}

#[tokio::test]
async fn a_view_of_another_crop_with_the_same_size_is_named() {
    let app = with_an_odd_view(|image| {
        (image.crop_offset_px, image.intrinsics) = ([3, 1], pinhole(121.0, [8.5, 7.5]));
    })
    .await;
    let detail = refused(&app).await;
    assert!(detail.starts_with("pan060_tilt06 (a crop at 3,1) differ"), "{detail}");
    let table = scan(&app, "bee").await;
    let [("mixed_cameras", told)] = findings(&table)[..] else { panic!("{table}") };
    assert!(told.contains("another camera than most (a crop at 3,1): pan060_tilt06;"), "{told}");
}

/// The digest of the geometry of a profile does not cover these numbers.
#[tokio::test]
async fn a_view_of_another_principal_distance_is_named() {
    for camera in [pinhole(130.0, [11.5, 8.5]), pinhole(121.0, [12.5, 8.5]), None] {
        let app = with_an_odd_view(|image| image.intrinsics = camera).await;
        let detail = refused(&app).await;
        let expected = "pan060_tilt06 (another principal distance, pixel pitch or principal point) differ";
        assert!(detail.starts_with(expected), "{detail}");
        let table = scan(&app, "bee").await;
        assert_eq!(findings(&table).iter().map(|(code, _)| *code).collect::<Vec<_>>(), ["mixed_cameras"], "{table}");
        assert_eq!(table["findings"][0]["views"], serde_json::json!(["pan060_tilt06"]));
    }
}
