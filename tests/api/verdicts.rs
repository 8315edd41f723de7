//! Verdicts of calibrations from rendered targets, by a worker of a process of its own.

use pinstack_science::{
    imaging::codec,
    synth::{Alone, DotTarget, Rig, render_target},
};
use serde_json::Value;

use crate::{app::zip, process::Process};

/// The report of the calibration from the slices `order` of the rig.
async fn report(process: &Process, lens: &str, rig: &Rig, order: &[usize]) -> Value {
    let mut target = DotTarget::for_rig(rig, 16);
    [target.columns, target.rows] = [11, 7];
    let picture = |(k, &i): (usize, &usize)| {
        let mut out = Vec::new();
        codec::encode_png(&mut out, &render_target(rig, &target, i), &codec::Metadata::default()).expect("a PNG");
        (format!("t_{k}.png"), out)
    };
    let files: Vec<_> = order.iter().enumerate().map(picture).collect();
    let client = reqwest::Client::builder().no_proxy().build().expect("a client");
    let url = format!("{}/v1/profiles/rig/{lens}/calibrations", process.base);
    let post = client.post(url).header("prefer", "wait=60").body(zip(&files));
    let job: Value = post.send().await.unwrap().json().await.unwrap();
    assert_eq!(job["state"], "succeeded", "{job}");
    let url = format!("{}/v1/calibrations/{}/report?format=json", process.base, job["id"].as_str().unwrap());
    client.get(url).send().await.unwrap().json().await.unwrap()
}

fn finding<'a>(report: &'a Value, code: &str) -> &'a str {
    let findings = report["findings"].as_array().expect("findings");
    let found = findings.iter().find(|finding| finding["code"] == code);
    found.unwrap_or_else(|| panic!("no {code}: {report}"))["detail"].as_str().expect("a sentence")
}

#[tokio::test]
async fn a_calibration_with_a_loose_slice_or_a_rail_that_stands_still_is_not_good() {
    let process = Process::start(&[]).await;
    let plain = Rig { channels: 1, keystone: [0.0; 2], ..Rig::sized(480, 360, 7) };
    let all: Vec<usize> = (0..7).collect();
    let good = report(&process, "plain", &plain, &all).await;
    assert_eq!(good["grade"], "good", "{good}");
    let tilted = Rig { alone: Some(Alone { slice: 5, keystone: [4e-3, 0.0], ..Alone::default() }), ..plain.clone() };
    let loose = report(&process, "loose", &tilted, &all).await;
    assert_eq!(loose["grade"], "usable", "{loose}");
    assert!(finding(&loose, "slice_displaced").starts_with("t_5.png is tilted"), "{loose}");
    let still = report(&process, "still", &plain, &[3; 7]).await;
    assert_eq!(still["grade"], "usable", "{still}");
    assert!(finding(&still, "rail_still").contains("did not move"), "{still}");
}
