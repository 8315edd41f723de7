//! Text that is not UTF-8 is refused by its name, and never stored as other text.

use reqwest::{RequestBuilder, StatusCode, header::HeaderValue};
use serde_json::Value;

use crate::app::{TestApp, problem, stack_zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

async fn refused(request: RequestBuilder, name: &str) {
    let told = problem(request.send().await.unwrap(), 400, "invalid_request").await;
    let detail = told["detail"].as_str().unwrap();
    assert!(detail.contains(name) && detail.contains("not UTF-8"), "{detail}");
}

#[tokio::test]
async fn a_parameter_that_is_not_utf8_is_refused_by_its_name() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    let calibrations = "/v1/profiles/rig/lens/calibrations";
    for (request, name) in [
        (app.post(&format!("{POST}&label=K%E4fer")).body(stack_zip(2, 0)), "the parameter 'label'"),
        (app.post(&format!("{POST}&scan=%ff")).body(stack_zip(2, 0)), "the parameter 'scan'"),
        (app.post(&format!("{calibrations}?note=%C3")).body(stack_zip(2, 0)), "the parameter 'note'"),
        (app.put(&format!("{POST}&label=a%80")).body(stack_zip(2, 0)), "the parameter 'label'"),
        (app.post("/v1/scans/bee/archive?x=%E4").body(stack_zip(2, 0)), "the parameter 'x'"),
        (app.post("/v1/poses?pair_from=%E4").body("a"), "the parameter 'pair_from'"),
        (app.get("/v1/stacks?rig=K%E4fer"), "the parameter 'rig'"),
        (app.get("/v1/profiles?lens=%E4"), "the parameter 'lens'"),
        (app.get("/v1/scans?cursor=%E4"), "the parameter 'cursor'"),
        (app.get("/v1/optics/plan?%E4=1"), "the parameter '%E4'"),
    ] {
        refused(request, name).await;
    }
    let list: Value = app.get("/v1/stacks").send().await.unwrap().json().await.unwrap();
    assert_eq!(list["items"].as_array().unwrap().len(), 0);
    // what is UTF-8 arrives as it was meant
    let stack = app.post(&format!("{POST}&label=K%C3%A4fer+%2B+1%25&")).body(stack_zip(2, 0)).send().await.unwrap();
    assert_eq!(stack.status(), StatusCode::ACCEPTED);
    assert_eq!(stack.json::<Value>().await.unwrap()["options"]["label"], "Käfer + 1%");
}

#[tokio::test]
async fn a_file_name_that_is_not_utf8_is_refused_by_its_parameter() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let named = |name: &[u8]| {
        let value = HeaderValue::from_bytes(&[b"attachment; ", name].concat()).unwrap();
        app.post(POST).header("content-disposition", value).body(stack_zip(2, 0))
    };
    refused(named(b"filename*=UTF-8''K%E4fer.zip"), "filename*").await;
    refused(named(b"filename=\"K\xe4fer.zip\""), "filename").await;
    let form = |name: &[u8]| {
        let head = [b"--B\r\nContent-Disposition: form-data; name=\"stack\"; ", name, b"\r\n\r\n"].concat();
        let body = [head, stack_zip(2, 0), b"\r\n--B--\r\n".to_vec()].concat();
        app.post(POST).header("content-type", "multipart/form-data; boundary=B").body(body)
    };
    refused(form(b"filename*=UTF-8''K%E4fer.zip"), "filename*").await;
    refused(form(b"filename=\"K\xe4fer.zip\""), "filename").await;
    for request in [named(b"filename*=UTF-8''K%C3%A4fer.zip"), form("filename=\"Käfer.zip\"".as_bytes())] {
        let stack: Value = request.send().await.unwrap().json().await.unwrap();
        assert_eq!(stack["upload"]["filename"], "Käfer.zip", "{stack}");
    }
}
