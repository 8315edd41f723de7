//! Planning a capture, and printable targets.

use reqwest::StatusCode;
use serde_json::Value;

use crate::app::{TestApp, problem};

const LENS: &str = "focal_mm=65&f_number=5.6&magnification=1&pixel_pitch_um=4.14&object_depth_mm=5&mode=fixed_lens";

#[tokio::test]
async fn a_plan_lists_the_rail_position_of_every_slice() {
    let app = TestApp::start().await;
    let answer = app.get(&format!("/v1/optics/plan?{LENS}&image_width=8688&image_height=5792")).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let plan: Value = answer.json().await.unwrap();
    let count = plan["slice_count"].as_u64().unwrap() as usize;
    assert_eq!(plan["rail_positions_mm"].as_array().unwrap().len(), count);
    assert_eq!(plan["slices"].as_array().unwrap().len(), count);
    assert_eq!(plan["warnings"], serde_json::json!([]));
    let share = |depth: f64| 1.0 - plan["largest_step_mm"].as_f64().unwrap() / depth;
    // with a fixed lens the slice with the smallest depth decides
    assert!((share(plan["depth_of_focus_mm"]["total"].as_f64().unwrap()) - 0.5).abs() < 0.08, "{plan}");
    assert!((plan["contrast_between_slices"].as_f64().unwrap() - 0.8).abs() < 0.02, "{plan}");
    let page = app.get(&format!("/plan?{LENS}")).send().await.unwrap().text().await.unwrap();
    assert!(page.contains("Contrast between slices"), "{page}");
    for (query, parameter) in [
        (LENS.replace("f_number=5.6", "f_number=0"), "f_number"),
        (LENS.replace("&mode=fixed_lens", "&mode=flying"), "mode"),
        (LENS.replace("object_depth_mm=5", "object_depth_mm=500"), "object_depth_mm"),
        (format!("{LENS}&lens=mpe65"), "lens"),
    ] {
        let answer = app.get(&format!("/v1/optics/plan?{query}")).send().await.unwrap();
        let refused = problem(answer, 400, "invalid_request").await;
        assert_eq!(refused["errors"][0]["pointer"], parameter, "{refused}");
    }
    problem(app.get("/v1/optics/plan").send().await.unwrap(), 400, "invalid_request").await;
}

#[tokio::test]
async fn the_advice_leads_to_a_target_that_can_be_printed() {
    let app = TestApp::start().await;
    let query = format!("/v1/targets/advice?{LENS}&image_width=8688&image_height=5792");
    let advice: Value = app.get(&query).send().await.unwrap().json().await.unwrap();
    let target = app.get(advice["target"].as_str().unwrap()).send().await.unwrap();
    assert_eq!(
        (target.status(), &target.headers()["content-type"]),
        (StatusCode::OK, &"application/pdf".parse().unwrap())
    );
    assert!(target.bytes().await.unwrap().starts_with(b"%PDF-"));
    let svg = app.get("/v1/targets/dots?pitch_mm=2&columns=14&rows=10&coded=true&format=svg").send().await.unwrap();
    assert_eq!(svg.headers()["content-type"], "image/svg+xml");
    assert_eq!(svg.headers()["content-disposition"], "inline; filename=\"dots_14x10_2mm.svg\"");
    assert_eq!(svg.text().await.unwrap().matches("<circle").count(), 140);
    let wide = app.get("/v1/targets/dots?pitch_mm=10&columns=100&rows=10").send().await.unwrap();
    let refused = problem(wide, 400, "invalid_request").await;
    assert!(refused["detail"].as_str().unwrap().contains("do not fit on the page"), "{refused}");
}
