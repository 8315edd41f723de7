//! Profiles from matrices of other programs and from rig parameters.

use pinstack_science::{
    archive::{npy, npz},
    synth::Rig,
    types::{
        Homography,
        profile::{CaptureMode, ProfileInput},
    },
};
use reqwest::{RequestBuilder, StatusCode};
use serde_json::{Value, json};

use crate::app::{TestApp, problem, zip};

const URL: &str = "/v1/profiles/rig/lens";
const SIZED: &str = "/v1/profiles/rig/lens?image_width=640&image_height=480";

/// A homography that scales about the centre of 640 x 480 px.
fn zoom(scale: f64) -> Homography {
    Homography::similarity(scale, [319.5 * (1.0 - scale), 239.5 * (1.0 - scale)])
}

fn stack() -> Vec<Homography> {
    vec![zoom(1.02), zoom(1.01), Homography::IDENTITY, zoom(0.99)]
}

fn npy_of(slices: &[Homography]) -> Vec<u8> {
    npy::of_floats(&[slices.len(), 3, 3], slices.iter().flat_map(|h| h.0))
}

async fn stored(request: RequestBuilder) -> Value {
    let answer = request.send().await.unwrap();
    let status = answer.status();
    let text = answer.text().await.unwrap();
    assert!(status.is_success(), "{status}: {text}");
    serde_json::from_str(&text).unwrap()
}

async fn refused(request: RequestBuilder, status: u16, code: &str) -> String {
    problem(request.send().await.unwrap(), status, code).await["detail"].as_str().unwrap().to_owned()
}

/// The largest distance between corners mapped by the stored and by the expected homographies, px.
fn off(profile: &Value, wanted: &[Homography]) -> f64 {
    let input: ProfileInput = serde_json::from_value(profile.clone()).unwrap();
    assert_eq!(input.homographies.len(), wanted.len());
    input.homographies.iter().zip(wanted).map(|(a, b)| a.corner_distance(b, 640, 480)).fold(0.0, f64::max)
}

#[tokio::test]
async fn the_reference_of_an_npy_is_the_slice_with_the_identity() {
    let app = TestApp::start().await;
    let url = format!("{SIZED}&pixel_pitch_mm=0.004&capture_mode=fixed_lens&rail_step_mm=-0.5&note=of%20Tuesday");
    for kind in ["application/x-npy", "application/octet-stream"] {
        let profile = stored(app.put(&url).header("content-type", kind).body(npy_of(&stack()))).await;
        assert_eq!(profile["reference_index"], 2);
        assert_eq!(off(&profile, &stack()), 0.0);
        assert_eq!(profile["rail_positions_mm"], json!([0.0, -0.5, -1.0, -1.5]));
        assert_eq!((&profile["note"], &profile["capture_mode"]), (&json!("of Tuesday"), &json!("fixed_lens")));
        assert_eq!((&profile["source"], &profile["model"]), (&json!("upload"), &json!("given")));
        assert_eq!(profile["warnings"], json!([]), "{profile}");
    }
}

#[tokio::test]
async fn the_matrices_are_found_in_an_npz() {
    let app = TestApp::start().await;
    let other = npy::of_floats(&[4], [1.0; 4]);
    let named = zip(&[("homographies.npy".into(), npy_of(&stack())), ("b.npy".into(), npy_of(&stack()))]);
    let only = zip(&[("gains.npy".into(), other.clone()), ("arr_0.npy".into(), npy_of(&stack()))]);
    for (kind, body) in
        [("application/x-npz", named), ("application/zip", only.clone()), ("application/octet-stream", only)]
    {
        let profile = stored(app.put(SIZED).header("content-type", kind).body(body)).await;
        assert_eq!(off(&profile, &stack()), 0.0);
    }
    let two = zip(&[("a.npy".into(), npy_of(&stack())), ("b.npy".into(), npy_of(&[zoom(1.1), zoom(1.0)]))]);
    let send = |url: String| app.put(&url).header("content-type", "application/x-npz").body(two.clone());
    let told = refused(send(SIZED.into()), 422, "invalid_profile").await;
    assert!(told.contains("a, b; name one with ?array="), "{told}");
    assert_eq!(stored(send(format!("{SIZED}&array=b"))).await["slice_count"], 2);
    let told = refused(send(format!("{SIZED}&array=c")), 422, "invalid_profile").await;
    assert_eq!(told, "the file has no array 'c'; it holds a, b");
}

