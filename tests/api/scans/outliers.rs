//! The table names the views that differ from their neighbours, and the angles at which a view is missing.

use pinstack_science::types::metrics::{MaskMetrics, Metrics, SliceMetrics};
use serde_json::{Value, json};

use super::{names, scan};
use crate::app::{HEIGHT, TestApp, WIDTH, png, zip};

/// Metrics of a view of an object that looks alike from all sides, but for the given factors.
fn metrics(at: usize, sharpness: f64, area: f64, residual_px: f64, level: f64) -> Metrics {
    let jitter = 1.0 + 0.01 * ((at * 7) % 5) as f64;
    let mut metrics = Metrics::default();
    metrics.fusion.tenengrad = Some(400.0 * sharpness * jitter);
    metrics.fusion.mean_level = Some(90.0 * level * jitter);
    metrics.alignment.residual_p95_px = Some(residual_px + 0.05 * jitter);
    metrics.mask = Some(MaskMetrics {
        foreground_fraction: 0.05 * area * jitter,
        threshold: 0.5,
        separability: None,
        border_contact_fraction: 0.0,
        components: 1,
        holes: 0,
        light_falloff: None,
        translucent_fraction: 0.0,
    });
    metrics
}

/// Two rings of 18 views at tilts 0 and 12, without the one at pan 100, tilt 12.
async fn measured() -> TestApp {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let ring = |tilt: u32| (0..18).map(move |step| (20 * step, tilt));
    for (at, (pan, tilt)) in ring(0).chain(ring(12)).filter(|view| *view != (100, 12)).enumerate() {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg={tilt}")).await;
        let of_view = match (pan, tilt) {
            (60, 0) => metrics(at, 0.25, 1.0, 0.2, 1.0),
            (120, 0) => metrics(at, 1.0, 4.0, 0.2, 1.0),
            (200, 12) => metrics(at, 1.0, 1.0, 1.5, 1.0),
            (300, 12) => metrics(at, 1.0, 1.0, 0.2, 0.6),
            _ => metrics(at, 1.0, 1.0, 0.2, 1.0),
        };
        app.finish_stack(&app.claim().await, |outcome| outcome.metrics = of_view).await;
    }
    app
}

#[tokio::test]
async fn outliers_and_missing_views_are_named_with_what_to_do() {
    let app = measured().await;
    let table = scan(&app, "bee").await;
    let differ: Vec<(&str, &str)> = table["views"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|view| {
            let all = view["outliers"].as_array().unwrap();
            all.iter().map(|outlier| (view["name"].as_str().unwrap(), outlier["kind"].as_str().unwrap()))
        })
        .collect();
    let expected = [
        ("pan060_tilt00", "sharpness"),
        ("pan120_tilt00", "mask_area"),
        ("pan200_tilt12", "residual"),
        ("pan300_tilt12", "exposure"),
    ];
    assert_eq!(differ, expected);
    assert_eq!(table["missing"], json!([{ "pan_deg": 100.0, "tilt_deg": 12.0 }]));
    let findings = table["findings"].as_array().unwrap().iter().map(|f| (f["code"].as_str().unwrap(), &f["views"]));
    // the test sends one zip for all views
    let findings: Vec<(&str, &Value)> = findings.filter(|(code, _)| *code != "same_pictures").collect();
    let outliers = json!(expected.map(|(view, _)| view));
    assert_eq!(findings, [("missing_views", &json!(["pan100_tilt12"])), ("outliers", &outliers)]);
    let blurred = &table["views"][3]["outliers"][0];
    assert!((blurred["value"].as_f64().unwrap() / blurred["expected"].as_f64().unwrap() - 0.25).abs() < 0.02);
    assert!(blurred["detail"].as_str().unwrap().contains("take the view again"), "{blurred}");
}

