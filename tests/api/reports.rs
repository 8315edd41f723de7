use pinstack::{
    contract::{
        Fault,
        outcome::{Artifact, CalibrationOutcome, JobOutcome},
        profile::ProfileSource,
    },
    store::{Finish, Job, ProfileDraft, blobs::result_key},
};
use pinstack_science::types::{
    Homography, Warning, WarningCode,
    profile::{HomographyModel, ProfileInput, ProfileSlice},
    report::{CalibrationReport, CameraReport, CaptureReport, DotReport, Grade, SliceReport, TargetReport},
};
use reqwest::StatusCode;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::app::{HEIGHT, TestApp, WIDTH, id, png, problem, profile, stack_zip, zip};

const POST: &str = "/v1/profiles/rig/lens/calibrations";
const HOSTILE: &str = "<script>alert(1)</script>.png";

fn report(shift: f64) -> CalibrationReport {
    let slice = |index: u32| SliceReport {
        index,
        name: if index == 0 { HOSTILE.into() } else { format!("img_{index}.png") },
        scale: 1.0,
        law_scale: None,
        shift_px: [if index == 0 { shift } else { 0.0 }, 0.0],
        law_shift_px: None,
        off_law_px: None,
        blur_radius_px: None,
        contrast: None,
        gain: 1.0,
        gain_sigma: None,
        law_gain: None,
        clipped: None,
        dots_found: 2,
        inliers: 2,
        rms_px: Some(0.05),
        corner_sigma_px: 0.1,
        interpolated: false,
        dots: vec![
            DotReport { at: [4.0, 5.0], residual: Some([0.05, 0.0]), inlier: true },
            DotReport { at: [14.0, 5.0], residual: Some([0.0, -0.05]), inlier: true },
        ],
    };
    CalibrationReport {
        width: WIDTH,
        height: HEIGHT,
        reference_index: 1,
        verdict: "Good: the image corners are good to 0.10 px".into(),
        grade: Grade::Good,
        findings: vec![Warning::new(WarningCode::ClippedWhite, format!("the white is clipped in {HOSTILE}"))],
        target: Some(TargetReport {
            pitch_px: 5.0,
            pitch_mm: None,
            fill: 0.5,
            bright_dots: false,
            asymmetric: false,
            dots: 2,
            coverage: 0.5,
            magnification: None,
            coded: false,
            code: None,
        }),
        model: HomographyModel::Homography,
        model_reason: "it was the only one".into(),
        candidates: Vec::new(),
        capture: CaptureReport { told: None, found: None, confidence: None, detail: "left open".into() },
        rail: None,
        camera: CameraReport::default(),
        slices: vec![slice(0), slice(1)],
    }
}

/// Publishes the report, if there is one, like a worker.
async fn kept(app: &TestApp, job: &Job, report: &CalibrationReport) -> Artifact {
    let bytes = serde_json::to_vec(report).unwrap();
    let key = result_key(job.id, job.lease_token, "report.json");
    app.put_blob(&key, &bytes).await;
    let sha256 = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    Artifact {
        name: "report".into(),
        key,
        media_type: "application/json".into(),
        bytes: bytes.len() as u64,
        sha256,
        crc32: None,
    }
}

/// The URL of a finished calibration that the option `keep` excluded.
async fn not_kept(app: &TestApp) -> String {
    let answer = app.post(&format!("{POST}?keep=good")).body(stack_zip(2, 0)).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::ACCEPTED);
    let url = answer.headers()["location"].to_str().unwrap().to_owned();
    let job = app.claim().await;
    let outcome = JobOutcome::Calibration(CalibrationOutcome {
        artifacts: vec![kept(app, &job, &report(0.0)).await],
        profile_revision: None,
        profile_digest: None,
        profile_optics_digest: None,
        reference_index: 1,
        slices: Vec::new(),
        dot_pitch_px: None,
        magnification: None,
        verdict: "usable".into(),
        grade: Some(Grade::Usable),
    });
    let finish = Finish::Succeeded { outcome: Box::new(outcome), warnings: Vec::new(), profile: None };
    assert!(app.store.metadata.finish(job.id, job.lease_token, &finish).await.unwrap());
    url
}