#[tokio::test]
async fn matrices_of_another_direction_or_reference_are_normalised_with_a_warning() {
    let app = TestApp::start().await;
    let inverse: Vec<Homography> = stack().iter().map(|h| h.inverse().unwrap()).collect();
    let send = |url: &str, slices: &[Homography]| {
        app.put(url).header("content-type", "application/x-npy").body(npy_of(slices))
    };
    let profile = stored(send(&format!("{SIZED}&direction=reference_to_slice"), &inverse)).await;
    assert!(off(&profile, &stack()) < 1e-9, "{profile}");

    // all slices are mapped to a slice that is not in the list
    let moved: Vec<Homography> = stack().iter().map(|h| h.then(&zoom(1.05)).unwrap()).collect();
    let profile = stored(send(SIZED, &moved)).await;
    assert!(off(&profile, &stack()) < 1e-9, "{profile}");
    assert_eq!((&profile["reference_index"], &profile["warnings"][0]["code"]), (&json!(2), &json!("rebased")));
    let kept: Value = app.get(URL).send().await.unwrap().json().await.unwrap();
    assert_eq!(kept["warnings"], profile["warnings"], "who reads it later is told too");

    let profile = stored(send(&format!("{SIZED}&reference_index=0"), &stack())).await;
    let on_first: Vec<Homography> = stack().iter().map(|h| h.then(&zoom(1.0 / 1.02)).unwrap()).collect();
    assert!(off(&profile, &on_first) < 1e-9 && profile["reference_index"] == 0, "{profile}");
}

