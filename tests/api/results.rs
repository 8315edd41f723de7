use reqwest::StatusCode;

use crate::app::{HEIGHT, TestApp, WIDTH, id, png, problem};

async fn finished(options: &str) -> (TestApp, String) {
    let app = TestApp::start().await;
    let stack = app.with_stack(options).await;
    let job = app.claim().await;
    app.finish(&job).await;
    (app, format!("/v1/stacks/{}", id(&stack)))
}

#[tokio::test]
async fn an_image_comes_with_its_tag_its_length_and_a_sensible_name() {
    let (app, url) = finished("&label=K%C3%A4fer%201").await;
    let answer = app.get(&format!("{url}/image")).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let headers = answer.headers().clone();
    assert_eq!(
        (&headers["content-type"], &headers["accept-ranges"]),
        (&"image/png".parse().unwrap(), &"bytes".parse().unwrap())
    );
    let end = &url[url.len() - 8..];
    let name = headers["content-disposition"].to_str().unwrap();
    assert_eq!(name, format!("inline; filename=\"K_fer_1_{end}.png\"; filename*=UTF-8''K%C3%A4fer_1_{end}.png"));
    let body = answer.bytes().await.unwrap();
    assert_eq!(body, png(WIDTH, HEIGHT, 4, 3));

    let again = app.get(&format!("{url}/image")).header("if-none-match", &headers["etag"]).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    let head = app.client.head(format!("{}{url}/image", app.base)).send().await.unwrap();
    assert_eq!((head.status(), &head.headers()["content-length"]), (StatusCode::OK, &body.len().into()));
    assert_eq!(head.headers()["etag"], headers["etag"]);
    assert!(head.bytes().await.unwrap().is_empty());
    let mask = app.get(&format!("{url}/mask")).send().await.unwrap();
    assert!(mask.headers()["content-disposition"].to_str().unwrap().contains("_mask.png"));
    assert_ne!(mask.headers()["etag"], headers["etag"]);
}

#[tokio::test]
async fn a_range_of_an_image_is_that_part_of_it() {
    let (app, url) = finished("").await;
    let whole = png(WIDTH, HEIGHT, 4, 3);
    let part = |range: &'static str| app.get(&format!("{url}/image")).header("range", range).send();
    let answer = part("bytes=10-19").await.unwrap();
    assert_eq!(answer.status(), StatusCode::PARTIAL_CONTENT);
    assert_eq!(answer.headers()["content-range"], format!("bytes 10-19/{}", whole.len()).as_str());
    assert_eq!(answer.bytes().await.unwrap(), whole[10..20]);
    assert_eq!(part("bytes=-5").await.unwrap().bytes().await.unwrap(), whole[whole.len() - 5..]);
    let outside = part("bytes=1000000-").await.unwrap();
    assert_eq!(outside.headers()["content-range"], format!("bytes */{}", whole.len()).as_str());
    problem(outside, 416, "range_not_satisfiable").await;
    let other = app.get(&format!("{url}/image")).header("range", "bytes=0-1").header("if-range", "\"other\"");
    assert_eq!(other.send().await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn the_image_can_be_had_in_the_other_format_with_the_same_pixels() {
    let (app, url) = finished("").await;
    let stored = app.get(&format!("{url}/image")).send().await.unwrap();
    let tiff = app.get(&format!("{url}/image")).header("accept", "image/tiff").send().await.unwrap();
    assert_eq!((tiff.status(), &tiff.headers()["content-type"]), (StatusCode::OK, &"image/tiff".parse().unwrap()));
    assert_ne!(tiff.headers()["etag"], stored.headers()["etag"]);
    assert_eq!(tiff.headers()["vary"], "accept");
    assert!(tiff.headers()["content-disposition"].to_str().unwrap().contains(".tiff"));
    let decoded = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().to_rgba8();
    let tiff = decoded(&tiff.bytes().await.unwrap());
    assert_eq!(tiff, decoded(&stored.bytes().await.unwrap()));
    let none = app.get(&format!("{url}/image")).header("accept", "image/jpeg").send().await.unwrap();
    problem(none, 406, "not_acceptable").await;
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn without_a_back_light_there_is_no_mask() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.post("/v1/stacks?rig=rig&lens=lens").body(crate::app::stack_zip(2, 0)).send().await.unwrap();
    let job = app.claim().await;
    app.finish(&job).await;
    for what in ["mask", "backlight"] {
        let told =
            problem(app.get(&format!("/v1/stacks/{}/{what}", job.id)).send().await.unwrap(), 404, "no_result").await;
        assert!(told["detail"].as_str().unwrap().contains("no back-light slices"), "{told}");
    }
    for what in ["image", "depth", "preview"] {
        let answer = app.get(&format!("/v1/stacks/{}/{what}", job.id)).send().await.unwrap();
        assert_eq!(answer.status(), StatusCode::OK, "{what}");
    }
}
