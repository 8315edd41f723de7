//! Names are grouped into views before anything is sent.

use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::app::{TestApp, problem};

async fn group(app: &TestApp, query: &str, body: Value) -> reqwest::Response {
    app.post(&format!("/v1/groupings{query}")).json(&body).send().await.unwrap()
}

#[tokio::test]
async fn names_are_grouped_without_an_upload() {
    let app = TestApp::start().await;
    let names = json!([
        "RAW/_x_00010_y_00000_step_00000_.jpg",
        "RAW/_x_00010_y_00000_step_-00400_.jpg",
        "RAW/_x_00010_y_00100_step_00000_.jpg",
        "RAW/_x_00010_y_00100_step_-00400_.jpg",
        "RAW/log.txt",
    ]);
    let shown = group(&app, "?x_degrees_per_unit=0.5&y_degrees_per_unit=0.1", json!({ "names": names })).await;
    assert_eq!(shown.status(), StatusCode::OK);
    let shown: Value = shown.json().await.unwrap();
    let view = &shown["views"][1];
    assert_eq!((&view["tilt_deg"], &view["pan_deg"], &view["problem"]), (&json!(5.0), &json!(10.0), &Value::Null));
    assert_eq!(view["front"], json!([names[3], names[2]]), "by the sign of the focus step");
    assert_eq!(shown["ignored"][0]["name"], names[4]);
    let list: Value = app.get("/v1/stacks").send().await.unwrap().json().await.unwrap();
    assert_eq!(list["items"], json!([]), "nothing is made");
}

#[tokio::test]
async fn what_cannot_be_grouped_is_told() {
    let app = TestApp::start().await;
    let names = json!({ "names": ["a/1.jpg", "A/1.JPG"] });
    let told = problem(group(&app, "", names).await, 422, "invalid_archive").await;
    assert!(told["detail"].as_str().unwrap().contains("a/1.jpg"), "{told}");
    let told = problem(group(&app, "", json!({ "names": [1] })).await, 400, "invalid_request").await;
    assert_eq!(told["errors"][0]["pointer"], "/names/0");
    problem(group(&app, "?x=pan&y=pan", json!({ "names": [] })).await, 400, "invalid_request").await;
    problem(group(&app, "", json!({ "names": vec!["x".repeat(1000); 5000] })).await, 413, "upload_too_large").await;
    let many = group(&app, "", json!({ "names": vec!["a"; 70_000] })).await;
    problem(many, 400, "invalid_request").await;
}