#[tokio::test]
async fn matrices_in_json_may_be_nested_or_a_bare_list() {
    let app = TestApp::start().await;
    let rows: Vec<Value> = stack().iter().map(|h| json!([h.0[..3], h.0[3..6], h.0[6..]])).collect();
    let object = json!({ "image_width": 640, "image_height": 480, "reference_index": 2, "homographies": rows });
    let profile = stored(app.put(URL).json(&object)).await;
    assert_eq!(off(&profile, &stack()), 0.0);
    assert_eq!(
        profile["homographies"][2],
        json!([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        "nine numbers are shown"
    );
    assert_eq!(off(&stored(app.put(SIZED).json(&rows)).await, &stack()), 0.0);
    let told = refused(app.put(&format!("{URL}?image_width=640")).json(&object), 400, "invalid_request").await;
    assert!(told.contains("'image_width' is for bodies that are matrices"), "{told}");
}

#[tokio::test]
async fn slices_with_zero_matrices_are_listed() {
    let app = TestApp::start().await;
    let mut slices = stack();
    slices[1] = Homography([0.0; 9]);
    slices[3] = Homography([0.0; 9]);
    let answer = app.put(SIZED).header("content-type", "application/x-npy").body(npy_of(&slices)).send().await.unwrap();
    let told = problem(answer, 422, "invalid_profile").await;
    assert!(
        told["detail"].as_str().unwrap().starts_with("slices 1 and 3 have nothing but zeros for a matrix"),
        "{told}"
    );
    let places: Vec<u64> = told["errors"].as_array().unwrap().iter().filter_map(|e| e["slice"].as_u64()).collect();
    assert_eq!(places, [1, 3]);
}

#[tokio::test]
async fn hostile_numpy_files_are_refused_with_a_reason() {
    let app = TestApp::start().await;
    let replaced = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len(), "the header must keep its length");
        let bytes = npy_of(&stack());
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("it is there");
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let huge = replaced("(4, 3, 3), }         ", "(4000000000, 3, 3), }");
    let objects = replaced("'<f8'", "'|O' ");
    let short = npy_of(&stack())[..200].to_vec();
    let cases = [
        (huge, "a stack has at most 1000 slices"),
        (objects, "holds Python objects (dtype '|O')"),
        (short, "was it cut off?"),
        (npz::packed([("homographies", npy_of(&stack()))]).unwrap()[..300].to_vec(), "the zip ends early"),
        (b"\x89PNG".to_vec(), "neither an array (.npy) nor arrays in a zip (.npz)"),
    ];
    for (body, sentence) in cases {
        let request = app.put(SIZED).header("content-type", "application/x-npy").body(body);
        let told = refused(request, 422, "invalid_profile").await;
        assert!(told.contains(sentence), "{told}");
    }
    let request = app.put(SIZED).header("content-type", "application/x-npy").body(vec![0; (4 << 20) + 1]);
    refused(request, 413, "upload_too_large").await;
}

#[tokio::test]
async fn parameters_for_matrices_are_required_and_checked() {
    let app = TestApp::start().await;
    let cases = [
        (URL.to_owned(), "image_width is missing: matrices do not contain the size of the slices"),
        (format!("{SIZED}&widht=3"), "unknown parameter 'widht'"),
        (
            format!("{SIZED}&direction=back"),
            "direction is 'back'; it must be one of: slice_to_reference, reference_to_slice",
        ),
        (format!("{SIZED}&rail_step_mm=0"), "rail_step_mm is 0"),
        (format!("{SIZED}&rail_step_mm=NaN"), "rail_step_mm is NaN"),
        (format!("{SIZED}&rail_step_mm=1&rail_positions_mm=1,2,3,4"), "both given"),
        (format!("{SIZED}&rail_positions_mm=1,2,x,4"), "must be numbers separated by commas"),
    ];
    for (url, sentence) in cases {
        let request = app.put(&url).header("content-type", "application/x-npy").body(npy_of(&stack()));
        let told = refused(request, 400, "invalid_request").await;
        assert!(told.contains(sentence), "{url}: {told}");
    }
    let few = format!("{SIZED}&rail_positions_mm=1,2");
    let request = app.put(&few).header("content-type", "application/x-npy").body(npy_of(&stack()));
    assert_eq!(refused(request, 422, "invalid_profile").await, "2 rail positions for 4 slices: give one per slice");
    let text = app.put(SIZED).header("content-type", "text/csv").body("1,0,0");
    assert!(refused(text, 415, "unsupported_media_type").await.contains("application/x-npy"));
}

fn rig_parameters(rig: &Rig) -> Value {
    // the renderer counts sensor positions away from the lens
    let sign = if rig.mode == CaptureMode::FixedLens { -1.0 } else { 1.0 };
    let rail: Vec<f64> = rig.rail_mm.iter().map(|z| sign * z).collect();
    json!({
        "image_width": rig.width, "image_height": rig.height, "reference_index": rig.reference,
        "focal_mm": rig.focal_mm, "magnification": rig.magnification, "pixel_pitch_mm": rig.pixel_pitch_mm,
        "rail_positions_mm": rail, "capture_mode": rig.mode,
    })
}

#[tokio::test]
async fn rig_parameters_yield_the_homographies_of_the_optics() {
    let app = TestApp::start().await;
    for rig in [Rig::default().ideal(), Rig::default().ideal().moving_lens()] {
        let truth: Vec<Homography> = (0..rig.slices()).map(|i| rig.homography(i)).collect();
        let profile = stored(app.post(&format!("{URL}/rig-parameters")).json(&rig_parameters(&rig))).await;
        assert!(off(&profile, &truth) < 1e-6, "{:?}: {profile}", rig.mode);
        assert_eq!((&profile["source"], &profile["model"]), (&json!("upload"), &json!("rig_parameters")));
        let slices = profile["slices"].as_array().unwrap();
        let gains: Vec<f64> = slices.iter().map(|slice| slice["gain"].as_f64().unwrap()).collect();
        assert!((0..rig.slices()).all(|i| (gains[i] - rig.gain(i)).abs() < 1e-9), "{:?}: {gains:?}", rig.mode);
    }
}

#[tokio::test]
async fn a_profile_from_rig_parameters_contains_its_pinhole() {
    let app = TestApp::start().await;
    let body = json!({
        "image_width": 640, "image_height": 480, "slice_count": 5, "rail_step_mm": 0.5, "focal_mm": 65, "magnification": 1,
        "pixel_pitch_mm": 0.01, "capture_mode": "fixed_lens", "drift_px_per_mm": [1, 0], "gains": "none", "note": "bench 2"
    });
    let answer = app.post(&format!("{URL}/rig-parameters")).json(&body).send().await.unwrap();
    assert_eq!((answer.status(), &answer.headers()["etag"]), (StatusCode::CREATED, &"\"1\"".parse().unwrap()));
    assert_eq!(answer.headers()["location"], URL);
    let profile: Value = answer.json().await.unwrap();
    assert_eq!(profile["principal_distance_mm"], 130.0);
    assert_eq!(profile["principal_distance_px"], 13_000.0);
    assert_eq!(profile["principal_point_px"], json!([319.5, 239.5]));
    assert_eq!((&profile["magnification"], &profile["reference_index"]), (&json!(1.0), &json!(2)));
    assert_eq!(profile["rail_positions_mm"], json!([0.0, 0.5, 1.0, 1.5, 2.0]));
    assert_eq!((&profile["gains"], &profile["note"]), (&Value::Null, &json!("bench 2")));
}

#[tokio::test]
async fn impossible_rig_parameters_are_refused_with_their_location() {
    let app = TestApp::start().await;
    let sound = rig_parameters(&Rig::default());
    let changed = |name: &str, value: Value| {
        let mut body = sound.clone();
        body[name] = value;
        app.post(&format!("{URL}/rig-parameters")).json(&body)
    };
    let cases = [
        ("magnification", json!(0), "magnification is 0; it must be 0.0001 to 1000"),
        ("rail_step_mm", json!(1), "rail_positions_mm and rail_step_mm are both given"),
        (
            "rail_positions_mm",
            json!([0, 1, 2]),
            "reference_index is 4, but the stack has 3 slices: use an index from 0 to 2",
        ),
        ("rail_positions_mm", json!([0, 1, 1, 2, 3]), "slice 1 is at 1 mm and slice 2 at 1 mm, against the direction"),
        ("rail_positions_mm", json!([80, 60, 40, 20, 0]), "check the sign of the rail"),
        ("slice_count", json!(3), "9 rail positions for 3 slices"),
        ("drift_px_per_mm", json!([5000, 0]), "drift_px_per_mm"),
        ("capture_mode", json!("zoom"), "/capture_mode is 'zoom'; it must be one of: fixed_lens, moving_lens"),
        ("magnificaton", json!(1), "unknown member 'magnificaton'; known members: image_width"),
    ];
    for (name, value, sentence) in cases {
        let told = refused(changed(name, value), 422, "invalid_profile").await;
        assert!(told.contains(sentence), "{name}: {told}");
    }
    app.with_profile(2).await;
    refused(changed("note", json!("")).header("if-none-match", "*"), 412, "precondition_failed").await;
}

#[tokio::test]
async fn the_pinhole_of_a_client_is_stored_and_checked() {
    let app = TestApp::start().await;
    let mut body = json!({ "image_width": 640, "image_height": 480, "reference_index": 2, "homographies": stack(),
        "principal_distance_mm": 121.0, "principal_point_px": [320.5, 239.0], "magnification": 0.86, "pixel_pitch_mm": 0.00625,
        "distortion": { "centre_px": [320.0, 240.0], "k1": 0.02, "k2": 0.0, "radius_px": 400.0 },
        "lateral_colour": { "red": { "scale": 0.002, "shift_px": [0.1, -0.2] }, "blue": { "scale": -0.001, "shift_px": [0.0, 0.0] } } });
    stored(app.put(URL).json(&body)).await;
    let shown: Value = app.get(URL).send().await.unwrap().json().await.unwrap();
    for name in [
        "principal_distance_mm",
        "principal_point_px",
        "magnification",
        "pixel_pitch_mm",
        "distortion",
        "lateral_colour",
    ] {
        assert_eq!(shown[name], body[name], "{name}");
    }
    assert_eq!(shown["principal_distance_px"], 19_360.0);
    // a profile can be sent back as it was shown
    assert_eq!(stored(app.put(URL).json(&shown)).await["digest"], shown["digest"]);
    let folded = json!({ "centre_px": [320.0, 240.0], "k1": -0.9, "radius_px": 400.0 });
    for (name, wrong) in [
        ("principal_distance_mm", json!(0)),
        ("principal_point_px", json!([1e9, 0])),
        ("magnification", json!(-1)),
        ("distortion", folded),
        ("lateral_colour", json!({ "red": { "scale": 0.5 }, "blue": { "scale": 0 } })),
    ] {
        let right = body[name].clone();
        body[name] = wrong;
        assert!(refused(app.put(URL).json(&body), 422, "invalid_profile").await.contains(name));
        body[name] = right;
    }
    for name in ["distortion", "lateral_colour"] {
        let right = body[name].clone();
        body[name] = Value::Null;
        assert_ne!(stored(app.put(URL).json(&body)).await["digest"], shown["digest"], "{name} moves pixels");
        body[name] = right;
    }
}
