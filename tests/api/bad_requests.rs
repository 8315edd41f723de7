//! The error responses of `POST /v1/stacks`.

use std::time::Duration;

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};

use crate::app::{HEIGHT, TestApp, WIDTH, png, problem, profile, stack_zip, zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// Checks that a refusal leaves nothing behind.
async fn refused(app: &TestApp, url: &str, body: Vec<u8>, status: u16, code: &str) -> String {
    let told = problem(app.post(url).body(body).send().await.unwrap(), status, code).await;
    assert_eq!(app.spooled(), 0, "{told}");
    assert!(app.jobs_with_blobs().await.is_empty(), "{told}");
    told["detail"].as_str().unwrap().to_owned()
}

#[tokio::test]
async fn an_upload_over_the_limit_is_refused_by_its_length_and_by_its_bytes() {
    let app = TestApp::start_with(|policy| policy.max_upload_bytes = 2000).await;
    app.with_profile(2).await;
    refused(&app, POST, vec![0; 2001], 413, "upload_too_large").await;
    let chunks = futures::stream::iter((0..30).map(|_| Ok::<_, std::io::Error>(vec![0_u8; 100])));
    let answer = app.post(POST).body(reqwest::Body::wrap_stream(chunks)).send().await.unwrap();
    problem(answer, 413, "upload_too_large").await;
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn a_full_disk_is_reported_with_figures() {
    let app = TestApp::start_with(|policy| policy.min_free_bytes = 1 << 60).await;
    app.with_profile(2).await;
    let detail = refused(&app, POST, stack_zip(2, 0), 507, "insufficient_storage").await;
    assert!(detail.contains(&(1_u64 << 60).to_string()), "{detail}");
}

#[tokio::test]
async fn a_stack_whose_job_exceeds_the_disk_is_refused_before_its_body() {
    let app = TestApp::start().await;
    let mut huge = profile(1000);
    huge["image_width"] = 60_000.into();
    huge["image_height"] = 60_000.into();
    let stored = app.put("/v1/profiles/rig/lens").json(&huge).send().await.unwrap();
    assert!(stored.status().is_success(), "{}", stored.text().await.unwrap());
    // 3.6 gigapixels of three bytes, a thousand times, as they lie in the scratch file
    let detail = refused(&app, POST, stack_zip(2, 0), 507, "insufficient_storage").await;
    assert!(detail.contains("its job up to 110"), "{detail}");
}

#[tokio::test]
async fn a_full_queue_says_when_to_retry() {
    let app = TestApp::start_with(|policy| policy.queue_limit = 1).await;
    app.with_stack("").await;
    let answer = app.post(POST).body(stack_zip(2, 0)).send().await.unwrap();
    assert!(answer.headers()["retry-after"].to_str().unwrap().parse::<u32>().unwrap() > 0);
    problem(answer, 503, "queue_full").await;
}

#[tokio::test]
async fn names_and_options_are_checked_before_the_profile_and_the_profile_before_the_body() {
    let app = TestApp::start().await;
    let zip = || stack_zip(2, 0);
    assert!(refused(&app, "/v1/stacks?lens=lens", zip(), 400, "invalid_request").await.contains("the rig is missing"));
    refused(&app, "/v1/stacks?rig=.rig&lens=lens", zip(), 400, "invalid_request").await;
    assert!(
        refused(&app, &format!("{POST}&r1=0"), zip(), 400, "invalid_request").await.contains("r1 must be 1 to 200")
    );
    assert!(
        refused(&app, &format!("{POST}&mask=yes"), zip(), 400, "invalid_request")
            .await
            .contains("auto, none, required")
    );
    assert!(refused(&app, &format!("{POST}&radius=3"), zip(), 400, "invalid_request").await.contains("'radius'"));
    refused(&app, POST, zip(), 404, "profile_not_found").await;
    app.with_profile(2).await;
    let detail = refused(&app, &format!("{POST}&profile_revision=7"), zip(), 404, "profile_not_found").await;
    assert!(detail.contains("revision 7"), "{detail}");
    assert!(refused(&app, &format!("{POST}&crop=20,0,10,10"), zip(), 400, "invalid_request").await.contains("24 x 18"));
}

#[tokio::test]
async fn a_client_that_waits_for_100_continue_is_refused_before_it_sends() {
    let app = TestApp::start().await;
    let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    let head = format!(
        "POST {POST} HTTP/1.1\r\nhost: localhost\r\nexpect: 100-continue\r\ncontent-type: application/zip\r\ncontent-length: 1000000\r\n\r\n"
    );
    socket.write_all(head.as_bytes()).await.unwrap();
    let mut answer = vec![0; 12];
    socket.read_exact(&mut answer).await.unwrap();
    assert_eq!(String::from_utf8_lossy(&answer), "HTTP/1.1 404");
}

#[tokio::test]
async fn an_upload_that_stalls_times_out() {
    let app = TestApp::start_with(|policy| policy.body_idle_timeout = Duration::from_millis(50)).await;
    app.with_profile(2).await;
    let silent = futures::StreamExt::chain(
        futures::stream::iter([Ok::<_, std::io::Error>(vec![0_u8; 100])]),
        futures::stream::pending(),
    );
    let answer = app.post(POST).body(reqwest::Body::wrap_stream(silent)).send().await.unwrap();
    problem(answer, 400, "upload_incomplete").await;
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn a_body_that_is_not_a_zip_is_refused_by_type_and_by_content() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let picture = app.post(POST).header("content-type", "image/png").body(png(4, 4, 3, 0)).send().await.unwrap();
    problem(picture, 415, "unsupported_media_type").await;
    refused(&app, POST, png(4, 4, 3, 0), 422, "invalid_archive").await;
    refused(&app, POST, Vec::new(), 422, "invalid_archive").await;
    let mut torn = stack_zip(2, 0);
    torn.truncate(torn.len() / 2);
    refused(&app, POST, torn, 422, "invalid_archive").await;
    refused(&app, POST, zip(&[("../a.png".into(), png(4, 4, 3, 0))]), 422, "invalid_archive").await;
}

#[tokio::test]
async fn an_encoded_body_is_refused_with_the_coding() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let scan = || app.put("/v1/scans/a").body(r#"{"rig": "rig", "lens": "lens"}"#);
    let upload = || app.post("/v1/uploads").header("tus-resumable", "1.0.0").header("upload-length", 100);
    for request in [app.post(POST).body(stack_zip(2, 0)), scan(), upload()] {
        let answer = request.header("content-encoding", "gzip").send().await.unwrap();
        assert_eq!(answer.headers()["accept-encoding"], "identity");
        let told = problem(answer, 415, "unsupported_media_type").await;
        assert!(told["detail"].as_str().unwrap().contains("Content-Encoding: gzip"), "{told}");
    }
    assert_eq!(scan().header("content-encoding", "Identity").send().await.unwrap().status().as_u16(), 201);
    assert_eq!(app.get("/v1/scans/a").header("content-encoding", "gzip").send().await.unwrap().status().as_u16(), 200);
}

#[tokio::test]
async fn a_part_of_a_file_is_not_taken_for_the_file() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let (last, length) = (zip.len() - 1, zip.len());
    for range in [format!("bytes 100-{last}/{length}"), format!("bytes 0-99/{length}"), "bytes 0-44/*".into()] {
        let part = app.put(POST).header("content-range", &range).body(zip[100..].to_vec());
        let told = problem(part.send().await.unwrap(), 400, "invalid_request").await;
        let detail = told["detail"].as_str().unwrap();
        assert!(detail.contains(&range) && detail.contains("/v1/uploads"), "{detail}");
    }
    assert_eq!(app.spooled(), 0);
    let whole = app.put(POST).header("content-range", format!("bytes 0-{last}/{length}")).body(zip);
    assert_eq!(whole.send().await.unwrap().status().as_u16(), 202);
}

#[tokio::test]
async fn json_may_begin_with_a_byte_order_mark() {
    let app = TestApp::start().await;
    let text = format!("\u{feff}{}", profile(2));
    for (path, body) in [
        ("/v1/profiles/rig/lens", text.as_str()),
        (
            "/v1/profiles/rig/list?image_width=24&image_height=18&reference_index=0",
            "\u{feff}[[1,0,0,0,1,0,0,0,1],[1,0,0,0,1,0,0,0,1]]",
        ),
        ("/v1/scans/a", "\u{feff}{\"rig\": \"rig\", \"lens\": \"lens\"}"),
    ] {
        let stored =
            app.put(path).header("content-type", "application/json").body(body.to_owned()).send().await.unwrap();
        assert!(stored.status().is_success(), "{path}: {}", stored.text().await.unwrap());
    }
    let utf16: Vec<u8> = "\u{feff}{}".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let told = problem(app.put("/v1/scans/b").body(utf16).send().await.unwrap(), 400, "invalid_request").await;
    assert_eq!(told["detail"], "the body is UTF-16 text; save it as UTF-8");
}

#[tokio::test]
async fn too_many_members_are_refused() {
    let app = TestApp::start_with(|policy| policy.archive.max_members = 3).await;
    app.with_profile(4).await;
    refused(&app, POST, stack_zip(4, 0), 422, "archive_too_large").await;
}

#[tokio::test]
async fn a_slice_that_is_not_an_image_is_named() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let members = [("front/a.png".into(), png(WIDTH, HEIGHT, 3, 0)), ("front/b.png".into(), b"not a picture".to_vec())];
    let detail = refused(&app, POST, zip(&members), 422, "invalid_image").await;
    assert!(detail.contains("b.png"), "{detail}");
}

