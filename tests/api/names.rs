//! Names as cameras, programs, file managers and servers give them, sent as stacks, scans and lists of names.

use serde_json::{Value, json};

use crate::app::{HEIGHT, TestApp, WIDTH, png, problem, zip};

const POST: &str = "/v1/stacks?rig=rig&lens=lens";

/// The zip of pictures of these names, which is not in the order of the names.
fn slices(names: &[&str]) -> Vec<u8> {
    let mut members: Vec<(String, Vec<u8>)> =
        names.iter().enumerate().map(|(i, name)| ((*name).to_owned(), png(WIDTH, HEIGHT, 3, i))).collect();
    members.reverse();
    members.rotate_left(1);
    zip(&members)
}

async fn accepted(app: &TestApp, query: &str, body: Vec<u8>) -> Value {
    let answer = app.post(&format!("{POST}{query}")).body(body).send().await.unwrap();
    assert_eq!(answer.status().as_u16(), 202, "{}", answer.text().await.unwrap());
    answer.json().await.unwrap()
}

async fn views(app: &TestApp, names: &[String]) -> Vec<Value> {
    let answer = app.post("/v1/groupings").json(&json!({ "names": names })).send().await.unwrap();
    let shown: Value = answer.json().await.unwrap();
    shown["views"].as_array().unwrap_or_else(|| panic!("{shown}")).clone()
}

#[tokio::test]
async fn slices_are_used_in_the_order_in_which_they_were_taken() {
    let app = TestApp::start().await;
    app.with_profile(5).await;
    for (names, told) in [
        (["DSC09998.png", "DSC09999.png", "DSC00001.png", "DSC00002.png", "DSC00003.png"], Some("counter_rollover")),
        (["P1009998.png", "P1009999.png", "P1000001.png", "P1000002.png", "P1000003.png"], Some("counter_rollover")),
        (["s997.png", "s998.png", "s999.png", "s000.png", "s001.png"], Some("counter_rollover")),
        (["z0.png", "z0.25.png", "z0.5.png", "z0.75.png", "z1.0.png"], None),
        (["1,125.png", "1,25.png", "1,5.png", "1,75.png", "2.png"], None),
        (["z-2.png", "z-1.png", "z0.png", "z1.png", "z2.png"], None),
        (["focus -2.png", "focus -1.png", "focus 0.png", "focus 1.png", "focus 2.png"], None),
        (["z_-0.75.png", "z_-0.5.png", "z_-0.25.png", "z_0.0.png", "z_0.25.png"], None),
        (["v1.8.png", "v1.9.png", "v1.10.png", "v1.11.png", "v1.12.png"], None),
        (["IMG (1).png", "IMG (2).png", "IMG (3).png", "IMG (9).png", "IMG (10).png"], None),
    ] {
        let stack = accepted(&app, "", slices(&names)).await;
        assert_eq!(stack["slices"]["front"], json!(names));
        let codes: Vec<&str> =
            stack["warnings"].as_array().unwrap().iter().filter_map(|warning| warning["code"].as_str()).collect();
        assert_eq!(codes, told.into_iter().collect::<Vec<_>>(), "{names:?}");
        let found = views(&app, &names.map(|name| format!("front/{name}"))).await;
        assert_eq!(found.len(), 1, "one stack is one view: {found:?}");
        assert_eq!(found[0]["front"], json!(names.map(|name| format!("front/{name}"))));
    }
}

#[tokio::test]
async fn folders_of_file_servers_are_skipped() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    for folder in ["front/@eaDir/a.png", "@eaDir", "front/.@__thumb", "#recycle", ".Trashes/501", "front/.thumbnails"] {
        let thumbnail = format!("{folder}/a.png");
        let stack = accepted(&app, "", slices(&["front/a.png", "front/b.png", &thumbnail])).await;
        assert_eq!(stack["slices"]["front"], json!(["front/a.png", "front/b.png"]), "{folder}");
    }
}

#[tokio::test]
async fn a_copy_that_is_one_slice_too_many_is_named_in_errors() {
    let app = TestApp::start().await;
    app.with_profile(3).await;
    for copy in [
        "front/2 - Copy.png",
        "front/2.sync-conflict-20240101-101010-ABCDEFG.png",
        "front/2 (lab-pc's conflicted copy 2024-01-01).png",
        "front/2-Edit.png",
    ] {
        let body = slices(&["front/1.png", "front/2.png", "front/3.png", copy]);
        let told = problem(app.post(POST).body(body).send().await.unwrap(), 422, "slice_count_mismatch").await;
        assert_eq!(told["errors"][0]["file"], copy, "{told}");
        let expected =
            format!("{copy} seems to be a copy or an edit of another file; send all slices of the stack once");
        assert!(told["detail"].as_str().unwrap().contains(&expected), "{told}");
    }
    let uneven = slices(&["front/1.png", "front/2.png", "front/2 (2).png", "back/1.png", "back/2.png"]);
    let told = problem(app.post(POST).body(uneven).send().await.unwrap(), 422, "slice_count_mismatch").await;
    assert_eq!(told["errors"][0]["file"], "front/2 (2).png", "{told}");
    // without a copy, the gap is told and no file is blamed
    let told =
        problem(app.post(POST).body(slices(&["1.png", "2.png"])).send().await.unwrap(), 422, "slice_count_mismatch");
    assert!(told.await.get("errors").is_none());
}

