use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::app::{TestApp, problem, profile};

const URL: &str = "/v1/profiles/rig/lens";

#[tokio::test]
async fn the_first_write_makes_a_profile_and_each_later_one_a_revision() {
    let app = TestApp::start().await;
    let first = app.put(URL).json(&profile(3)).send().await.unwrap();
    assert_eq!(first.status(), StatusCode::CREATED);
    assert_eq!(first.headers()["etag"], "\"1\"");
    assert_eq!(first.headers()["location"], URL);
    let shown: Value = first.json().await.unwrap();
    assert_eq!((&shown["revision"], &shown["slice_count"], &shown["source"]), (&json!(1), &json!(3), &json!("upload")));
    assert_eq!(shown["slices"][2]["scale"].as_f64().map(|s| (s * 1000.0).round()), Some(1002.0));

    let second = app.put(URL).json(&profile(4)).send().await.unwrap();
    assert_eq!((second.status(), &second.headers()["etag"]), (StatusCode::OK, &"\"2\"".parse().unwrap()));

    let old: Value = app.get(&format!("{URL}?revision=1")).send().await.unwrap().json().await.unwrap();
    assert_eq!(old["slice_count"], 3);
    let now: Value = app.get(URL).send().await.unwrap().json().await.unwrap();
    assert_eq!(now["slice_count"], 4);
    let revisions: Value = app.get(&format!("{URL}/revisions")).send().await.unwrap().json().await.unwrap();
    let numbers: Vec<&Value> = revisions["items"].as_array().unwrap().iter().map(|p| &p["revision"]).collect();
    assert_eq!(numbers, [2, 1]);
}

#[tokio::test]
async fn a_failed_precondition_changes_nothing() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let write = |tag: &'static str| app.put(URL).header("if-match", tag).json(&profile(3)).send();
    assert_eq!(write("\"1\"").await.unwrap().status(), StatusCode::OK);
    let lost = problem(write("\"1\"").await.unwrap(), 412, "precondition_failed").await;
    assert!(lost["detail"].as_str().unwrap().contains("revision 2"), "{lost}");
    let exists = app.put(URL).header("if-none-match", "*").json(&profile(3)).send().await.unwrap();
    problem(exists, 412, "precondition_failed").await;
    problem(app.delete(URL).header("if-match", "\"1\"").send().await.unwrap(), 412, "precondition_failed").await;
    let now: Value = app.get(URL).send().await.unwrap().json().await.unwrap();
    assert_eq!(now["revision"], 2);
}

#[tokio::test]
async fn a_write_honours_the_tags_in_if_none_match() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let write = |tag: &'static str| app.put(URL).header("if-none-match", tag);
    let excluded = problem(write("\"1\"").json(&profile(3)).send().await.unwrap(), 412, "precondition_failed").await;
    assert!(excluded["detail"].as_str().unwrap().contains("1, which If-None-Match excludes"), "{excluded}");
    let both = write("*").header("if-match", "\"1\"").json(&profile(3)).send().await.unwrap();
    problem(both, 412, "precondition_failed").await;
    assert_eq!(write("\"2\"").json(&profile(3)).send().await.unwrap().headers()["etag"], "\"2\"");
    app.delete(URL).send().await.unwrap();
    assert_eq!(write("\"2\"").json(&profile(3)).send().await.unwrap().status(), StatusCode::CREATED);
}

