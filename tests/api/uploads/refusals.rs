//! Uploads that are refused, at their creation or later.

use std::time::Duration;

use base64::{Engine, prelude::BASE64_STANDARD};
use pinstack::store::uploads::{NewUpload, OpenUploadLimits};
use reqwest::RequestBuilder;
use uuid::Uuid;

use super::*;

#[tokio::test]
async fn an_invalid_upload_is_refused_at_its_creation() {
    let app = TestApp::start_with(|policy| policy.max_upload_bytes = 100_000).await;
    problem(creation(&app, 1000, &of_rig()).send().await.unwrap(), 404, "profile_not_found").await;
    app.with_profile(2).await;
    for (text, told) in [
        (metadata(&[("lens", "lens")]), "the rig is missing"),
        (metadata(&[("rig", "rig"), ("lens", "lens"), ("options", r#"{"r1": 0}"#)]), "r1 must be 1 to 200"),
        (metadata(&[("rig", "rig"), ("lens", "lens"), ("options", "{")]), "options"),
        (metadata(&[("rig", "rig"), ("lens", "lens"), ("purpose", "lunch")]), "stack, calibration or scan"),
        ("rig !!!".to_owned(), "base64"),
    ] {
        let refused = problem(creation(&app, 1000, &text).send().await.unwrap(), 400, "invalid_request").await;
        assert!(refused["detail"].as_str().unwrap().contains(told), "{refused}");
    }
    problem(creation(&app, 0, &of_rig()).send().await.unwrap(), 400, "invalid_request").await;
    problem(creation(&app, 100_001, &of_rig()).send().await.unwrap(), 413, "upload_too_large").await;
    let deferred = request(&app, Method::POST, "/v1/uploads").header("upload-defer-length", "1");
    problem(deferred.send().await.unwrap(), 400, "invalid_request").await;
    // a part of a parallel upload, as tus-js-client sends it, and the request that joins the parts
    let parts = [
        request(&app, Method::POST, "/v1/uploads").header("upload-length", "10").header("upload-concat", "partial"),
        creation(&app, 10, &of_rig()).header("upload-concat", "partial"),
        request(&app, Method::POST, "/v1/uploads").header("upload-concat", "final;/v1/uploads/a /v1/uploads/b"),
    ];
    for part in parts {
        let refused = problem(part.send().await.unwrap(), 400, "invalid_request").await;
        let detail = refused["detail"].as_str().unwrap();
        assert!(detail.contains("Upload-Concat") && detail.contains("switch off parallel uploads"), "{detail}");
    }
    let unversioned = app.post("/v1/uploads").header("upload-length", "10").send().await.unwrap();
    assert_eq!(header(&unversioned, "tus-version"), "1.0.0");
    problem(unversioned, 412, "precondition_failed").await;
    assert_eq!(app.store.metadata.reserved_bytes().await.unwrap(), 0);
}

/// `POST /v1/uploads` with a body.
fn creation_with(app: &TestApp, length: usize, body: impl Into<reqwest::Body>) -> RequestBuilder {
    creation(app, length, &of_rig()).header("content-type", PIECE).body(body)
}

/// The number of open uploads, which count against limits and quotas.
async fn open_uploads(app: &TestApp) -> usize {
    shown(app, "/v1/uploads").await["items"].as_array().unwrap().len()
}

#[tokio::test]
async fn a_first_body_beyond_the_length_leaves_no_upload() {
    let app = TestApp::start_with(|policy| policy.queue_limit = 1).await;
    app.with_profile(2).await;
    let chunks = |chunks: &[&[u8]]| {
        let chunks: Vec<_> = chunks.iter().map(|chunk| Ok::<_, std::io::Error>(chunk.to_vec())).collect();
        reqwest::Body::wrap_stream(futures::stream::iter(chunks))
    };
    for body in [reqwest::Body::from(vec![7; 20]), chunks(&[&[7; 20]]), chunks(&[&[7; 8], &[7; 8]])] {
        let refused = creation_with(&app, 10, body).send().await.unwrap();
        assert!(!refused.headers().contains_key("location"), "there is nothing to continue");
        problem(refused, 413, "upload_too_large").await;
        assert_eq!(open_uploads(&app).await, 0);
        assert_eq!(app.store.metadata.reserved_bytes().await.unwrap(), 0);
        assert!(app.store.parts.list().await.unwrap().is_empty());
    }
    begun(&app, 1000).await;
}

#[tokio::test]
async fn an_upload_whose_first_body_is_refused_can_be_continued() {
    let app = TestApp::start_with(|policy| policy.body_idle_timeout = Duration::from_millis(50)).await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let wrong = format!("sha1 {}", BASE64_STANDARD.encode([7; 20]));
    let mismatch = creation_with(&app, zip.len(), zip.clone()).header("upload-checksum", wrong).send().await.unwrap();
    let silent = futures::StreamExt::chain(
        futures::stream::iter([Ok::<_, std::io::Error>(zip[..200].to_vec())]),
        futures::stream::pending(),
    );
    let stalled = creation_with(&app, zip.len(), reqwest::Body::wrap_stream(silent)).send().await.unwrap();
    for (refused, at, status, code) in
        [(mismatch, 0, 460, "checksum_mismatch"), (stalled, 200, 400, "upload_incomplete")]
    {
        let url = header(&refused, "location").to_owned();
        assert_eq!((offset(&refused), header(&refused, "tus-resumable")), (at, "1.0.0"));
        problem(refused, status, code).await;
        assert_eq!(offset(&head(&app, &url).await), at);
        let last = piece(&app, &url, at, &zip[at..]).send().await.unwrap();
        assert_eq!(header(&last, "pinstack-job"), format!("/v1/stacks/{}", id_of(&url)));
    }
    assert_eq!(open_uploads(&app).await, 0);
}

#[tokio::test]
async fn a_zip_that_is_refused_at_its_creation_names_the_upload_with_the_reason() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = zip(&[("a.png".into(), b"no picture".to_vec()), ("b.png".into(), b"no picture".to_vec())]);
    let refused = creation_with(&app, zip.len(), zip.clone()).send().await.unwrap();
    let url = header(&refused, "location").to_owned();
    assert_eq!(offset(&refused), zip.len());
    problem(refused, 422, "invalid_image").await;
    let told = shown(&app, &url).await;
    assert_eq!((&told["state"], &told["error"]["code"]), (&json!("refused"), &json!("invalid_image")));
    assert_eq!(open_uploads(&app).await, 0);
}

#[tokio::test]
async fn the_number_of_open_uploads_is_limited_and_a_full_disk_refuses_one() {
    let app = TestApp::start_with(|policy| policy.queue_limit = 2).await;
    app.with_profile(2).await;
    begun(&app, 4_000_000).await;
    let second = begun(&app, 1_000_000).await;
    assert_eq!(app.store.metadata.reserved_bytes().await.unwrap(), 5_000_000);
    problem(creation(&app, 10, &of_rig()).send().await.unwrap(), 503, "queue_full").await;
    request(&app, Method::DELETE, &second).send().await.unwrap();
    begun(&app, 10).await;
    assert_eq!(app.store.metadata.reserved_bytes().await.unwrap(), 4_000_010);

    let full = TestApp::start_with(|policy| policy.min_free_bytes = 1 << 60).await;
    full.with_profile(2).await;
    let told = problem(creation(&full, 1000, &of_rig()).send().await.unwrap(), 507, "insufficient_storage").await;
    assert!(told["detail"].as_str().unwrap().contains(&(1_u64 << 60).to_string()), "{told}");
}

#[tokio::test]
async fn an_invalid_patch_is_refused_and_changes_nothing() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    piece(&app, &url, 0, &zip[..50]).send().await.unwrap();
    let elsewhere = piece(&app, &url, 40, &zip[40..60]).send().await.unwrap();
    assert_eq!(offset(&elsewhere), 50);
    problem(elsewhere, 409, "conflict").await;
    let plain = request(&app, Method::PATCH, &url).header("upload-offset", "50").body("x");
    problem(plain.send().await.unwrap(), 415, "unsupported_media_type").await;
    let nowhere = request(&app, Method::PATCH, &url).header("content-type", PIECE).body("x");
    problem(nowhere.send().await.unwrap(), 400, "invalid_request").await;
    let long = vec![0; zip.len()];
    problem(piece(&app, &url, 50, &long).send().await.unwrap(), 413, "upload_too_large").await;
    let chunks = reqwest::Body::wrap_stream(futures::stream::iter([Ok::<_, std::io::Error>(long)]));
    let unannounced = request(&app, Method::PATCH, &url).header("upload-offset", "50").header("content-type", PIECE);
    problem(unannounced.body(chunks).send().await.unwrap(), 413, "upload_too_large").await;
    let unversioned = app.client.patch(format!("{}{url}", app.base)).header("upload-offset", "50");
    problem(unversioned.send().await.unwrap(), 412, "precondition_failed").await;
    let unknown = format!("/v1/uploads/{}", Uuid::now_v7());
    problem(piece(&app, &unknown, 0, b"x").send().await.unwrap(), 404, "not_found").await;
    problem(app.get("/v1/uploads/7").send().await.unwrap(), 404, "not_found").await;
    assert_eq!(offset(&head(&app, &url).await), 50);
    let last = piece(&app, &url, 50, &zip[50..]).send().await.unwrap();
    assert!(header(&last, "pinstack-job").starts_with("/v1/stacks/"));
}

#[tokio::test]
async fn a_body_with_a_wrong_checksum_is_not_stored() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    let with = |checksum: String| piece(&app, &url, 0, &zip).header("upload-checksum", checksum).send();
    let right = format!("sha256 {}", BASE64_STANDARD.encode(Sha256::digest(&zip)));
    let wrong = format!("sha1 {}", BASE64_STANDARD.encode([7; 20]));
    problem(with(wrong).await.unwrap(), 460, "checksum_mismatch").await;
    problem(with("crc32 AAAAAA==".into()).await.unwrap(), 400, "invalid_request").await;
    problem(with("sha1 AAAA".into()).await.unwrap(), 400, "invalid_request").await;
    assert_eq!(offset(&head(&app, &url).await), 0);
    let answer = with(right).await.unwrap();
    assert_eq!((answer.status(), offset(&answer)), (StatusCode::NO_CONTENT, zip.len()));
    assert!(header(&answer, "pinstack-job").starts_with("/v1/stacks/"));
}

#[tokio::test]
async fn a_zip_that_is_refused_at_its_end_is_deleted_and_the_reason_kept() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = zip(&[("a.png".into(), b"no picture".to_vec()), ("b.png".into(), b"no picture".to_vec())]);
    let url = begun(&app, zip.len()).await;
    problem(piece(&app, &url, 0, &zip).send().await.unwrap(), 422, "invalid_image").await;
    let told = shown(&app, &url).await;
    assert_eq!((&told["state"], &told["error"]["code"]), (&json!("refused"), &json!("invalid_image")));
    assert_eq!(head(&app, &url).await.status(), StatusCode::UNPROCESSABLE_ENTITY);
    problem(piece(&app, &url, zip.len(), b"").send().await.unwrap(), 422, "invalid_image").await;
    assert!(app.store.parts.list().await.unwrap().is_empty());
    assert!(app.jobs_with_blobs().await.is_empty());
    assert_eq!(app.store.metadata.reserved_bytes().await.unwrap(), 0);
}

/// Written by another version of the service, or damaged.
#[tokio::test]
async fn an_upload_with_unreadable_metadata_is_omitted_from_the_list() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let unreadable = NewUpload {
        id: Uuid::now_v7(),
        length: 1000,
        digest: Vec::new(),
        metadata: "rig !!!".to_owned(),
        keep: Duration::from_secs(60),
        owner: None,
    };
    let limits = OpenUploadLimits { all: 10, of_owner: 10 };
    app.store.metadata.create_upload(&unreadable, limits).await.unwrap();
    let list = shown(&app, "/v1/uploads").await;
    assert_eq!((list["items"].as_array().unwrap().len(), &list["items"][0]["id"]), (1, &json!(id_of(&url))));
    assert_eq!(list["skipped"][0]["id"], json!(unreadable.id), "{list}");
}
