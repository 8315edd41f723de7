//! The options `order` and `input_bits`.

use pinstack::contract::request::JobRequest;
use pinstack_science::imaging::{
    Raster,
    codec::{self, Metadata},
};
use serde_json::{Value, json};

use crate::app::{HEIGHT, TestApp, WIDTH, problem, stack_zip, zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

#[tokio::test]
async fn the_order_can_be_reversed() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    for (option, first) in
        [("", "front/img_0.png"), ("&order=name", "front/img_0.png"), ("&order=reverse", "front/img_2.png")]
    {
        let answer = app.post(&format!("{POST}{option}")).body(stack_zip(3, 3)).send().await.unwrap();
        assert_eq!(answer.status().as_u16(), 202);
        let stack: Value = answer.json().await.unwrap();
        assert_eq!(stack["slices"]["front"][0], first, "{option}");
        assert_eq!(stack["slices"]["back"][0], first.replace("front", "back"), "{option}");
        let claimed = app.claim().await;
        let JobRequest::Stack(request) = &claimed.request else { panic!("a stack") };
        assert_eq!(request.layout.front[0], first);
    }
    problem(
        app.post(&format!("{POST}&order=backwards")).body(stack_zip(3, 0)).send().await.unwrap(),
        400,
        "invalid_request",
    )
    .await;
}

#[tokio::test]
async fn the_significant_bits_of_slices_can_be_given() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let deep = |seed: u16| {
        let samples = (0..WIDTH * HEIGHT).map(|i| (i as u16 * 37 + seed) % 4_096).collect();
        let mut out = Vec::new();
        let raster = Raster::sixteen(WIDTH as usize, HEIGHT as usize, 1, samples);
        codec::encode_png(&mut out, &raster, &Metadata::default()).unwrap();
        out
    };
    let sixteen = zip(&[("a.png".into(), deep(1)), ("b.png".into(), deep(2))]);
    for (option, shown) in [("", "auto"), ("&input_bits=12", "12"), ("&input_bits=16", "16")] {
        let answer = app.post(&format!("{POST}{option}")).body(sixteen.clone()).send().await.unwrap();
        assert_eq!(answer.status().as_u16(), 202);
        let stack: Value = answer.json().await.unwrap();
        assert_eq!(stack["options"]["input_bits"], json!(shown));
    }
    let answer = app.post(&format!("{POST}&input_bits=11")).body(sixteen).send().await.unwrap();
    problem(answer, 400, "invalid_request").await;
    let answer = app.post(&format!("{POST}&input_bits=12")).body(stack_zip(2, 0)).send().await.unwrap();
    let told = problem(answer, 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("8 bits per sample"), "{told}");
}
