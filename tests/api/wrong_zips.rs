//! Error messages for common mistakes in zips.

use pinstack_science::imaging::{
    Raster,
    codec::{self, Metadata},
};

use crate::app::{HEIGHT, TestApp, WIDTH, png, problem, stack_zip, zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// Sends a body that must be refused. Returns the detail of the problem.
async fn told(app: &TestApp, body: Vec<u8>, code: &str) -> String {
    let told = problem(app.post(POST).body(body).send().await.unwrap(), 422, code).await;
    told["detail"].as_str().unwrap().to_owned()
}

fn slices(names: &[&str]) -> Vec<(String, Vec<u8>)> {
    names.iter().enumerate().map(|(i, name)| ((*name).to_owned(), png(WIDTH, HEIGHT, 3, i))).collect()
}

fn tiff() -> Vec<u8> {
    let raster = Raster::eight(WIDTH as usize, HEIGHT as usize, 1, vec![9; (WIDTH * HEIGHT) as usize]);
    let mut out = std::io::Cursor::new(Vec::new());
    codec::encode_tiff(&mut out, &raster, &Metadata::default()).unwrap();
    out.into_inner()
}

#[tokio::test]
async fn a_body_that_is_not_a_complete_zip_is_refused_with_the_reason() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    let whole = stack_zip(3, 0);
    let mut tar = vec![0; 1_024];
    tar[257..262].copy_from_slice(b"ustar");
    let sent_by_curl_d: Vec<u8> = whole.iter().copied().filter(|byte| !matches!(byte, 0 | b'\n' | b'\r')).collect();
    let half = whole.len() / 2;
    for (what, body, expected) in [
        ("a tar", tar, "tar archive"),
        ("a web page", b"<html><body>502 Bad Gateway".to_vec(), "<html><body>502"),
        ("a text", b"hello, this is no zip".to_vec(), "hello, this"),
        ("the name instead of the file", b"stack.zip".to_vec(), "@stack.zip"),
        ("curl -d", sent_by_curl_d, "curl -T"),
        ("the first part", whole[..half].to_vec(), ".zip.001"),
        ("the last part", whole[half..].to_vec(), "last part of a split zip"),
    ] {
        let told = told(&app, body, "invalid_archive").await;
        assert!(told.contains(expected) && !told.contains("::"), "{what}: {told}");
    }
}

#[tokio::test]
async fn a_zip_without_a_stack_is_refused_with_what_it_contains() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    let nested = zip(&[("stack.zip".into(), stack_zip(3, 0))]);
    assert!(told(&app, nested, "invalid_archive").await.contains("stack.zip: send that one"));
    let scan = slices(&["x=0/y=000/a.png", "x=0/y=000/b.png", "x=0/y=020/a.png", "x=0/y=020/b.png"]);
    let sentence = told(&app, zip(&scan), "invalid_archive").await;
    assert!(sentence.contains("x=0/y=000, x=0/y=020") && sentence.contains("each folder as a zip"), "{sentence}");
    let strange = slices(&["left/a.png", "right/b.png"]);
    assert!(told(&app, zip(&strange), "invalid_archive").await.contains("(left, right)"));

    let mut zstd = tiff();
    let tag = zstd.windows(8).position(|entry| entry == [3, 1, 3, 0, 1, 0, 0, 0]).expect("the compression");
    zstd[tag + 8..tag + 10].copy_from_slice(&50_000_u16.to_le_bytes());
    let compressed = zip(&[("a.tif".into(), tiff()), ("b.tif".into(), zstd), ("c.tif".into(), tiff())]);
    let sentence = told(&app, compressed, "invalid_image").await;
    assert!(sentence.contains("b.tif") && sentence.contains("ZSTD"), "{sentence}");

    let mut jpeg_ls = slices(&["front/a.png", "front/b.png"]);
    jpeg_ls.push(("front/c.jpg".into(), b"\xFF\xD8\xFF\xF7\0\x0B\x08\0\x10\0\x10\x01\x01\x11\0".to_vec()));
    assert!(told(&app, zip(&jpeg_ls), "invalid_image").await.contains("JPEG-LS"));
}

#[tokio::test]
async fn a_missing_or_extra_slice_is_named() {
    let app = TestApp::start().await;
    app.with_profile(5).await;
    let missing = slices(&["front/slice_04.png", "front/slice_05.png", "front/slice_07.png", "front/slice_08.png"]);
    let sentence = told(&app, zip(&missing), "slice_count_mismatch").await;
    assert!(sentence.contains("after slice_05.png comes slice_07.png"), "{sentence}");

    let uneven = slices(&["front/s1.png", "front/s2.png", "front/s3.png", "back/s1.png", "back/s3.png"]);
    let sentence = told(&app, zip(&uneven), "slice_count_mismatch").await;
    assert!(sentence.contains("no back-light slice for front/s2.png"), "{sentence}");

    let mut preview = slices(&["front/s1.png", "front/s2.png", "back/s1.png", "back/s2.png"]);
    preview.push(("front/preview.png".into(), png(64, 48, 3, 1)));
    let sentence = told(&app, zip(&preview), "size_mismatch").await;
    assert!(sentence.contains("front/preview.png (64 x 48 px)"), "{sentence}");
}

#[tokio::test]
async fn a_size_mismatch_caused_by_an_orientation_tag_names_the_tag() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let block = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0".to_vec();
    let turned = |seed: u8| {
        let raster = Raster::eight(WIDTH as usize, HEIGHT as usize, 1, vec![seed; (WIDTH * HEIGHT) as usize]);
        let mut out = Vec::new();
        codec::encode_png(&mut out, &raster, &Metadata { icc: None, exif: Some(block.clone()) }).unwrap();
        out
    };
    let sentence = told(&app, zip(&[("a.png".into(), turned(1)), ("b.png".into(), turned(2))]), "size_mismatch").await;
    assert!(sentence.contains("18 x 24 px after their orientation tag (6)"), "{sentence}");
    assert!(sentence.contains("automatic rotation"), "{sentence}");
}

#[tokio::test]
async fn folders_may_be_named_in_other_languages() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    for (front, back) in [("beleuchtet", "gegenlicht"), ("Avant", "Contre-jour"), ("frontal", "contraluz")] {
        let light = |folder: &str| [1, 2].map(|i| (format!("{folder}/s{i}.png"), png(WIDTH, HEIGHT, 3, i)));
        let answer = app.post(POST).body(zip(&[light(front), light(back)].concat())).send().await.unwrap();
        assert_eq!(answer.status().as_u16(), 202, "{front}, {back}: {}", answer.text().await.unwrap());
        let stack: serde_json::Value = answer.json().await.unwrap();
        assert_eq!(stack["slices"]["front"][0], format!("{front}/s1.png"));
        assert_eq!(stack["slices"]["back"][0], format!("{back}/s1.png"));
    }
}
