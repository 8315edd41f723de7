//! Interrupted uploads: broken connections, stalled requests, shutdowns, clients that never return.

use std::time::Duration;

use pinstack::store::{
    Retention,
    gc::{GRACE, collect},
};

use super::*;

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
async fn a_new_request_takes_over_an_upload_from_a_stalled_one() {
    // no idle timeout and no polling: only the newer request can end it
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
async fn a_request_to_another_process_takes_over_an_upload() {
    let quick = Duration::from_millis(5);
    let app = TestApp::start_with(|policy| policy.poll_interval = quick).await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let mut hanging = hanging_piece(&app, &url, 1000, &[1; 200]).await;
    until_written(&app, &url, 200).await;
    // its store does not announce changes to this process
    app.metadata_of_another_process().await.take_over_upload(id_of(&url)).await.unwrap();
    assert_eq!(status_line(&mut hanging).await, "HTTP/1.1 409");
    assert_eq!(offset(&head(&app, &url).await), 200);
}

#[tokio::test]
async fn a_complete_upload_without_a_job_gets_its_job_on_the_next_request() {
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
    // garbage collection removes nothing meanwhile
    collect(&app.store, Duration::ZERO, &Retention::default()).await.unwrap();
    assert_eq!(shown(&app, &url).await["offset"], json!(zip.len()));

    app.claim().await;
    let asked = futures::future::join_all((0..4).map(|_| head(&app, &url))).await;
    for answer in &asked {
        assert_eq!((answer.status(), offset(answer)), (StatusCode::OK, zip.len()));
        assert_eq!(header(answer, "pinstack-job"), format!("/v1/stacks/{}", id_of(&url)));
    }
    assert_eq!(app.store.metadata.counts().await.unwrap().queued, 1, "one job, however often it is asked for");
    collect(&app.store, Duration::ZERO, &Retention::default()).await.unwrap();
    assert_eq!(app.blob(&upload_key(id_of(&url))).await.unwrap(), zip);
}

#[tokio::test]
async fn an_abandoned_upload_expires() {
    let app = TestApp::start_with(|policy| policy.upload_keep = Duration::ZERO).await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let mut partial = app.store.parts.lock(id_of(&url)).await.unwrap().expect("it is not locked");
    assert!(partial.resume_at(0, 1).await.unwrap());
    drop(partial);
    problem(app.get(&url).send().await.unwrap(), 404, "not_found").await;
    assert_eq!(app.store.metadata.reserved_bytes().await.unwrap(), 0, "its room is free again");
    assert_eq!(collect(&app.store, GRACE, &Retention::default()).await.unwrap().given_up, 1);
    assert!(app.store.parts.list().await.unwrap().is_empty());
    assert_eq!(collect(&app.store, GRACE, &Retention::default()).await.unwrap().given_up, 0);
}

#[tokio::test]
async fn a_server_that_shuts_down_keeps_what_arrived() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let url = begun(&app, 1000).await;
    let mut hanging = hanging_piece(&app, &url, 1000, &[1; 200]).await;
    until_written(&app, &url, 200).await;
    app.app.shutdown.cancel();
    assert_eq!(status_line(&mut hanging).await, "HTTP/1.1 503");
    assert_eq!(app.store.metadata.upload(id_of(&url)).await.unwrap().expect("it is there").offset, 200);
}
