//! Export and import of profiles as files.

use pinstack_science::archive::npz;
use reqwest::{Response, StatusCode};
use serde_json::{Value, json};

use crate::app::{TestApp, problem, profile};

const URL: &str = "/v1/profiles/rig/lens";

/// A server with a profile in which every member is set, and its exported file.
async fn exported() -> (TestApp, Value) {
    let app = TestApp::start().await;
    let mut body = profile(3);
    body["gains"] = json!([1.0, 1.1, 0.9]);
    body["rail_positions_mm"] = json!([0.0, 0.5, 1.0]);
    body["pixel_pitch_mm"] = json!(0.004);
    body["capture_mode"] = json!("fixed_lens");
    body["principal_distance_mm"] = json!(130.0);
    body["note"] = json!("Tischaufbau, Linse bei 1:1");
    app.put(URL).json(&body).send().await.unwrap();
    let file = app.get(&format!("{URL}/export")).send().await.unwrap().json().await.unwrap();
    (app, file)
}

async fn import(app: &TestApp, file: &Value) -> Response {
    app.post(&format!("{URL}/import")).json(file).send().await.unwrap()
}

#[tokio::test]
async fn an_exported_profile_is_a_file_with_a_name() {
    let (app, file) = exported().await;
    assert_eq!((&file["format"], &file["version"]), (&json!("pinstack-profile"), &json!(1)));
    let answer = app.get(&format!("{URL}/export")).send().await.unwrap();
    assert_eq!(answer.headers()["content-disposition"], "attachment; filename=\"rig_lens_r1.json\"");
    assert_eq!(
        (&answer.headers()["etag"], &answer.headers()["content-type"]),
        (&"\"1\"".parse().unwrap(), &"application/json".parse().unwrap())
    );
    let shown: Value = app.get(URL).send().await.unwrap().json().await.unwrap();
    for (name, value) in shown.as_object().unwrap() {
        assert_eq!(&file[name], value, "{name}");
    }
    let again = app.get(&format!("{URL}/export")).header("if-none-match", "\"1\"").send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    problem(app.get(&format!("{URL}/export?revision=2")).send().await.unwrap(), 404, "profile_not_found").await;
    problem(app.get(&format!("{URL}/export?format=yaml")).send().await.unwrap(), 400, "invalid_request").await;
}

#[tokio::test]
async fn an_imported_profile_keeps_all_data_and_records_its_origin() {
    let (_there, file) = exported().await;
    let here = TestApp::start().await;
    let url = "/v1/profiles/bench/macro";
    let answer = here.post(&format!("{url}/import")).json(&file).send().await.unwrap();
    assert_eq!((answer.status(), &answer.headers()["location"]), (StatusCode::CREATED, &url.parse().unwrap()));
    let mut shown: Value = answer.json().await.unwrap();
    assert_eq!((&shown["rig"], &shown["lens"], &shown["revision"]), (&json!("bench"), &json!("macro"), &json!(1)));
    let origin = json!({ "rig": "rig", "lens": "lens", "revision": 1, "digest": file["digest"], "created_at": file["created_at"], "calibration_id": null });
    assert_eq!(shown["origin"], origin);
    let kept: Value = here.get(url).send().await.unwrap().json().await.unwrap();
    assert_eq!(kept, shown);
    for name in ["rig", "lens", "created_at", "origin"] {
        shown[name] = file[name].clone();
    }
    for (name, value) in shown.as_object().unwrap() {
        assert_eq!(value, &file[name], "{name}");
    }
}

#[tokio::test]
async fn importing_an_identical_profile_stores_nothing() {
    let (app, file) = exported().await;
    let answer = import(&app, &file).await;
    assert_eq!((answer.status(), &answer.headers()["etag"]), (StatusCode::OK, &"\"1\"".parse().unwrap()));
    app.put(URL).json(&profile(2)).send().await.unwrap();
    assert_eq!(import(&app, &file).await.headers()["etag"], "\"3\"", "the current one is another");
    let again = import(&app, &file).await;
    assert_eq!((again.status(), &again.headers()["etag"]), (StatusCode::OK, &"\"3\"".parse().unwrap()));
    // the same homographies with another note are a new revision
    let mut noted = file.clone();
    for name in ["format", "version", "checksum"] {
        noted.as_object_mut().unwrap().remove(name);
    }
    noted["note"] = json!("another");
    app.put(URL).json(&noted).send().await.unwrap();
    assert_eq!(import(&app, &file).await.headers()["etag"], "\"5\"");
}

