use reqwest::{Response, StatusCode};
use serde_json::{Value, json};

use crate::app::{TestApp, problem, stack_zip};

const BOUNDARY: &str = "xxBOUNDARYxx";

/// A form as a browser sends it.
async fn send(app: &TestApp, url: &str, parts: &[(&str, &[u8])]) -> Response {
    let mut body = Vec::new();
    for (name, value) in parts {
        let file = match *name {
            "stack" => "; filename=\"night 1.zip\"",
            "front" => "; filename=\"a.jpg\"",
            _ => "",
        };
        body.extend_from_slice(
            format!("--{BOUNDARY}\r\ncontent-disposition: form-data; name=\"{name}\"{file}\r\n\r\n").as_bytes(),
        );
        body.extend_from_slice(value);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{BOUNDARY}--\r\n").as_bytes());
    let kind = format!("multipart/form-data; boundary={BOUNDARY}");
    app.post(url).header("content-type", kind).body(body).send().await.unwrap()
}

#[tokio::test]
async fn the_parts_of_a_form_come_in_any_order() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let options = json!({ "r1": 20, "bit_depth": 8, "label": "bee" }).to_string();
    let mut parts: Vec<(&str, &[u8])> =
        vec![("rig", b"rig"), ("lens", b"lens"), ("options", options.as_bytes()), ("stack", &zip)];
    for _ in 0..4 {
        parts.rotate_left(1);
        let answer = send(&app, "/v1/stacks", &parts).await;
        assert_eq!(answer.status(), StatusCode::ACCEPTED);
        let stack: Value = answer.json().await.unwrap();
        assert_eq!((&stack["options"]["r1"], &stack["options"]["bit_depth"]), (&json!(20), &json!("8")));
        assert_eq!(stack["upload"]["filename"], "night 1.zip");
        assert_eq!(stack["upload"]["bytes"].as_u64(), Some(zip.len() as u64));
    }
}

#[tokio::test]
async fn what_is_wrong_in_a_form_is_told() {
    let app = TestApp::start().await;
    let zip = stack_zip(2, 0);
    let with =
        |options: &'static [u8]| [("rig", &b"rig"[..]), ("lens", b"lens"), ("options", options), ("stack", &zip)];
    problem(send(&app, "/v1/stacks", &with(b"{}")).await, 404, "profile_not_found").await;
    app.with_profile(2).await;
    let told = problem(send(&app, "/v1/stacks", &with(b"{\"r1\": \"many\"}")).await, 400, "invalid_request").await;
    assert_eq!(told["errors"][0]["pointer"], "/r1");
    problem(send(&app, "/v1/stacks", &with(b"{\"radius\": 1}")).await, 400, "invalid_request").await;
    problem(send(&app, "/v1/stacks?r1=3", &with(b"{}")).await, 400, "invalid_request").await;
    problem(send(&app, "/v1/stacks", &[("rig", b"rig"), ("lens", b"lens")]).await, 400, "invalid_request").await;
    problem(send(&app, "/v1/stacks", &[("stack", &zip)]).await, 400, "invalid_request").await;
    for url in ["/v1/stacks?rig=rig", "/v1/stacks?rig=rig&lens=lens"] {
        let told = problem(send(&app, url, &with(b"{}")).await, 400, "invalid_request").await;
        assert!(told["detail"].as_str().unwrap().contains("'rig' is given twice"), "{told}");
    }
    let calibrations = "/v1/profiles/rig/lens/calibrations";
    problem(send(&app, calibrations, &[("rig", b"other"), ("stack", &zip)]).await, 400, "invalid_request").await;
    assert_eq!(app.spooled(), 0);
    assert_eq!(app.rows.counts().await.unwrap().queued, 0);
}

#[tokio::test]
async fn loose_pictures_in_a_form_hear_where_the_zip_goes() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let parts: [(&str, &[u8]); 4] =
        [("rig", b"rig"), ("lens", b"lens"), ("front", b"\xFF\xD8"), ("front", b"\xFF\xD8")];
    let told = problem(send(&app, "/v1/stacks", &parts).await, 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("-F stack=@stack.zip"), "{told}");
}