#[tokio::test]
async fn a_calibration_that_is_not_kept_has_a_report_and_no_revision() {
    let app = TestApp::start().await;
    let url = not_kept(&app).await;
    let shown: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert_eq!(shown["options"]["keep"], "good");
    assert_eq!((&shown["result"]["profile_revision"], &shown["result"]["grade"]), (&Value::Null, &json!("usable")));
    assert!(shown["links"].get("profile").is_none(), "{}", shown["links"]);
    let page = app.get(&format!("{url}/report")).send().await.unwrap().text().await.unwrap();
    assert!(page.contains("Not kept as a profile revision"));
    problem(app.get("/v1/profiles/rig/lens?revision=2").send().await.unwrap(), 404, "profile_not_found").await;
    let answer = app.post(&format!("{POST}?keep=best")).body(stack_zip(2, 0)).send().await.unwrap();
    problem(answer, 400, "invalid_request").await;
}

#[tokio::test]
async fn a_calibration_takes_a_stack_or_a_whole_scan_instead_of_a_target() {
    let app = TestApp::start().await;
    let slices =
        |folder: &'static str| (0..3).map(move |i| (format!("{folder}/img_{i}.png"), png(WIDTH, HEIGHT, 3, i)));
    let scan: Vec<_> = slices("pan000_tilt10").chain(slices("pan020_tilt10")).collect();
    let with_light: Vec<_> = slices("front").chain(slices("uv")).collect();
    for body in [stack_zip(3, 3), zip(&scan), zip(&with_light)] {
        let answer = app.post(&format!("{POST}?source=stacks")).body(body).send().await.unwrap();
        assert_eq!(answer.status(), 202);
        let url = answer.headers()["location"].to_str().unwrap().to_owned();
        let shown: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
        assert_eq!(shown["options"]["source"], "stacks", "{shown}");
    }
    let answer = app.post(&format!("{POST}?source=pictures")).body(stack_zip(3, 0)).send().await.unwrap();
    problem(answer, 400, "invalid_request").await;
}

/// The URL of a finished calibration whose profile has a shifted first slice.
async fn calibrated(app: &TestApp, shift: f64) -> String {
    let answer = app.post(&format!("{POST}?note=after%20%3Cb%3Ecleaning")).body(stack_zip(2, 0)).send().await.unwrap();
    let url = answer.headers()["location"].to_str().unwrap().to_owned();
    let job = app.claim().await;
    let homographies = vec![Homography::similarity(1.0, [shift, 0.0]), Homography::IDENTITY];
    let slices: Vec<ProfileSlice> =
        (0..).zip(&homographies).map(|(i, h)| ProfileSlice::given(i, *h, 1.0, WIDTH, HEIGHT)).collect();
    let input = ProfileInput {
        image_width: WIDTH,
        image_height: HEIGHT,
        reference_index: 1,
        homographies,
        ..ProfileInput::default()
    };
    let draft = ProfileDraft {
        input,
        source: ProfileSource::Calibration,
        calibration_id: Some(job.id),
        model: HomographyModel::Homography,
        slices: slices.clone(),
        origin: None,
        warnings: Vec::new(),
    };
    let outcome = JobOutcome::Calibration(CalibrationOutcome {
        artifacts: vec![kept(app, &job, &report(shift)).await],
        profile_revision: None,
        profile_digest: None,
        profile_optics_digest: None,
        reference_index: 1,
        slices,
        dot_pitch_px: Some(5.0),
        magnification: None,
        verdict: "good".into(),
        grade: None,
    });
    let finish = Finish::Succeeded { outcome: Box::new(outcome), warnings: Vec::new(), profile: Some(Box::new(draft)) };
    assert!(app.store.metadata.finish(job.id, job.lease_token, &finish).await.unwrap());
    url
}

