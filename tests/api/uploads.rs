//! Resumable uploads: tus 1.0.0.

use std::time::Duration;

use base64::{Engine, prelude::BASE64_STANDARD};
use pinstack::store::{
    UploadRows,
    blobs::upload_key,
    sweep::{GRACE, Retention, sweep},
};
use reqwest::{Method, RequestBuilder, Response, StatusCode};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
};
use uuid::Uuid;

use crate::app::{TestApp, problem, stack_zip, zip};

const PIECE: &str = "application/offset+octet-stream";

fn metadata(pairs: &[(&str, &str)]) -> String {
    let encoded = pairs.iter().map(|(name, value)| format!("{name} {}", BASE64_STANDARD.encode(value)));
    encoded.collect::<Vec<_>>().join(",")
}

fn of_rig() -> String {
    metadata(&[("rig", "rig"), ("lens", "lens"), ("filename", "bee 01.zip"), ("options", r#"{"r1": 20}"#)])
}

fn request(app: &TestApp, method: Method, path: &str) -> RequestBuilder {
    app.client.request(method, format!("{}{path}", app.base)).header("tus-resumable", "1.0.0")
}

fn creation(app: &TestApp, length: usize, metadata: &str) -> RequestBuilder {
    request(app, Method::POST, "/v1/uploads").header("upload-length", length).header("upload-metadata", metadata)
}

/// Begins an upload of `length` bytes for the usual profile: its URL.
async fn begun(app: &TestApp, length: usize) -> String {
    let answer = creation(app, length, &of_rig()).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::CREATED);
    assert_eq!(answer.headers()["upload-offset"], "0");
    answer.headers()["location"].to_str().unwrap().to_owned()
}

fn piece(app: &TestApp, url: &str, offset: usize, bytes: &[u8]) -> RequestBuilder {
    request(app, Method::PATCH, url).header("upload-offset", offset).header("content-type", PIECE).body(bytes.to_vec())
}

async fn head(app: &TestApp, url: &str) -> Response {
    request(app, Method::HEAD, url).send().await.unwrap()
}

fn offset(answer: &Response) -> usize {
    answer.headers()["upload-offset"].to_str().unwrap().parse().unwrap()
}

fn header<'a>(answer: &'a Response, name: &str) -> &'a str {
    answer.headers().get(name).map(|value| value.to_str().unwrap()).unwrap_or_default()
}

fn id_of(url: &str) -> Uuid {
    url.rsplit('/').next().unwrap().parse().unwrap()
}

async fn shown(app: &TestApp, url: &str) -> Value {
    app.get(url).send().await.unwrap().json().await.unwrap()
}

/// A PATCH on a connection of its own: its head and the first bytes of its body are sent, the rest is not.
async fn hanging_piece(app: &TestApp, url: &str, length: usize, bytes: &[u8]) -> TcpStream {
    let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
    let head = format!(
        "PATCH {url} HTTP/1.1\r\nhost: x\r\ntus-resumable: 1.0.0\r\nupload-offset: 0\r\ncontent-type: {PIECE}\r\ncontent-length: {length}\r\n\r\n"
    );
    socket.write_all(head.as_bytes()).await.unwrap();
    socket.write_all(bytes).await.unwrap();
    socket.flush().await.unwrap();
    socket
}

async fn status_line(socket: &mut TcpStream) -> String {
    let mut told = vec![0; 12];
    socket.read_exact(&mut told).await.unwrap();
    String::from_utf8_lossy(&told).into_owned()
}

/// Waits until the server has written so many bytes; they need not be safe yet.
async fn until_written(app: &TestApp, url: &str, bytes: u64) {
    while app.partial_bytes(id_of(url)) < bytes {
        tokio::task::yield_now().await;
    }
}

