//! Stacks whose slices do not fit each other or their profile in orientation or colour.

use pinstack_science::imaging::{
    Raster,
    codec::{self, Metadata},
};
use serde_json::{Value, json};

use crate::app::{HEIGHT, TestApp, WIDTH, problem, profile, zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// A slice with an EXIF block of one directory with one entry: a tag of the main directory, or of the Exif directory.
fn slice(seed: u8, block: Vec<u8>) -> Vec<u8> {
    let samples = (0..WIDTH * HEIGHT * 3).map(|i| (i as u8).wrapping_mul(37).wrapping_add(seed)).collect();
    let raster = Raster::eight(WIDTH as usize, HEIGHT as usize, 3, samples);
    let mut out = Vec::new();
    codec::encode_png(&mut out, &raster, &Metadata { icc: None, exif: Some(block) }).unwrap();
    out
}

fn orientation(value: u8) -> Vec<u8> {
    [&b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0"[..], &[value, 0, 0, 0, 0, 0, 0, 0]].concat()
}

fn colour_space(value: u8) -> Vec<u8> {
    let exif = [1, 0, 0x01, 0xA0, 3, 0, 1, 0, 0, 0, value, 0, 0, 0, 0, 0, 0, 0];
    [&b"II*\0\x08\0\0\0\x01\0\x69\x87\x04\0\x01\0\0\0\x1A\0\0\0\0\0\0\0"[..], &exif].concat()
}

/// A stack of one slice for each block.
fn stack(blocks: &[Vec<u8>]) -> Vec<u8> {
    let slices = blocks.iter().enumerate().map(|(i, block)| (format!("s{i}.png"), slice(i as u8, block.clone())));
    zip(&slices.collect::<Vec<_>>())
}

async fn with_profile(app: &TestApp, orientation: Value) {
    let mut body = profile(2);
    body["orientation"] = orientation;
    let answer = app.put("/v1/profiles/rig/lens").json(&body).send().await.unwrap();
    assert!(answer.status().is_success(), "{}", answer.text().await.unwrap());
}

/// Sends a stack that is accepted. Returns its warnings.
async fn warnings(app: &TestApp, body: Vec<u8>) -> Vec<Value> {
    let answer = app.post(POST).body(body).send().await.unwrap();
    assert_eq!(answer.status().as_u16(), 202, "{}", answer.text().await.unwrap());
    let stack: Value = answer.json().await.unwrap();
    stack["warnings"].as_array().unwrap().clone()
}

#[tokio::test]
async fn a_stack_turned_otherwise_than_its_profile_is_refused() {
    let app = TestApp::start().await;
    for (of_profile, of_stack) in [(1, 3), (1, 2), (1, 4), (3, 1), (3, 2)] {
        with_profile(&app, json!(of_profile)).await;
        let turned = || stack(&[orientation(of_stack), orientation(of_stack)]);
        let told = problem(app.post(POST).body(turned()).send().await.unwrap(), 422, "size_mismatch").await;
        let sentence = told["detail"].as_str().unwrap();
        assert!(sentence.contains(&format!("the orientation tag {of_stack}")), "{sentence}");
        assert!(sentence.contains(&format!("slices of orientation {of_profile}:")), "{sentence}");
        with_profile(&app, json!(of_stack)).await;
        assert_eq!(warnings(&app, turned()).await, [] as [Value; 0]);
    }
    // the profile shows it, and does not take nonsense
    let shown: Value = app.get("/v1/profiles/rig/lens").send().await.unwrap().json().await.unwrap();
    assert_eq!(shown["orientation"], 2);
    let mut body = profile(2);
    body["orientation"] = json!(9);
    let told =
        problem(app.put("/v1/profiles/rig/lens").json(&body).send().await.unwrap(), 422, "invalid_profile").await;
    assert_eq!(told["errors"][0]["pointer"], "/orientation", "{told}");
}

#[tokio::test]
async fn a_turned_stack_and_a_profile_of_unknown_orientation_are_told_once() {
    let app = TestApp::start().await;
    with_profile(&app, Value::Null).await;
    let told = warnings(&app, stack(&[orientation(3), orientation(3)])).await;
    assert_eq!(told.len(), 1, "{told:?}");
    assert_eq!(told[0]["code"], "orientation_unknown");
    assert!(told[0]["detail"].as_str().unwrap().contains("by their orientation tag (3)"), "{told:?}");
    assert_eq!(warnings(&app, stack(&[orientation(1), orientation(1)])).await, [] as [Value; 0]);
}

#[tokio::test]
async fn slices_of_another_colour_space_are_named_at_once() {
    let app = TestApp::start().await;
    with_profile(&app, json!(1)).await;
    let told = warnings(&app, stack(&[colour_space(1), colour_space(2)])).await;
    let detail = told[0]["detail"].as_str().unwrap();
    assert_eq!((told.len(), told[0]["code"].as_str()), (1, Some("mixed_colour_spaces")), "{told:?}");
    assert!(detail.contains("s1.png is in Adobe RGB"), "{detail}");
    assert_eq!(warnings(&app, stack(&[colour_space(2), colour_space(2)])).await, [] as [Value; 0]);
    let told = warnings(&app, stack(&[colour_space(255), colour_space(255)])).await;
    assert_eq!((told.len(), told[0]["code"].as_str()), (1, Some("unknown_colour_space")), "{told:?}");
}

#[tokio::test]
async fn an_orientation_of_another_integer_type_turns_the_slices_too() {
    let app = TestApp::start().await;
    with_profile(&app, json!(3)).await;
    for kind in [1, 3, 4] {
        let mut block = orientation(3);
        block[12] = kind;
        assert_eq!(warnings(&app, stack(&[block.clone(), block])).await, [json!(null); 0], "type {kind}");
    }
}