#[tokio::test]
async fn the_content_policy_of_the_report_page_allows_only_its_own_style() {
    let app = TestApp::start().await;
    let url = calibrated(&app, 0.0).await;
    let shown: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert_eq!(shown["links"]["report"], format!("{url}/report"));
    assert_eq!(shown["artifacts"], json!([]), "the source file of the page is internal");

    let browser = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8";
    let answer = app.get(&format!("{url}/report")).header("accept", browser).send().await.unwrap();
    assert_eq!(answer.status(), StatusCode::OK);
    let headers = answer.headers().clone();
    assert_eq!(headers["content-type"], "text/html; charset=utf-8");
    assert_eq!(
        (&headers["vary"], &headers["x-content-type-options"]),
        (&"accept".parse().unwrap(), &"nosniff".parse().unwrap())
    );
    let policy = headers["content-security-policy"].to_str().unwrap();
    assert!(policy.starts_with("default-src 'none'; style-src 'sha256-"), "{policy}");
    assert!(!policy.contains("unsafe") && policy.contains("frame-ancestors 'none'"), "{policy}");

    let page = answer.text().await.unwrap();
    assert!(page.contains("The image corners are good to 0.10 px") && page.contains("Profile revision 1"));
    assert!(page.contains("href=\"overlay?slice=1\""), "links lie beside the page");
    assert!(page.contains("There are no two revisions"));
    assert!(!page.contains("<script") && !page.contains("<b>"), "names and notes stay text");
    assert!(page.contains("&lt;script&gt;alert(1)&lt;/script&gt;.png") && page.contains("after &lt;b&gt;cleaning"));
    // other responses keep the policy for data
    let data = app.get(&url).send().await.unwrap();
    assert_eq!(data.headers()["content-security-policy"], "default-src 'none'; frame-ancestors 'none'");
}

#[tokio::test]
async fn the_report_is_available_as_json() {
    let app = TestApp::start().await;
    let url = format!("{}/report", calibrated(&app, 0.0).await);
    let by_header = app.get(&url).header("accept", "application/json").send().await.unwrap();
    assert_eq!(by_header.headers()["content-type"], "application/json");
    let by_header: Value = by_header.json().await.unwrap();
    assert_eq!((&by_header["grade"], &by_header["drift"]), (&json!("good"), &Value::Null));
    assert_eq!(by_header["slices"][0]["name"], HOSTILE);
    let told: CalibrationReport = serde_json::from_value(by_header.clone()).unwrap();
    assert_eq!(told, report(0.0), "nothing is lost on the way");
    let by_query: Value = app.get(&format!("{url}?format=json")).send().await.unwrap().json().await.unwrap();
    assert_eq!(by_query, by_header);
    let page = app.get(&format!("{url}?format=html")).header("accept", "application/json").send().await.unwrap();
    assert_eq!(page.headers()["content-type"], "text/html; charset=utf-8");
    problem(app.get(&format!("{url}?format=pdf")).send().await.unwrap(), 400, "invalid_request").await;
    problem(app.get(&url).header("accept", "image/png").send().await.unwrap(), 406, "not_acceptable").await;
}

#[tokio::test]
async fn the_report_of_a_second_calibration_contains_the_drift() {
    let app = TestApp::start().await;
    let first = calibrated(&app, 0.0).await;
    let second = calibrated(&app, 1.8).await;
    let drift = |url: &str| app.get(&format!("{url}/report?format=json")).send();
    let moved: Value = drift(&second).await.unwrap().json().await.unwrap();
    assert_eq!((&moved["drift"]["from_revision"], &moved["drift"]["worst_slice"]), (&json!(1), &json!(0)));
    let sentence = "slice 0 moved most: 1.8 px at a corner since revision 1; stacks taken since then may be affected";
    assert_eq!(moved["drift"]["detail"], sentence);
    assert!(app.get(&format!("{second}/report")).send().await.unwrap().text().await.unwrap().contains(&sentence[1..]));
    // a later revision does not change the report
    let before: Value = drift(&first).await.unwrap().json().await.unwrap();
    assert_eq!(before["drift"], Value::Null);
    // nor does deleting the profile
    assert!(app.delete("/v1/profiles/rig/lens").send().await.unwrap().status().is_success());
    let alone: Value = drift(&second).await.unwrap().json().await.unwrap();
    assert_eq!((&alone["drift"], &alone["grade"]), (&Value::Null, &json!("good")));
}

#[tokio::test]
async fn there_is_no_report_of_an_unfinished_or_failed_calibration() {
    let app = TestApp::start().await;
    let calibration: Value = app.post(POST).body(stack_zip(2, 0)).send().await.unwrap().json().await.unwrap();
    let url = format!("/v1/calibrations/{}/report", id(&calibration));
    problem(app.get(&url).send().await.unwrap(), 409, "not_finished").await;
    let job = app.claim().await;
    problem(app.get(&url).send().await.unwrap(), 409, "not_finished").await;
    app.fail(&job, Fault::new(pinstack::contract::Code::TargetNotFound, "there are no dots")).await;
    let told = problem(app.get(&url).send().await.unwrap(), 404, "no_result").await;
    assert!(told["detail"].as_str().unwrap().contains("there are no dots"), "{told}");
    let stack = app.with_stack("").await;
    problem(app.get(&format!("/v1/calibrations/{}/report", id(&stack))).send().await.unwrap(), 404, "not_found").await;
}

