//! Resumable uploads: tus 1.0.0.

pub mod client;
mod interruptions;
mod refusals;

use pinstack::store::blobs::upload_key;
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::app::{TestApp, problem, stack_zip, zip};
use client::*;

#[tokio::test]
async fn the_capabilities_of_uploads_are_listed() {
    let app = TestApp::start_with(|policy| (policy.max_upload_bytes, policy.max_scan_bytes) = (12_345, 23_456)).await;
    let answer = app.client.request(Method::OPTIONS, format!("{}/v1/uploads", app.base)).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::NO_CONTENT);
    assert_eq!((header(&answer, "tus-version"), header(&answer, "tus-resumable")), ("1.0.0", "1.0.0"));
    // clients refuse to send more than this, and the zip of a scan may be larger than that of a stack
    assert_eq!(header(&answer, "tus-max-size"), "23456");
    assert_eq!(header(&answer, "tus-checksum-algorithm"), "sha1,sha256");
    for extension in ["creation", "creation-with-upload", "checksum", "termination", "expiration"] {
        assert!(header(&answer, "tus-extension").split(',').any(|known| known == extension), "{extension}");
    }
}

#[tokio::test]
async fn a_zip_in_pieces_becomes_a_stack_like_one_in_a_single_request() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 2);
    let url = begun(&app, zip.len()).await;
    let (a, b) = (zip.len() / 3, zip.len() / 2);
    for (from, to) in [(0, a), (a, b)] {
        let answer = piece(&app, &url, from, &zip[from..to]).send().await.unwrap();
        assert_eq!((answer.status(), offset(&answer)), (StatusCode::NO_CONTENT, to));
        assert!(header(&answer, "upload-expires").ends_with("GMT") && header(&answer, "pinstack-job").is_empty());
    }
    let answer = head(&app, &url).await;
    assert_eq!((offset(&answer), header(&answer, "upload-length")), (b, zip.len().to_string().as_str()));
    assert_eq!((header(&answer, "cache-control"), header(&answer, "upload-metadata")), ("no-store", of_rig().as_str()));
    let waiting = shown(&app, &url).await;
    assert_eq!(
        (&waiting["state"], &waiting["offset"], &waiting["job"]),
        (&json!("receiving"), &json!(b), &Value::Null)
    );

    let last = piece(&app, &url, b, &zip[b..]).send().await.unwrap();
    assert_eq!((last.status(), offset(&last)), (StatusCode::NO_CONTENT, zip.len()));
    let job = header(&last, "pinstack-job").to_owned();
    assert_eq!(job, format!("/v1/stacks/{}", id_of(&url)));
    let stack = shown(&app, &job).await;
    assert_eq!((&stack["state"], &stack["options"]["r1"]), (&json!("queued"), &json!(20)));
    let sha256: String = Sha256::digest(&zip).iter().map(|b| format!("{b:02x}")).collect();
    assert_eq!(
        stack["upload"],
        json!({ "bytes": zip.len(), "sha256": sha256, "filename": "bee 01.zip", "removed": false })
    );
    assert_eq!(app.blob(&upload_key(id_of(&url))).await.unwrap(), zip);
    assert!(app.store.parts.list().await.unwrap().is_empty(), "nothing is left of the pieces");

    // a client that missed the response asks again in any way
    let again = head(&app, &url).await;
    assert_eq!((offset(&again), header(&again, "pinstack-job")), (zip.len(), job.as_str()));
    let again = piece(&app, &url, zip.len(), b"").send().await.unwrap();
    assert_eq!((again.status(), header(&again, "pinstack-job")), (StatusCode::NO_CONTENT, job.as_str()));
    let complete = shown(&app, &url).await;
    assert_eq!((&complete["state"], &complete["job"]), (&json!("complete"), &json!(job)));
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 1);
    let ended = app.claim().await;
    app.finish(&ended).await;
    assert_eq!(shown(&app, &job).await["state"], "succeeded");
}

#[tokio::test]
async fn the_first_bytes_may_be_sent_with_the_creation() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let create =
        |bytes: &[u8]| creation(&app, zip.len(), &of_rig()).header("content-type", PIECE).body(bytes.to_vec()).send();
    let begun = create(&zip[..100]).await.unwrap();
    assert_eq!((begun.status(), offset(&begun)), (StatusCode::CREATED, 100));
    let url = header(&begun, "location").to_owned();
    let last = piece(&app, &url, 100, &zip[100..]).send().await.unwrap();
    assert!(header(&last, "pinstack-job").starts_with("/v1/stacks/"));
    let whole = create(&zip).await.unwrap();
    assert_eq!((whole.status(), offset(&whole)), (StatusCode::CREATED, zip.len()));
    assert!(header(&whole, "pinstack-job").starts_with("/v1/stacks/"));
    let form = creation(&app, zip.len(), &of_rig()).header("content-type", "text/plain").body("x");
    problem(form.send().await.unwrap(), 415, "unsupported_media_type").await;
}

#[tokio::test]
async fn a_dot_target_in_pieces_becomes_a_calibration() {
    let app = TestApp::start().await;
    let zip = stack_zip(3, 0);
    let text = metadata(&[
        ("rig", "new"),
        ("lens", "lens"),
        ("purpose", "calibration"),
        ("options", r#"{"reference_index": 2}"#),
    ]);
    let answer = creation(&app, zip.len(), &text).header("content-type", PIECE).body(zip.clone()).send().await.unwrap();
    let calibration = shown(&app, header(&answer, "pinstack-job")).await;
    assert!(header(&answer, "pinstack-job").starts_with("/v1/calibrations/"));
    assert_eq!((&calibration["rig"], &calibration["options"]["reference_index"]), (&json!("new"), &json!(2)));
}

#[tokio::test]
async fn deleting_an_upload_keeps_its_job() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    piece(&app, &url, 0, &[1; 10]).send().await.unwrap();
    assert_eq!(app.store.parts.list().await.unwrap(), [id_of(&url)]);
    assert_eq!(request(&app, Method::DELETE, &url).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    assert!(app.store.parts.list().await.unwrap().is_empty());
    problem(app.get(&url).send().await.unwrap(), 404, "not_found").await;
    problem(request(&app, Method::DELETE, &url).send().await.unwrap(), 404, "not_found").await;

    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    let job = header(&piece(&app, &url, 0, &zip).send().await.unwrap(), "pinstack-job").to_owned();
    request(&app, Method::DELETE, &url).send().await.unwrap();
    assert_eq!(shown(&app, &job).await["state"], "queued");
    assert!(app.blob(&upload_key(id_of(&url))).await.is_some());
}

#[tokio::test]
async fn a_client_behind_a_restrictive_proxy_sends_the_method_in_a_header() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let post = |method: &'static str| {
        let post = request(&app, Method::POST, &url).header("upload-offset", "0").header("content-type", PIECE);
        post.header("x-http-method-override", method).body("0123456789").send()
    };
    let answer = post("PATCH").await.unwrap();
    assert_eq!((answer.status(), offset(&answer)), (StatusCode::NO_CONTENT, 10));
    problem(post("PUT").await.unwrap(), 405, "method_not_allowed").await;
    assert_eq!(post("DELETE").await.unwrap().status(), StatusCode::NO_CONTENT);
    assert_eq!(head(&app, &url).await.status(), StatusCode::NOT_FOUND);
}