#[tokio::test]
async fn a_name_in_two_normal_forms_is_one_name() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    app.with_scan("bee").await;
    let (composed, decomposed) = ("K\u{E4}fer", "Ka\u{308}fer");
    // a view that is sent again replaces the first
    for label in ["K%C3%A4fer", "Ka%CC%88fer"] {
        accepted(&app, &format!("&scan=bee&label={label}"), slices(&["1.png", "2.png"])).await;
    }
    let scan: Value = app.get("/v1/scans/bee").send().await.unwrap().json().await.unwrap();
    assert_eq!(scan["views"].as_array().unwrap().len(), 1, "{scan}");
    assert_eq!(scan["views"][0]["label"], decomposed, "what was sent is shown");

    let two = |of: &dyn Fn(usize) -> [String; 2]| -> Vec<String> { (1..=2).flat_map(of).collect() };
    for names in [
        two(&|i| [format!("{composed} 1/front/{i}.png"), format!("{decomposed} 1/back/{i}.png")]),
        two(&|i| [format!("{composed}_01/{i}.png"), format!("{decomposed}_01_back/{i}.png")]),
        two(&|i| [format!("{composed}_01_front_{i}.png"), format!("{decomposed}_01_back_{i}.png")]),
        two(&|i| [format!("{composed}/a/front/{i}.png"), format!("{decomposed}/a/back/{i}.png")]),
    ] {
        let found = views(&app, &names).await;
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(
            (&found[0]["front"], &found[0]["back"]),
            (&json!([names[0], names[2]]), &json!([names[1], names[3]]))
        );
    }
    let shown: Vec<String> = [(composed, "front"), (decomposed, "back")]
        .iter()
        .flat_map(|(k, light)| [1, 2].map(|i| format!("{k}/{light}/{i}.png")))
        .collect();
    let stack = accepted(&app, "", slices(&shown.iter().map(String::as_str).collect::<Vec<_>>())).await;
    assert_eq!((&stack["slices"]["front"], &stack["slices"]["back"]), (&json!(shown[..2]), &json!(shown[2..])));

    let name = |folder: &str, i: usize| format!("{folder}_{i}.png");
    let listed = json!({ "front": [name(decomposed, 2), name(decomposed, 1)] }).to_string().into_bytes();
    let mut members: Vec<(String, Vec<u8>)> = (1..=2).map(|i| (name(composed, i), png(WIDTH, HEIGHT, 3, i))).collect();
    members.push(("manifest.json".into(), listed));
    let stack = accepted(&app, "", zip(&members)).await;
    assert_eq!(stack["slices"]["front"], json!([name(composed, 2), name(composed, 1)]), "by the manifest");
}

#[tokio::test]
async fn angles_may_have_a_decimal_comma() {
    let app = TestApp::start().await;
    let found = views(&app, &["pan022,5_tilt-7,5/1.png", "pan022,5_tilt-7,5/2.png"].map(String::from)).await;
    assert_eq!((&found[0]["pan_deg"], &found[0]["tilt_deg"]), (&json!(22.5), &json!(-7.5)));
}

#[tokio::test]
async fn a_stacked_image_among_the_slices_is_named() {
    let app = TestApp::start().await;
    app.with_profile(4).await;
    let names = ["IMG_0001.png", "IMG_0002.png", "IMG_0003.png", "IMG_0004.png", "ZS PMax.png"];
    let answer = app.post(POST).body(slices(&names)).send().await.unwrap();
    let told = problem(answer, 422, "slice_count_mismatch").await;
    assert!(told["detail"].as_str().unwrap().contains("ZS PMax.png is named unlike all other files"), "{told}");
    assert_eq!(told["errors"][0]["file"], "ZS PMax.png", "{told}");
    // in the place of a slice that is missing
    let stack = accepted(&app, "", slices(&names[1..])).await;
    assert_eq!(stack["warnings"][0]["code"], "copied_file_name", "{stack}");
}