#[tokio::test]
async fn a_calibration_without_a_stored_report_says_how_to_get_one() {
    let app = TestApp::start().await;
    let calibration: Value = app.post(POST).body(stack_zip(2, 0)).send().await.unwrap().json().await.unwrap();
    app.finish(&app.claim().await).await;
    let url = format!("/v1/calibrations/{}", id(&calibration));
    let shown: Value = app.get(&url).send().await.unwrap().json().await.unwrap();
    assert!(shown["links"].get("report").is_none(), "{shown}");
    let told = problem(app.get(&format!("{url}/report")).send().await.unwrap(), 404, "no_result").await;
    assert!(told["detail"].as_str().unwrap().contains("send the target stack again"), "{told}");
}

#[tokio::test]
async fn drift_compares_any_two_revisions_and_by_default_the_last_two() {
    let app = TestApp::start().await;
    let url = "/v1/profiles/rig/lens/drift";
    problem(app.get(url).send().await.unwrap(), 404, "profile_not_found").await;
    app.with_profile(2).await;
    let told = problem(app.get(url).send().await.unwrap(), 404, "profile_not_found").await;
    assert!(told["detail"].as_str().unwrap().contains("no revision before 1"), "{told}");
    let mut moved = profile(2);
    moved["homographies"][1][2] = json!(0.6);
    for body in [&moved, &moved, &profile(3)] {
        assert!(app.put("/v1/profiles/rig/lens").json(body).send().await.unwrap().status().is_success());
    }
    let drift =
        async |query: &str| -> Value { app.get(&format!("{url}{query}")).send().await.unwrap().json().await.unwrap() };
    let counts = drift("").await;
    assert_eq!((&counts["from_revision"], &counts["to_revision"]), (&json!(3), &json!(4)));
    assert_eq!((&counts["worst_px"], &counts["corner_px"]), (&Value::Null, &json!([null, null, null])));
    assert!(counts["detail"].as_str().unwrap().contains("2 and 3 slices"), "{counts}");
    let still = drift("?to=3").await;
    assert_eq!(
        (&still["from_revision"], &still["worst_px"], &still["gain_ratio"]),
        (&json!(2), &json!(0.0), &json!([1.0, 1.0]))
    );
    let far = drift("?from=1&to=3").await;
    assert_eq!((&far["worst_slice"], far["worst_px"].as_f64().map(|w| (w * 10.0).round())), (&json!(1), Some(6.0)));
    assert!(far["detail"].as_str().unwrap().contains("moved slightly since revision 1: slice 1 most"), "{far}");
    assert_eq!(drift("?from=3&to=1").await, far, "the older one is compared against");
    for unknown in ["?from=9", "?to=9", "?from=0"] {
        problem(app.get(&format!("{url}{unknown}")).send().await.unwrap(), 404, "profile_not_found").await;
    }
    problem(app.get(&format!("{url}?from=one")).send().await.unwrap(), 400, "invalid_request").await;
    problem(app.get(&format!("{url}?since=1")).send().await.unwrap(), 400, "invalid_request").await;
}

#[tokio::test]
async fn a_calibration_of_another_size_is_refused_unless_allow_new_size_is_set() {
    let app = TestApp::start().await;
    let mut larger = profile(2);
    larger["image_width"] = json!(WIDTH + 20);
    app.put("/v1/profiles/rig/lens").json(&larger).send().await.unwrap().error_for_status().unwrap();
    let told = problem(app.post(POST).body(stack_zip(2, 0)).send().await.unwrap(), 422, "size_mismatch").await;
    let detail = told["detail"].as_str().unwrap();
    assert!(detail.contains(&format!("was measured at {} x {HEIGHT} px", WIDTH + 20)), "{detail}");
    assert!(detail.contains("allow_new_size"), "{detail}");
    let meant = app.post(&format!("{POST}?allow_new_size=true")).body(stack_zip(2, 0)).send().await.unwrap();
    assert_eq!(meant.status(), StatusCode::ACCEPTED);
}