#[tokio::test]
async fn what_uploads_can_do_is_told() {
    let app = TestApp::start_with(|policy| policy.max_upload_bytes = 12_345).await;
    let answer = app.client.request(Method::OPTIONS, format!("{}/v1/uploads", app.base)).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::NO_CONTENT);
    assert_eq!((header(&answer, "tus-version"), header(&answer, "tus-resumable")), ("1.0.0", "1.0.0"));
    assert_eq!(header(&answer, "tus-max-size"), "12345");
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
    assert_eq!(std::fs::read(app.blobs.local_path(&upload_key(id_of(&url))).await.unwrap().unwrap()).unwrap(), zip);
    assert!(app.blobs.partials().await.unwrap().is_empty(), "nothing is left of the pieces");

    // a client that did not hear the answer asks again, in any way
    let again = head(&app, &url).await;
    assert_eq!((offset(&again), header(&again, "pinstack-job")), (zip.len(), job.as_str()));
    let again = piece(&app, &url, zip.len(), b"").send().await.unwrap();
    assert_eq!((again.status(), header(&again, "pinstack-job")), (StatusCode::NO_CONTENT, job.as_str()));
    let complete = shown(&app, &url).await;
    assert_eq!((&complete["state"], &complete["job"]), (&json!("complete"), &json!(job)));
    assert_eq!(app.rows.counts().await.unwrap().queued, 1);
    let ended = app.claim().await;
    app.finish(&ended).await;
    assert_eq!(shown(&app, &job).await["state"], "succeeded");
}

