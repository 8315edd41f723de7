//! A misspelt name of a scan is answered with the names that it may mean, by every call.

use serde_json::json;

use crate::app::{TestApp, problem, stack_zip};

#[tokio::test]
async fn every_call_suggests_the_scan_that_was_meant() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee-42").await;
    // the scan "bee42", purpose "scan"
    let upload = app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", 100);
    let upload = upload.header("upload-metadata", "scan YmVlNDI=,purpose c2Nhbg==");
    for request in [
        app.get("/v1/scans/bee42"),
        app.get("/v1/scans/Bee-42"),
        app.delete("/v1/scans/bee42"),
        app.delete("/v1/scans/bee42?stacks=delete"),
        app.get("/v1/scans/bee42/views.csv"),
        app.get("/v1/scans/bee42/bundle?layout=colmap"),
        app.post("/v1/scans/bee42/rerun").json(&json!({})),
        app.post("/v1/scans/bee42/poses").body("name,x,y,z\na,1,0,0\n"),
        app.post("/v1/scans/bee42/archive").body(stack_zip(2, 2)),
        app.post("/v1/stacks?rig=rig&lens=lens&scan=bee42").body(stack_zip(2, 2)),
        upload,
    ] {
        let told = problem(request.send().await.unwrap(), 404, "scan_not_found").await;
        let detail = told["detail"].as_str().unwrap();
        assert!(detail.starts_with("there is no scan '") && detail.contains("(there is 'bee-42')"), "{detail}");
        assert!(detail.contains("create it with PUT /v1/scans/") && detail.ends_with("correct the name"), "{detail}");
    }
    assert!(app.jobs_with_blobs().await.is_empty());
}

#[tokio::test]
async fn a_name_that_no_scan_can_have_is_refused_with_the_rule() {
    let app = TestApp::start().await;
    let too_long = "b".repeat(65);
    for name in [".bee", "bee%20one", "b%C3%A4r", too_long.as_str()] {
        let body = json!({ "rig": "rig", "lens": "lens" });
        let answer = app.put(&format!("/v1/scans/{name}")).json(&body).send().await.unwrap();
        let told = problem(answer, 400, "invalid_request").await;
        let detail = told["detail"].as_str().unwrap();
        assert!(detail.contains("64") && detail.contains("A-Z a-z 0-9"), "{detail}");
    }
}
