use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::app::{HEIGHT, TestApp, WIDTH, id, png, problem};

async fn finished(options: &str) -> (TestApp, String) {
    let app = TestApp::start().await;
    let stack = app.with_stack(options).await;
    let job = app.claim().await;
    app.finish(&job).await;
    (app, format!("/v1/stacks/{}", id(&stack)))
}

#[tokio::test]
async fn an_image_is_sent_with_its_tag_its_length_and_a_file_name() {
    let (app, url) = finished("&label=K%C3%A4fer%201").await;
    let answer = app.get(&format!("{url}/image")).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let headers = answer.headers().clone();
    assert_eq!(
        (&headers["content-type"], &headers["accept-ranges"]),
        (&"image/png".parse().unwrap(), &"bytes".parse().unwrap())
    );
    let name = headers["content-disposition"].to_str().unwrap();
    assert_eq!(name, "inline; filename=\"K_fer_1.png\"; filename*=UTF-8''K%C3%A4fer_1.png");
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
async fn a_range_request_returns_that_part_of_the_image() {
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
    // only GET has ranges
    for range in ["bytes=10-19", "bytes=1000000-"] {
        let head = app.client.head(format!("{}{url}/image", app.base)).header("range", range).send().await.unwrap();
        assert_eq!((head.status(), &head.headers()["content-length"]), (StatusCode::OK, &whole.len().into()));
        assert!(!head.headers().contains_key("content-range"));
    }
}

#[tokio::test]
async fn the_image_is_available_in_other_formats_with_the_same_pixels() {
    let (app, url) = finished("&label=bee").await;
    let stored = app.get(&format!("{url}/image")).send().await.unwrap();
    let tag = stored.headers()["etag"].clone();
    let decoded = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().to_rgba8();
    let pixels = decoded(&stored.bytes().await.unwrap());
    for (kind, extension) in [("image/tiff", "tiff"), ("image/jpeg", "jpg")] {
        let answer = app.get(&format!("{url}/image")).header("accept", kind).send().await.unwrap();
        assert_eq!((answer.status(), &answer.headers()["content-type"]), (StatusCode::OK, &kind.parse().unwrap()));
        assert_ne!(answer.headers()["etag"], tag);
        assert_eq!(answer.headers()["vary"], "accept");
        let name = format!("inline; filename=\"bee.{extension}\"");
        assert_eq!(answer.headers()["content-disposition"], name.as_str());
        let converted = decoded(&answer.bytes().await.unwrap());
        assert_eq!(converted.dimensions(), pixels.dimensions());
        if kind == "image/tiff" {
            assert_eq!(converted, pixels);
        }
    }
    let mask = app.get(&format!("{url}/mask")).header("accept", "image/tiff").send().await.unwrap();
    assert_eq!(mask.headers()["content-type"], "image/tiff");
    let depth = app.get(&format!("{url}/depth")).header("accept", "image/jpeg").send().await.unwrap();
    assert_eq!(depth.headers()["content-type"], "image/png", "a JPEG would change the numbers");
}

#[tokio::test]
async fn a_height_map_is_served_with_what_is_needed_to_read_it() {
    let (app, url) = finished("&height=auto").await;
    let stack: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert_eq!(stack["options"]["height"], "auto");
    let height = &stack["height"];
    assert_eq!(
        (&height["unit"], &height["direction"], &height["invalid"]),
        (&json!("mm"), &json!("towards_camera"), &json!(0))
    );
    assert_eq!((&height["offset"], &height["scale"]), (&json!(-2.5), &json!(1e-4)));
    for (link, path) in [("height", "height"), ("height_sigma", "height-sigma")] {
        assert_eq!(stack["links"][link], format!("{url}/{path}"));
        let stored = app.get(&format!("{url}/{path}")).send().await.unwrap();
        assert_eq!(
            (stored.status(), &stored.headers()["content-type"]),
            (StatusCode::OK, &"image/png".parse().unwrap())
        );
        let tiff = app.get(&format!("{url}/{path}")).header("accept", "image/tiff").send().await.unwrap();
        assert_eq!(tiff.headers()["content-type"], "image/tiff");
        let jpeg = app.get(&format!("{url}/{path}")).header("accept", "image/jpeg").send().await.unwrap();
        assert_eq!(jpeg.headers()["content-type"], "image/png", "a JPEG would change the numbers");
    }
}

#[tokio::test]
async fn without_the_option_there_is_no_height_map() {
    let (app, url) = finished("").await;
    let stack: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert_eq!((&stack["height"], &stack["options"]["height"]), (&Value::Null, &json!("none")));
    assert_eq!(stack["links"].get("height"), None);
    for what in ["height", "height-sigma"] {
        let told = problem(app.get(&format!("{url}/{what}")).send().await.unwrap(), 404, "no_result").await;
        assert!(told["detail"].as_str().unwrap().contains("height=auto"), "{told}");
    }
}

#[tokio::test]
async fn a_client_that_accepts_no_picture_gets_the_stored_file() {
    let (app, url) = finished("").await;
    let kinds = ["application/json", "application/problem+json", "application/octet-stream", "image/webp", "text/html"];
    for kind in kinds {
        for what in ["image", "mask", "backlight", "depth", "preview"] {
            let answer = app.get(&format!("{url}/{what}")).header("accept", kind).send().await.unwrap();
            let told = (answer.status(), answer.headers()["content-type"].clone());
            assert_eq!(told, (StatusCode::OK, "image/png".parse().unwrap()), "{what} for {kind}");
        }
    }
    assert_eq!(app.app.conversions.begun(), 0);
}

#[tokio::test]
async fn a_conversion_is_shared_cached_and_removed_with_the_stack() {
    let (app, url) = finished("").await;
    let tiff = || app.get(&format!("{url}/image")).header("accept", "image/tiff").send();
    let answers = futures::future::join_all((0..8).map(|_| tiff())).await;
    let mut bodies = Vec::new();
    for answer in answers {
        bodies.push(answer.unwrap().bytes().await.unwrap());
    }
    assert!(bodies.windows(2).all(|pair| pair[0] == pair[1]));
    bodies.push(tiff().await.unwrap().bytes().await.unwrap());
    assert_eq!(bodies[8], bodies[0]);
    assert_eq!((app.app.conversions.begun(), app.spooled()), (1, 1), "made once, and kept");
    let length = bodies[0].len();
    let part = app.get(&format!("{url}/image")).header("accept", "image/tiff").header("range", "bytes=2-5");
    let part = part.send().await.unwrap();
    assert_eq!(part.headers()["content-range"], format!("bytes 2-5/{length}").as_str());
    assert_eq!(app.delete(&url).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    assert_eq!(app.spooled(), 0, "it goes with the stack");
}

#[tokio::test]
async fn head_and_current_copies_cause_no_conversion() {
    let (app, url) = finished("").await;
    let head = || app.client.head(format!("{}{url}/image", app.base)).header("accept", "image/tiff").send();
    let told = head().await.unwrap();
    assert_eq!((told.status(), &told.headers()["content-type"]), (StatusCode::OK, &"image/tiff".parse().unwrap()));
    assert!(!told.headers().contains_key("content-length"), "the length is not known yet");
    let tag = told.headers()["etag"].clone();
    let get = || app.get(&format!("{url}/image")).header("accept", "image/tiff");
    assert_eq!(get().header("if-none-match", &tag).send().await.unwrap().status(), StatusCode::NOT_MODIFIED);
    problem(get().header("if-match", "\"other\"").send().await.unwrap(), 412, "precondition_failed").await;
    assert_eq!(app.app.conversions.begun(), 0);
    let made = get().send().await.unwrap();
    assert_eq!(made.headers()["etag"], tag);
    let length = made.bytes().await.unwrap().len();
    assert_eq!(head().await.unwrap().headers()["content-length"], length.to_string().as_str());
    assert_eq!(app.app.conversions.begun(), 1);
}

#[tokio::test]
async fn disconnecting_clients_neither_multiply_nor_stop_conversions() {
    use tokio::{io::AsyncWriteExt, net::TcpStream};
    let (app, url) = finished("").await;
    let head = format!("GET {url}/image HTTP/1.1\r\nhost: x\r\naccept: image/tiff\r\n\r\n");
    let mut deaf = Vec::new();
    for turn in 0..40 {
        let mut socket = TcpStream::connect(app.base.trim_start_matches("http://")).await.unwrap();
        socket.write_all(head.as_bytes()).await.unwrap();
        // half of them disconnect at once, the others never read
        if turn % 2 == 0 {
            drop(socket);
        } else {
            deaf.push(socket);
        }
    }
    let made = app.get(&format!("{url}/image")).header("accept", "image/tiff").send().await.unwrap();
    assert_eq!(made.status(), StatusCode::OK);
    made.bytes().await.unwrap();
    assert_eq!((app.app.conversions.begun(), app.spooled()), (1, 1));
    drop(deaf);
}

#[tokio::test]
async fn a_full_disk_refuses_a_conversion() {
    let app = TestApp::start().await;
    let stack = app.with_stack("").await;
    let job = app.claim().await;
    app.finish(&job).await;
    let url = format!("/v1/stacks/{}/image", id(&stack));
    let full = app.on_a_full_disk().await;
    let get = |path: &str| app.client.get(format!("{full}{path}"));
    let refused = get(&url).header("accept", "image/tiff").send().await.unwrap();
    let told = problem(refused, 507, "insufficient_storage").await;
    assert!(told["detail"].as_str().unwrap().contains("as it is stored"), "{told}");
    let tile = get(&format!("/stacks/{}/tiles/image/0/0/0", id(&stack))).send().await.unwrap();
    let told = problem(tile, 507, "insufficient_storage").await;
    assert!(told["detail"].as_str().unwrap().ends_with("for the viewer; free some space"), "{told}");
    assert_eq!(get(&url).send().await.unwrap().status(), StatusCode::OK, "the stored file needs no room");
    assert_eq!(app.spooled(), 0);
}

#[tokio::test]
async fn a_stored_result_that_changed_on_the_disk_is_not_sent() {
    for cut in [true, false] {
        let app = TestApp::start().await;
        let stack = app.with_stack("").await;
        let job = app.claim().await;
        app.finish(&job).await;
        let key = pinstack::store::blobs::result_key(job.id, job.lease_token, "image.png");
        let stored = app.store.blobs.fetch(&key, &app.store.workspace).await.unwrap().expect("the file");
        let path = stored.path();
        match cut {
            true => std::fs::File::options().write(true).open(path).unwrap().set_len(100).unwrap(),
            false => std::fs::remove_file(path).unwrap(),
        }
        let url = format!("/v1/stacks/{}/image", id(&stack));
        for accept in ["image/png", "image/tiff"] {
            let told = problem(app.get(&url).header("accept", accept).send().await.unwrap(), 500, "internal").await;
            assert!(told["detail"].as_str().unwrap().contains("pinstack verify"), "{told}");
        }
    }
}

#[tokio::test]
async fn a_precondition_on_a_result_is_honoured() {
    let (app, url) = finished("").await;
    let get = || app.get(&format!("{url}/image"));
    let tag = get().send().await.unwrap().headers()["etag"].clone();
    assert_eq!(get().header("if-match", &tag).send().await.unwrap().status(), StatusCode::OK);
    assert_eq!(get().header("if-match", "*").send().await.unwrap().status(), StatusCode::OK);
    problem(get().header("if-match", "\"other\"").send().await.unwrap(), 412, "precondition_failed").await;
    let part = get().header("if-match", "\"other\"").header("range", "bytes=0-1").send().await.unwrap();
    problem(part, 412, "precondition_failed").await;
    let head = app.client.head(format!("{}{url}/mask", app.base)).header("if-match", "\"other\"");
    assert_eq!(head.send().await.unwrap().status(), StatusCode::PRECONDITION_FAILED);
    // no response carries a date, so none can match
    let dated = get().header("if-unmodified-since", "Mon, 01 Jan 2001 00:00:00 GMT").send().await.unwrap();
    assert_eq!(dated.status(), StatusCode::OK);
}

#[tokio::test]
async fn a_view_keeps_its_file_name_in_a_rerun() {
    let app = TestApp::start().await;
    app.with_scan("bee").await;
    let mut names = Vec::new();
    for _ in 0..2 {
        let stack = app.with_stack("&scan=bee&pan_deg=20&tilt_deg=-7.5").await;
        let job = app.claim().await;
        app.finish(&job).await;
        let image = app.get(&format!("/v1/stacks/{}/image", id(&stack))).send().await.unwrap();
        names.push(image.headers()["content-disposition"].clone());
    }
    assert_eq!(names, ["inline; filename=\"bee_020_-007.5.png\""; 2]);
}

#[tokio::test]
async fn a_stack_shows_its_mask_sizes_and_its_software() {
    let app = TestApp::start().await;
    let stack = app.with_stack("").await;
    assert_eq!((&stack["options"]["mask_min_blob_px"], &stack["options"]["mask_min_hole_px"]), (&4.into(), &4.into()));
    assert!(stack["software"].is_null(), "nothing is made yet");
    assert_eq!((&stack["options"]["bit_depth"], &stack["options"]["jpeg_quality"]), (&"8".into(), &95.into()));
    let without = app.with_stack("&mask=none").await;
    assert!(without["options"]["mask_min_blob_px"].is_null());
    let job = app.claim().await;
    app.finish(&job).await;
    let done: serde_json::Value =
        app.get(&format!("/v1/stacks/{}", job.id)).send().await.unwrap().json().await.unwrap();
    assert_eq!(done["software"], "pinstack test");
}

#[tokio::test]
async fn sixteen_bits_are_refused_for_a_jpeg() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let send =
        |query: &str| app.post(&format!("/v1/stacks?rig=rig&lens=lens{query}")).body(crate::app::stack_zip(2, 0));
    let refused = send("&format=jpeg&bit_depth=16").send().await.unwrap();
    let told = problem(refused, 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("a JPEG has 8 bits"), "{told}");
    problem(send("&format=jpeg&jpeg_quality=0").send().await.unwrap(), 400, "invalid_request").await;
    assert_eq!(send("&format=jpg&bit_depth=auto").send().await.unwrap().status(), StatusCode::ACCEPTED);
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