#[tokio::test]
async fn a_client_with_a_current_copy_of_the_profile_gets_304() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let again = app.get(URL).header("if-none-match", "\"1\"").send().await.unwrap();
    assert_eq!((again.status(), &again.headers()["etag"]), (StatusCode::NOT_MODIFIED, &"\"1\"".parse().unwrap()));
    assert_eq!(app.get(URL).header("if-none-match", "\"7\"").send().await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn the_revision_numbers_of_a_deleted_profile_are_not_reused() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    assert_eq!(app.delete(URL).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(app.get(URL).send().await.unwrap(), 404, "profile_not_found").await;
    problem(app.delete(URL).send().await.unwrap(), 404, "profile_not_found").await;
    problem(app.get(&format!("{URL}/revisions")).send().await.unwrap(), 404, "profile_not_found").await;
    let again = app.put(URL).json(&profile(2)).send().await.unwrap();
    assert_eq!((again.status(), &again.headers()["etag"]), (StatusCode::CREATED, &"\"2\"".parse().unwrap()));
}

#[tokio::test]
async fn every_error_of_an_invalid_profile_is_located() {
    let app = TestApp::start().await;
    let mut wrong = profile(3);
    wrong["homographies"][1] = json!([-1, 0, 23, 0, 1, 0, 0, 0, 1]);
    wrong["homographies"][2] = json!([0, 0, 0, 0, 0, 0, 0, 0, 1]);
    wrong["gains"] = json!([1.0]);
    let told = problem(app.put(URL).json(&wrong).send().await.unwrap(), 422, "invalid_profile").await;
    let pointers: Vec<&str> = told["errors"].as_array().unwrap().iter().filter_map(|e| e["pointer"].as_str()).collect();
    assert_eq!(pointers, ["/homographies/1", "/homographies/2", "/gains"]);

    // as Python writes it
    let text = profile(2).to_string().replacen("1.001", "NaN", 1);
    let nan = app.put(URL).header("content-type", "application/json").body(text).send().await.unwrap();
    problem(nan, 422, "invalid_profile").await;
    let short = json!({ "image_width": 24, "image_height": 18, "reference_index": 0, "homographies": [[1, 2, 3]] });
    let told = problem(app.put(URL).json(&short).send().await.unwrap(), 422, "invalid_profile").await;
    assert!(told["errors"][0]["pointer"].as_str().unwrap().starts_with("/homographies/0"), "{told}");
}

#[tokio::test]
async fn invalid_json_and_invalid_names_are_refused() {
    let app = TestApp::start().await;
    let broken = app.put(URL).header("content-type", "application/json").body("{").send().await.unwrap();
    problem(broken, 400, "invalid_request").await;
    let xml = app.put(URL).header("content-type", "application/xml").body("<x/>").send().await.unwrap();
    problem(xml, 415, "unsupported_media_type").await;
    let hidden = app.put("/v1/profiles/.rig/lens").json(&profile(2)).send().await.unwrap();
    problem(hidden, 400, "invalid_request").await;
    let slash = app.put("/v1/profiles/a%2Fb/lens").json(&profile(2)).send().await.unwrap();
    problem(slash, 400, "invalid_request").await;
}

#[tokio::test]
async fn a_list_is_paged_and_can_be_filtered() {
    let app = TestApp::start().await;
    for lens in ["a", "b", "c"] {
        app.put(&format!("/v1/profiles/rig/{lens}")).json(&profile(2)).send().await.unwrap();
    }
    let mut seen = Vec::new();
    let mut url = "/v1/profiles?limit=2".to_owned();
    loop {
        let page: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
        seen.extend(page["items"].as_array().unwrap().iter().map(|p| p["lens"].as_str().unwrap().to_owned()));
        let Some(cursor) = page["next_cursor"].as_str() else { break };
        url = format!("/v1/profiles?limit=2&cursor={cursor}");
    }
    assert_eq!(seen, ["c", "b", "a"]);
    let narrow: Value = app.get("/v1/profiles?lens=b").send().await.unwrap().json().await.unwrap();
    assert_eq!(narrow["items"].as_array().unwrap().len(), 1);
    for bad in ["limit=0", "limit=x", "cursor=%20nonsense", "lnes=b", "rig=.x"] {
        problem(app.get(&format!("/v1/profiles?{bad}")).send().await.unwrap(), 400, "invalid_request").await;
    }
}

#[tokio::test]
async fn the_optics_have_a_digest_of_their_own_and_each_stack_names_it() {
    let app = TestApp::start().await;
    let first = app.with_stack("").await;
    let mut told = profile(2);
    told["principal_distance_mm"] = json!(121);
    told["pixel_pitch_mm"] = json!(0.006);
    let stored: Value = app.put(URL).json(&told).send().await.unwrap().json().await.unwrap();
    let second = app.post("/v1/stacks?rig=rig&lens=lens").body(crate::app::stack_zip(2, 0)).send().await.unwrap();
    let second: Value = second.json().await.unwrap();
    assert_eq!(first["profile_digest"], second["profile_digest"], "the pixels are the same");
    assert_ne!(first["profile_optics_digest"], second["profile_optics_digest"]);
    assert_eq!(second["profile_optics_digest"], stored["optics_digest"]);
    assert_eq!(stored["optics_digest"].as_str().map(str::len), Some(64));
}

#[tokio::test]
async fn a_homography_that_moves_the_image_too_far_is_refused() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    let mut wild = profile(3);
    wild["homographies"][1] = json!([1e-308, 0, 0, 0, 1e308, 0, 0, 0, 1]);
    wild["homographies"][2] = json!([1, 0, 0, 0, 1, 1e7, 0, 0, 1]);
    wild["rail_positions_mm"] = json!([0, 1, 1e300]);
    let told = problem(app.put(URL).json(&wild).send().await.unwrap(), 422, "invalid_profile").await;
    let slices: Vec<&Value> = told["errors"].as_array().unwrap().iter().map(|e| &e["slice"]).collect();
    assert_eq!(slices, [1, 2, 2], "{told}");
    assert!(told["detail"].as_str().unwrap().contains("slice 1 moves a corner of the image by"), "{told}");
    for path in [URL, "/v1/profiles", &format!("{URL}/revisions"), &format!("{URL}/export")] {
        assert_eq!(app.get(path).send().await.unwrap().status(), StatusCode::OK, "{path}");
    }
}

