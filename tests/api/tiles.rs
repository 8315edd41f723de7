//! Tiles and thumbnails of the pages: of results and of slices.

use reqwest::StatusCode;

use crate::app::{TestApp, id, problem};

#[tokio::test]
async fn the_slices_of_a_stack_are_shown_as_they_were_fused() {
    let app = TestApp::start().await;
    let stack = id(&app.with_stack("").await);
    let tile = async |path: &str| app.get(&format!("/stacks/{stack}/tiles/{path}")).send().await.unwrap();
    problem(tile("slice-front-0/0/0/0").await, 404, "not_found").await;
    app.finish(&app.claim().await).await;
    let page = app.get(&format!("/stacks/{stack}")).send().await.unwrap().text().await.unwrap();
    let job = app.store.metadata.job(stack).await.unwrap().unwrap();
    let count = job.request.layout().expect("a stack").front.len();
    assert!(page.contains("Slices, front light, aligned") && page.contains("Slices, back light, aligned"), "{page}");
    assert!(page.contains(&format!("&quot;slices&quot;:{count}")), "{page}");
    for slice in ["slice-front-0", "slice-front-0", "slice-back-0"] {
        let answer = tile(&format!("{slice}/0/0/0")).await;
        assert_eq!(
            (answer.status(), &answer.headers()["content-type"]),
            (StatusCode::OK, &"image/png".parse().unwrap())
        );
        let picture = image::load_from_memory(&answer.bytes().await.unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (crate::app::WIDTH, crate::app::HEIGHT));
    }
    assert_eq!(app.app.conversions.begun(), 2, "a slice is warped once");
    for wrong in [
        &format!("slice-front-{count}"),
        "slice-",
        "slice-front--1",
        "slice-front-+1",
        "slice-front-00",
        "slice-uv-0",
        "slice-0",
        "slice-front-0x",
        "slice-front-9999999999999999999999",
    ] {
        problem(tile(&format!("{wrong}/0/0/0")).await, 404, "not_found").await;
    }
    // a zip that cannot be read any more
    app.put_blob(&job.request.upload().key, b"damaged").await;
    problem(tile("slice-front-1/0/0/0").await, 422, "invalid_archive").await;
}

#[tokio::test]
async fn tiles_are_parts_of_the_pictures_and_one_decoding_serves_all() {
    let app = TestApp::start().await;
    let stack = id(&app.with_stack("").await);
    let tile = async |path: &str| app.get(&format!("/stacks/{stack}/tiles/{path}")).send().await.unwrap();
    problem(tile("image/0/0/0").await, 409, "not_finished").await;
    app.finish(&app.claim().await).await;
    let all = (0..8).map(|_| tile("image/0/0/0"));
    for answer in futures::future::join_all(all).await {
        assert_eq!(
            (answer.status(), &answer.headers()["content-type"]),
            (StatusCode::OK, &"image/png".parse().unwrap())
        );
    }
    assert_eq!(app.app.conversions.begun(), 1);
    let answer = tile("depth/0/0/0").await;
    let tag = answer.headers()["etag"].clone();
    let picture = image::load_from_memory(&answer.bytes().await.unwrap()).unwrap();
    assert_eq!((picture.width(), picture.height()), (crate::app::WIDTH, crate::app::HEIGHT));
    let again =
        app.get(&format!("/stacks/{stack}/tiles/depth/0/0/0")).header("if-none-match", tag).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    for wrong in [
        "image/1/0/0",
        "image/0/1/0",
        "image/0/0/4294967295",
        "image/4294967296/0/0",
        "image/-1/0/0",
        "image/0/0/x",
        "preview/0/0/0",
        "nothing/0/0/0",
        "..%2Fimage/0/0/0",
    ] {
        problem(tile(wrong).await, 404, "not_found").await;
    }
    problem(tile("height/0/0/0").await, 404, "no_result").await;
    let job = app.store.metadata.job(stack).await.unwrap().unwrap();
    let mask = job.outcome.unwrap().artifacts().iter().find(|artifact| artifact.name == "mask").unwrap().key.clone();
    app.put_blob(&mask, b"damaged").await;
    problem(tile("mask/0/0/0").await, 500, "internal").await;
    let thumbnail = app.get(&format!("/stacks/{stack}/thumbnail")).send().await.unwrap();
    assert_eq!(thumbnail.headers()["content-type"], "image/jpeg");
    assert!(thumbnail.bytes().await.unwrap().len() < 20_000);
}