#[tokio::test]
async fn a_stack_that_does_not_match_the_profile_is_refused_with_both_numbers() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    let detail = refused(&app, POST, stack_zip(2, 0), 422, "slice_count_mismatch").await;
    assert!(detail.contains('2') && detail.contains('3') && detail.contains("revision 1"), "{detail}");
    refused(&app, POST, stack_zip(3, 2), 422, "slice_count_mismatch").await;
    let large: Vec<_> = (0..3).map(|i| (format!("{i}.png"), png(WIDTH * 2, HEIGHT, 3, i))).collect();
    let detail = refused(&app, POST, zip(&large), 422, "size_mismatch").await;
    assert!(detail.contains("48 x 18") && detail.contains("24 x 18"), "{detail}");
    refused(&app, &format!("{POST}&mask=required"), stack_zip(3, 0), 422, "mask_failed").await;
}

#[tokio::test]
async fn an_interrupted_upload_leaves_nothing() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    let head =
        format!("POST {POST} HTTP/1.1\r\nhost: localhost\r\nexpect: 100-continue\r\ncontent-length: 1000000\r\n\r\n");
    socket.write_all(head.as_bytes()).await.unwrap();
    let mut go_on = vec![0; "HTTP/1.1 100 Continue\r\n\r\n".len()];
    socket.read_exact(&mut go_on).await.unwrap();
    assert!(String::from_utf8_lossy(&go_on).starts_with("HTTP/1.1 100"));
    socket.write_all(&[0; 5000]).await.unwrap();
    // half closed: the server sees the end of the body and may still answer
    socket.shutdown().await.unwrap();
    let mut rest = Vec::new();
    socket.read_to_end(&mut rest).await.unwrap();
    let rest = String::from_utf8_lossy(&rest);
    assert!(rest.is_empty() || rest.contains("upload_incomplete"), "{rest}");
    assert_eq!(app.spooled(), 0);
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 0);
}