#[tokio::test]
async fn an_import_honours_its_preconditions() {
    let (app, file) = exported().await;
    let send = |name: &'static str, value: &'static str| {
        app.post(&format!("{URL}/import")).header(name, value).json(&file).send()
    };
    problem(send("if-none-match", "*").await.unwrap(), 412, "precondition_failed").await;
    problem(send("if-match", "\"7\"").await.unwrap(), 412, "precondition_failed").await;
    assert_eq!(send("if-match", "\"1\"").await.unwrap().status(), StatusCode::OK);
}

#[tokio::test]
async fn a_changed_profile_file_is_refused_whatever_was_changed() {
    let (app, file) = exported().await;
    let changed = |pointer: &str, value: Value| {
        let mut file = file.clone();
        *file.pointer_mut(pointer).unwrap() = value;
        file
    };
    let cases = [
        (changed("/homographies/1/2", json!(0.5)), "homographies, gains, size or reference slice"),
        (changed("/gains/2", json!(1.0)), "homographies, gains, size or reference slice"),
        (changed("/note", json!("mine")), "a value other than the homographies and gains"),
        (changed("/rail_positions_mm/2", json!(1.5)), "its camera data"),
        (changed("/slices/1/gain", json!(2.0)), "a value other than the homographies and gains"),
    ];
    for (file, part) in cases {
        let told = problem(import(&app, &file).await, 422, "invalid_profile").await;
        let detail = told["detail"].as_str().unwrap();
        assert!(detail.starts_with("the file was changed after it was exported: "), "{detail}");
        assert!(detail.contains(part), "{detail}");
    }
    let told = problem(import(&app, &changed("/version", json!(2))).await, 422, "invalid_profile").await;
    assert!(told["detail"].as_str().unwrap().contains("of version 2; this server reads version 1"), "{told}");
    let told = problem(import(&app, &profile(3)).await, 422, "invalid_profile").await;
    assert!(
        told["detail"].as_str().unwrap().starts_with("this is not an exported profile: its 'format' is missing"),
        "{told}"
    );
    problem(import(&app, &json!([1])).await, 422, "invalid_profile").await;
    let broken = app.post(&format!("{URL}/import")).header("content-type", "application/json").body("{").send();
    problem(broken.await.unwrap(), 400, "invalid_request").await;
}

#[tokio::test]
async fn whitespace_and_member_order_do_not_change_the_checksum_of_a_profile_file() {
    let (app, file) = exported().await;
    app.delete(URL).send().await.unwrap();
    let mut members: Vec<String> =
        file.as_object().unwrap().iter().map(|(k, v)| format!("{}: {v}", json!(k))).collect();
    members.reverse();
    // some programs write whole numbers without a fraction
    let text = format!("{{{}}}", members.join(",\n")).replace("1.0,", "1,");
    let answer =
        app.put(&format!("{URL}/import")).header("content-type", "application/json").body(text).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::CREATED, "{}", answer.text().await.unwrap());
}

#[tokio::test]
async fn a_profile_survives_a_round_trip_through_numpy() {
    let (app, file) = exported().await;
    let answer = app.get(&format!("{URL}/export?format=npz")).send().await.unwrap();
    assert_eq!(answer.headers()["content-type"], "application/x-npz");
    assert_eq!(answer.headers()["content-disposition"], "attachment; filename=\"rig_lens_r1.npz\"");
    let bytes = answer.bytes().await.unwrap().to_vec();
    let mut arrays = zip::ZipArchive::new(std::io::Cursor::new(&bytes)).unwrap();
    let names: Vec<String> = (0..arrays.len())
        .map(|i| {
            let entry = arrays.by_index(i).unwrap();
            assert_eq!(entry.compression(), zip::CompressionMethod::Stored);
            entry.name().unwrap().into_owned()
        })
        .collect();
    assert_eq!(
        names,
        ["homographies.npy", "gains.npy", "image_size.npy", "reference_index.npy", "rail_positions_mm.npy"]
    );
    let matrices = npz::matrices(bytes.clone(), None).unwrap();
    assert_eq!(json!(matrices), file["homographies"]);
    let put = app
        .put(&format!("{URL}?image_width=24&image_height=18"))
        .header("content-type", "application/x-npz")
        .body(bytes);
    let back: Value = put.send().await.unwrap().json().await.unwrap();
    assert_eq!(back["homographies"], file["homographies"]);
}
