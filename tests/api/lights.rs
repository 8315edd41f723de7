//! Further lights of a stack, from the zip to the pictures.

use std::sync::Arc;

use pinstack::{
    jobs::ScienceRunner,
    worker::{Config, Deps, Pool},
};
use pinstack_science::{
    imaging::{Raster, Samples, codec},
    synth::{Light, Rig, Scene, Stage},
};
use reqwest::StatusCode;
use serde_json::{Value, json};

use crate::app::{HEIGHT, TestApp, WIDTH, png, problem, stack_zip, zip};

type Members = Vec<(String, Vec<u8>)>;

fn encoded(raster: &Raster) -> Vec<u8> {
    let mut out = Vec::new();
    codec::encode_png(&mut out, raster, &codec::Metadata::default()).expect("a PNG");
    out
}

/// The same slice under a lamp of half the brightness.
fn dimmed(slice: &Raster) -> Raster {
    let Samples::Eight(samples) = &slice.samples else { panic!("8 bits") };
    Raster { samples: Samples::Eight(samples.iter().map(|sample| sample / 2).collect()), ..slice.clone() }
}

/// A rendered stack with the further lights `uv` and `left`, and its profile.
fn rendered() -> (Members, Value) {
    let rig = Rig::sized(160, 120, 5);
    let stage = Stage::new(&rig, &Scene::insect(3));
    let mut members = Members::new();
    for slice in 0..rig.slices() {
        let front = stage.render(Light::Front, slice);
        members.push((format!("bee/front/{slice}.png"), encoded(&front)));
        members.push((format!("bee/back/{slice}.png"), encoded(&stage.render(Light::Back, slice))));
        members.push((format!("bee/uv/{slice}.png"), encoded(&dimmed(&front))));
        members.push((format!("bee/left/{slice}.png"), encoded(&front)));
    }
    let homographies: Vec<_> = (0..rig.slices()).map(|slice| rig.homography(slice)).collect();
    let gains: Vec<f64> = (0..rig.slices()).map(|slice| rig.gain(slice)).collect();
    let profile = json!({
        "image_width": 160, "image_height": 120, "reference_index": rig.reference, "homographies": homographies,
        "gains": gains
    });
    (members, profile)
}