#[tokio::test]
async fn lists_show_profiles_without_their_data_per_slice() {
    let app = TestApp::start().await;
    let mut told = profile(3);
    told["gains"] = json!([1, 1, 1]);
    told["note"] = json!("of Tuesday");
    app.put(URL).json(&told).send().await.unwrap();
    let whole: Value = app.get(URL).send().await.unwrap().json().await.unwrap();
    for path in ["/v1/profiles", &format!("{URL}/revisions")] {
        let list: Value = app.get(path).send().await.unwrap().json().await.unwrap();
        assert!(list.get("skipped").is_none(), "{list}");
        let item = list["items"][0].as_object().unwrap();
        assert_eq!((&item["slice_count"], &item["note"]), (&json!(3), &json!("of Tuesday")));
        for name in ["homographies", "slices", "gains", "rail_positions_mm"] {
            assert!(!item.contains_key(name) && whole.get(name).is_some(), "{name}");
        }
        for (name, value) in item {
            assert_eq!(value, &whole[name], "{name}");
        }
    }
}

#[tokio::test]
async fn a_mistyped_name_is_refused_with_similar_names() {
    let app = TestApp::start().await;
    for lens in ["mpe65-1x", "mpe65-2x"] {
        app.put(&format!("/v1/profiles/bench/{lens}")).json(&profile(2)).send().await.unwrap();
    }
    let told = problem(app.get("/v1/profiles/Bench/mpe65-1x").send().await.unwrap(), 404, "profile_not_found").await;
    assert!(told["detail"].as_str().unwrap().contains("there is rig 'bench' with lens 'mpe65-1x'"), "{told}");
    let stack = app.post("/v1/stacks?rig=bench&lens=mpe65_1").body(crate::app::stack_zip(2, 0)).send().await.unwrap();
    let told = problem(stack, 404, "profile_not_found").await;
    assert!(told["detail"].as_str().unwrap().contains("'mpe65-1x'"), "{told}");
    let told = app.get("/v1/profiles/bench/MP-E%2065mm%20f%2F2.8").send().await.unwrap();
    let told = problem(told, 400, "invalid_request").await;
    assert!(told["detail"].as_str().unwrap().contains("for example 'MP-E_65mm_f-2.8'"), "{told}");
}

#[tokio::test]
async fn unknown_values_of_a_profile_are_null() {
    let app = TestApp::start().await;
    let shown: Value = app.put(URL).json(&profile(2)).send().await.unwrap().json().await.unwrap();
    for name in [
        "gains",
        "rail_positions_mm",
        "pixel_pitch_mm",
        "capture_mode",
        "note",
        "origin",
        "principal_distance_px",
        "distortion",
        "lateral_colour",
    ] {
        assert_eq!(shown.get(name), Some(&Value::Null), "{name}");
    }
    let again = app.put(URL).json(&shown).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::OK, "what is shown can be sent again");
}

#[tokio::test]
async fn an_etag_that_a_proxy_made_weak_is_refused_with_what_to_send() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    for (tag, advice) in [("W/\"1\"", "send the ETag without W/"), ("\"7\"", "read the profile again and retry")] {
        let write = app.put("/v1/profiles/rig/lens").header("if-match", tag).json(&profile(2));
        let told = problem(write.send().await.unwrap(), 412, "precondition_failed").await;
        assert!(told["detail"].as_str().unwrap().ends_with(advice), "{told}");
    }
}