#[tokio::test]
async fn the_first_piece_may_come_with_the_creation() {
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
async fn what_can_be_known_is_refused_at_the_creation() {
    let app = TestApp::start_with(|policy| policy.max_upload_bytes = 100_000).await;
    problem(creation(&app, 1000, &of_rig()).send().await.unwrap(), 404, "profile_not_found").await;
    app.with_profile(2).await;
    for (text, told) in [
        (metadata(&[("lens", "lens")]), "the rig is missing"),
        (metadata(&[("rig", "rig"), ("lens", "lens"), ("options", r#"{"r1": 0}"#)]), "r1 must be 1 to 200"),
        (metadata(&[("rig", "rig"), ("lens", "lens"), ("options", "{")]), "options"),
        (metadata(&[("rig", "rig"), ("lens", "lens"), ("purpose", "lunch")]), "stack or calibration"),
        ("rig !!!".to_owned(), "base64"),
    ] {
        let refused = problem(creation(&app, 1000, &text).send().await.unwrap(), 400, "invalid_request").await;
        assert!(refused["detail"].as_str().unwrap().contains(told), "{refused}");
    }
    problem(creation(&app, 0, &of_rig()).send().await.unwrap(), 400, "invalid_request").await;
    problem(creation(&app, 100_001, &of_rig()).send().await.unwrap(), 413, "upload_too_large").await;
    let deferred = request(&app, Method::POST, "/v1/uploads").header("upload-defer-length", "1");
    problem(deferred.send().await.unwrap(), 400, "invalid_request").await;
    let unversioned = app.post("/v1/uploads").header("upload-length", "10").send().await.unwrap();
    assert_eq!(header(&unversioned, "tus-version"), "1.0.0");
    problem(unversioned, 412, "precondition_failed").await;
    assert_eq!(app.rows.awaited_bytes().await.unwrap(), 0);
}

#[tokio::test]
async fn open_uploads_are_promised_their_room_and_are_not_endless() {
    let app = TestApp::start_with(|policy| policy.queue_limit = 2).await;
    app.with_profile(2).await;
    begun(&app, 4_000_000).await;
    let second = begun(&app, 1_000_000).await;
    assert_eq!(app.rows.awaited_bytes().await.unwrap(), 5_000_000);
    problem(creation(&app, 10, &of_rig()).send().await.unwrap(), 503, "queue_full").await;
    request(&app, Method::DELETE, &second).send().await.unwrap();
    begun(&app, 10).await;
    assert_eq!(app.rows.awaited_bytes().await.unwrap(), 4_000_010);

    let full = TestApp::start_with(|policy| policy.min_free_bytes = 1 << 60).await;
    full.with_profile(2).await;
    let told = problem(creation(&full, 1000, &of_rig()).send().await.unwrap(), 507, "insufficient_storage").await;
    assert!(told["detail"].as_str().unwrap().contains(&(1_u64 << 60).to_string()), "{told}");
}

#[tokio::test]
async fn a_piece_that_does_not_fit_is_refused_and_changes_nothing() {
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
async fn a_piece_with_a_wrong_checksum_is_not_kept() {
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
async fn what_arrived_before_a_connection_broke_is_kept() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    let socket = hanging_piece(&app, &url, zip.len(), &zip[..300]).await;
    until_written(&app, &url, 300).await;
    drop(socket);
    assert_eq!(offset(&head(&app, &url).await), 300);
    let last = piece(&app, &url, 300, &zip[300..]).send().await.unwrap();
    assert!(header(&last, "pinstack-job").starts_with("/v1/stacks/"));
}

#[tokio::test]
async fn a_new_request_takes_an_upload_over_from_one_that_hangs() {
    // never given up for its silence, and never asked for by the clock: only the newer request ends it
    let hour = Duration::from_secs(3600);
    let app = TestApp::start_with(|policy| (policy.body_idle_timeout, policy.poll_interval) = (hour, hour)).await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    let mut hanging = hanging_piece(&app, &url, zip.len(), &zip[..200]).await;
    until_written(&app, &url, 200).await;
    assert_eq!(offset(&head(&app, &url).await), 200);
    assert_eq!(status_line(&mut hanging).await, "HTTP/1.1 409");
    let last = piece(&app, &url, 200, &zip[200..]).send().await.unwrap();
    assert!(header(&last, "pinstack-job").starts_with("/v1/stacks/"));
}

#[tokio::test]
async fn a_request_to_another_process_takes_an_upload_over_too() {
    let quick = Duration::from_millis(5);
    let app = TestApp::start_with(|policy| policy.poll_interval = quick).await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let mut hanging = hanging_piece(&app, &url, 1000, &[1; 200]).await;
    until_written(&app, &url, 200).await;
    // its rows are not those that announce changes to this process
    app.rows_of_another_process().await.want_upload(id_of(&url)).await.unwrap();
    assert_eq!(status_line(&mut hanging).await, "HTTP/1.1 409");
    assert_eq!(offset(&head(&app, &url).await), 200);
}

#[tokio::test]
async fn a_zip_that_is_refused_at_the_end_is_gone_and_says_why() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let zip = zip(&[("a.png".into(), b"no picture".to_vec()), ("b.png".into(), b"no picture".to_vec())]);
    let url = begun(&app, zip.len()).await;
    problem(piece(&app, &url, 0, &zip).send().await.unwrap(), 422, "invalid_image").await;
    let told = shown(&app, &url).await;
    assert_eq!((&told["state"], &told["error"]["code"]), (&json!("refused"), &json!("invalid_image")));
    assert_eq!(head(&app, &url).await.status(), StatusCode::UNPROCESSABLE_ENTITY);
    problem(piece(&app, &url, zip.len(), b"").send().await.unwrap(), 422, "invalid_image").await;
    assert!(app.blobs.partials().await.unwrap().is_empty());
    assert!(app.blobs.jobs_with_blobs().await.unwrap().is_empty());
    assert_eq!(app.rows.awaited_bytes().await.unwrap(), 0);
}

#[tokio::test]
async fn a_whole_upload_whose_job_could_not_be_made_gets_it_when_asked_again() {
    let app = TestApp::start_with(|policy| policy.queue_limit = 1).await;
    app.with_profile(2).await;
    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    piece(&app, &url, 0, &zip[..100]).send().await.unwrap();
    app.post("/v1/stacks?rig=rig&lens=lens").body(stack_zip(2, 2)).send().await.unwrap();
    let refused = piece(&app, &url, 100, &zip[100..]).send().await.unwrap();
    assert_eq!(header(&refused, "retry-after"), "30");
    problem(refused, 503, "queue_full").await;
    assert_eq!(head(&app, &url).await.status(), StatusCode::SERVICE_UNAVAILABLE);
    // nothing is lost meanwhile, whatever is cleaned up
    sweep(&*app.rows, &*app.blobs, Duration::ZERO, &Retention::default()).await.unwrap();
    assert_eq!(shown(&app, &url).await["offset"], json!(zip.len()));

    app.claim().await;
    let asked = futures::future::join_all((0..4).map(|_| head(&app, &url))).await;
    for answer in &asked {
        assert_eq!((answer.status(), offset(answer)), (StatusCode::OK, zip.len()));
        assert_eq!(header(answer, "pinstack-job"), format!("/v1/stacks/{}", id_of(&url)));
    }
    assert_eq!(app.rows.counts().await.unwrap().queued, 1, "one job, however often it is asked for");
    sweep(&*app.rows, &*app.blobs, Duration::ZERO, &Retention::default()).await.unwrap();
    assert_eq!(std::fs::read(app.blobs.local_path(&upload_key(id_of(&url))).await.unwrap().unwrap()).unwrap(), zip);
}

#[tokio::test]
async fn an_upload_that_is_ended_is_gone_and_its_job_is_not() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    piece(&app, &url, 0, &[1; 10]).send().await.unwrap();
    assert_eq!(app.blobs.partials().await.unwrap(), [id_of(&url)]);
    assert_eq!(request(&app, Method::DELETE, &url).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    assert!(app.blobs.partials().await.unwrap().is_empty());
    problem(app.get(&url).send().await.unwrap(), 404, "not_found").await;
    problem(request(&app, Method::DELETE, &url).send().await.unwrap(), 404, "not_found").await;

    let zip = stack_zip(2, 0);
    let url = begun(&app, zip.len()).await;
    let job = header(&piece(&app, &url, 0, &zip).send().await.unwrap(), "pinstack-job").to_owned();
    request(&app, Method::DELETE, &url).send().await.unwrap();
    assert_eq!(shown(&app, &job).await["state"], "queued");
    assert!(app.blobs.local_path(&upload_key(id_of(&url))).await.unwrap().is_some());
}

#[tokio::test]
async fn a_client_behind_a_narrow_proxy_names_the_method_in_a_header() {
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

#[tokio::test]
async fn an_upload_that_nobody_goes_on_with_goes() {
    let app = TestApp::start_with(|policy| policy.upload_keep = Duration::ZERO).await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let mut partial = app.blobs.hold_partial(id_of(&url)).await.unwrap().expect("nobody has it");
    assert!(partial.start_at(0).await.unwrap());
    drop(partial);
    problem(app.get(&url).send().await.unwrap(), 404, "not_found").await;
    assert_eq!(app.rows.awaited_bytes().await.unwrap(), 0, "its room is free again");
    assert_eq!(sweep(&*app.rows, &*app.blobs, GRACE, &Retention::default()).await.unwrap().given_up, 1);
    assert!(app.blobs.partials().await.unwrap().is_empty());
    assert_eq!(sweep(&*app.rows, &*app.blobs, GRACE, &Retention::default()).await.unwrap().given_up, 0);
}

#[tokio::test]
async fn a_server_that_goes_down_keeps_what_arrived() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let mut hanging = hanging_piece(&app, &url, 1000, &[1; 200]).await;
    until_written(&app, &url, 200).await;
    app.app.shutdown.cancel();
    assert_eq!(status_line(&mut hanging).await, "HTTP/1.1 503");
    assert_eq!(app.rows.upload(id_of(&url)).await.unwrap().expect("it is there").offset, 200);
}