fn pixels(bytes: &[u8]) -> image::RgbaImage {
    image::load_from_memory(bytes).expect("a picture").to_rgba8()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_pictures_of_further_lights_lie_on_the_image_pixel_by_pixel() {
    let app = TestApp::start().await;
    let (store, disk) = (app.store.clone(), Arc::clone(&app.app.disk));
    let _pool = Pool::start(Deps { store, disk, runner: Arc::new(ScienceRunner::default()) }, Config::default());
    let (members, profile) = rendered();
    let answer = app.put("/v1/profiles/rig/lens").json(&profile).send().await.unwrap();
    assert!(answer.status().is_success(), "{}", answer.text().await.unwrap());
    let sent = app.post("/v1/stacks?rig=rig&lens=lens&label=bee").header("prefer", "wait=50").body(zip(&members));
    let stack: Value = sent.send().await.unwrap().json().await.unwrap();
    assert_eq!(stack["state"], "succeeded", "{stack}");
    let url = stack["links"]["self"].as_str().unwrap();
    assert_eq!(
        stack["links"]["lights"],
        json!({ "left": format!("{url}/lights/left"), "uv": format!("{url}/lights/uv") })
    );
    let names: Vec<&str> =
        stack["slices"]["lights"].as_array().unwrap().iter().filter_map(|of| of["name"].as_str()).collect();
    assert_eq!(names, ["left", "uv"]);
    assert_eq!(stack["slices"]["lights"][1]["slices"][4], "bee/uv/4.png");
    let measured = &stack["metrics"]["lights"];
    assert_eq!((&measured[0]["name"], &measured[1]["name"]), (&json!("left"), &json!("uv")));
    assert!(measured[1]["alignment"]["residual_p95_px"].as_f64().is_some_and(|px| px < 0.5), "{measured}");

    let image = app.get(&format!("{url}/image")).send().await.unwrap();
    let image = pixels(&image.bytes().await.unwrap());
    let answer = app.get(&format!("{url}/lights/uv")).send().await.unwrap();
    assert_eq!((answer.status(), &answer.headers()["content-type"]), (StatusCode::OK, &"image/png".parse().unwrap()));
    assert_eq!(answer.headers()["content-disposition"], "inline; filename=\"bee_lights_uv.png\"");
    let tag = answer.headers()["etag"].clone();
    let light = pixels(&answer.bytes().await.unwrap());
    assert_eq!(light.dimensions(), image.dimensions());
    let mut differences = Vec::new();
    for (light, image) in light.pixels().zip(image.pixels()) {
        assert_eq!(light[3], image[3], "the alpha is that of the image");
        if image[3] == 255 {
            differences.extend((0..3).map(|c| (2 * i32::from(light[c]) - i32::from(image[c])).abs()));
        }
    }
    let mean = f64::from(differences.iter().sum::<i32>()) / differences.len() as f64;
    assert!(mean < 3.0, "twice the light of half the brightness differs from the image by {mean:.2} grey levels");

    // formats and conditions are those of the image
    let again = app.get(&format!("{url}/lights/uv")).header("if-none-match", &tag).send().await.unwrap();
    assert_eq!(again.status(), StatusCode::NOT_MODIFIED);
    let tiff = app.get(&format!("{url}/lights/uv")).header("accept", "image/tiff").send().await.unwrap();
    assert_eq!(tiff.headers()["content-type"], "image/tiff");
    assert_eq!(pixels(&tiff.bytes().await.unwrap()), light);
    let part = app.get(&format!("{url}/lights/uv")).header("range", "bytes=1-3").send().await.unwrap();
    assert_eq!((part.status(), &part.bytes().await.unwrap()[..]), (StatusCode::PARTIAL_CONTENT, &b"PNG"[..]));

    // the page shows them, and its tiles
    let id = stack["id"].as_str().unwrap();
    let page =
        app.get(&format!("/stacks/{id}")).header("accept", "text/html").send().await.unwrap().text().await.unwrap();
    assert!(page.contains("Light uv") && page.contains("Light left") && page.contains("/lights/uv"), "{page}");
    let tile = app.get(&format!("/stacks/{id}/tiles/light-uv/0/0/0")).send().await.unwrap();
    assert_eq!((tile.status(), &tile.headers()["content-type"]), (StatusCode::OK, &"image/png".parse().unwrap()));

    for (name, said) in [("uv2", "the further lights of the stack are left, uv"), ("..%2Fimage", "left, uv"), ("", "")]
    {
        let answer = app.get(&format!("{url}/lights/{name}")).send().await.unwrap();
        let code = if name.is_empty() { "not_found" } else { "no_result" };
        let told = problem(answer, 404, code).await;
        assert!(told["detail"].as_str().is_some_and(|detail| detail.contains(said)), "{told}");
    }
    // deleted with the stack
    assert_eq!(app.delete(url).send().await.unwrap().status(), StatusCode::NO_CONTENT);
    problem(app.get(&format!("{url}/lights/uv")).send().await.unwrap(), 404, "not_found").await;
}

fn with_folder(folder: &str, slices: usize) -> Vec<u8> {
    let light = |folder: &str, slices: usize| {
        (0..slices).map(|i| (format!("{folder}/img_{i}.png"), png(WIDTH, HEIGHT, 3, i))).collect::<Vec<_>>()
    };
    zip(&[light("front", 2), light(folder, slices)].concat())
}

#[tokio::test]
async fn folders_that_are_no_further_light_of_the_stack_are_refused() {
    let app = TestApp::start().await;
    app.with_profile(2).await;
    for (folder, slices, code, said) in [
        ("uv", 1, "slice_count_mismatch", "light uv has 1 slice and the front light 2"),
        ("uv", 3, "slice_count_mismatch", "add or remove slices in the folder uv, or remove the folder"),
        ("pan020_tilt06", 2, "invalid_archive", "named like a view of a scan"),
        ("ultra violet", 2, "invalid_archive", "rename the folder"),
        ("thumbs", 2, "invalid_archive", "remove it from the zip"),
    ] {
        let answer = app.post("/v1/stacks?rig=rig&lens=lens").body(with_folder(folder, slices)).send().await.unwrap();
        let told = problem(answer, 422, code).await;
        assert!(told["detail"].as_str().is_some_and(|detail| detail.contains(said)), "{told}");
    }
    let target = app.post("/v1/profiles/rig/lens/calibrations").body(with_folder("uv", 2)).send().await.unwrap();
    let told = problem(target, 422, "invalid_archive").await;
    assert!(told["detail"].as_str().is_some_and(|detail| detail.contains("folder uv beside front/")), "{told}");

    let stack = app.post("/v1/stacks?rig=rig&lens=lens").body(stack_zip(2, 0)).send().await.unwrap();
    let stack: Value = stack.json().await.unwrap();
    assert!(stack["slices"].get("lights").is_none() && stack["links"].get("lights").is_none(), "{stack}");
    let light = format!("/v1/stacks/{}/lights/uv", stack["id"].as_str().unwrap());
    problem(app.get(&light).send().await.unwrap(), 409, "not_finished").await;
    let job = app.claim().await;
    app.finish(&job).await;
    let told = problem(app.get(&light).send().await.unwrap(), 404, "no_result").await;
    assert!(told["detail"].as_str().is_some_and(|detail| detail.contains("no further lights; put")), "{told}");
}