#[tokio::test]
async fn the_csv_has_the_same_rows_and_numbers() {
    let app = measured().await;
    let table = scan(&app, "bee").await;
    let answer = app.get("/v1/scans/bee/views.csv").send().await.unwrap();
    assert_eq!(answer.headers()["content-disposition"], "attachment; filename=\"bee_views.csv\"");
    let text = answer.text().await.unwrap();
    // for a spreadsheet
    let marked = app.get("/v1/scans/bee/views.csv?bom=true").send().await.unwrap().bytes().await.unwrap();
    assert_eq!(marked.as_ref(), [b"\xef\xbb\xbf", text.as_bytes()].concat());
    let page = crate::pages::page(&app, "/scans/bee").await;
    assert!(page.contains("/v1/scans/bee/views.csv?bom=true"), "{page}");
    crate::app::problem(app.get("/v1/scans/bee/views.csv?bom=1").send().await.unwrap(), 400, "invalid_request").await;
    let mut lines = text.split("\r\n");
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|column| *column == name).expect(name);
    let rows: Vec<&str> = lines.filter(|line| !line.is_empty()).collect();
    assert_eq!(rows.len(), names(&table["views"]).len());
    for (row, view) in rows.iter().zip(table["views"].as_array().unwrap()) {
        // the sentences in the last two columns may have commas
        let fields: Vec<&str> = row.split(',').collect();
        assert_eq!(fields[column("name")], view["name"].as_str().unwrap());
        for name in ["pan_deg", "tilt_deg", "sharpness", "mask_area", "residual_px", "mean_level"] {
            let (written, shown) = (fields[column(name)].parse::<f64>().unwrap(), view[name].as_f64().unwrap());
            assert!((written - shown).abs() <= 1e-12 * shown.abs(), "{name}: {row}");
        }
        let told = view["outliers"].as_array().unwrap().iter().all(|o| row.contains(o["detail"].as_str().unwrap()));
        assert!(told, "{row}");
    }
}

#[tokio::test]
async fn views_at_equal_angles_under_different_labels_are_a_finding() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    for (pan, label) in [(0, "head"), (20, "left"), (20, "also-left")] {
        app.with_stack(&format!("&scan=bee&pan_deg={pan}&tilt_deg=6&label={label}")).await;
    }
    let table = scan(&app, "bee").await;
    assert_eq!(names(&table["views"]), ["head", "also-left", "left"], "neither replaces the other");
    let [finding, copies] = &table["findings"].as_array().unwrap()[..] else { panic!("{table}") };
    assert_eq!((&finding["code"], &finding["views"]), (&json!("duplicate_angles"), &json!(["also-left", "left"])));
    assert!(finding["detail"].as_str().unwrap().contains("delete one, or correct it"), "{finding}");
    // the test sends one zip for all views
    assert_eq!((&copies["code"], copies["views"].as_array().unwrap().len()), (&json!("same_pictures"), 3));
}

#[tokio::test]
async fn a_view_that_was_sent_again_under_another_angle_is_a_finding() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    app.with_profile(2).await;
    // the same pictures in one zip, the same pictures in another zip, and other pictures
    let pictures = |first: usize| [0, 1].map(|n| (format!("front/{n}.png"), png(WIDTH, HEIGHT, 3, first + n)));
    let named = [0, 1].map(|n| (format!("front/other_{n}.png"), png(WIDTH, HEIGHT, 3, n)));
    let views = [(0, zip(&pictures(0))), (20, zip(&pictures(0))), (40, zip(&named)), (60, zip(&pictures(7)))];
    let send = async |pan: i32, zip: Vec<u8>| {
        let path = format!("/v1/stacks?rig=rig&lens=lens&scan=bee&tilt_deg=0&pan_deg={pan}");
        assert_eq!(app.post(&path).body(zip).send().await.unwrap().status(), 202);
    };
    let copies = async || {
        let table = scan(&app, "bee").await;
        let found = table["findings"].as_array().unwrap().iter().find(|f| f["code"] == "same_pictures").cloned();
        found.map(|finding| finding["views"].clone())
    };
    for (pan, zip) in views {
        send(pan, zip).await;
        if pan == 0 {
            assert_eq!(copies().await, None);
        }
    }
    // at once, by the zip
    assert_eq!(copies().await, Some(json!(["pan000_tilt00", "pan020_tilt00"])));
    for slices in [[3.0, 5.0], [3.0, 5.0], [3.0, 5.0], [4.0, 5.0]] {
        let slices = slices.map(|sharpness| SliceMetrics { sharpness: Some(sharpness), ..SliceMetrics::default() });
        app.finish_stack(&app.claim().await, |outcome| outcome.metrics.slices = slices.to_vec()).await;
    }
    let all = copies().await.expect("a finding");
    assert!(all.as_array().unwrap().contains(&json!("pan040_tilt00")), "{all}");
    assert!(!all.as_array().unwrap().contains(&json!("pan060_tilt00")), "{all}");
}
