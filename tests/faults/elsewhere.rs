//! Failpoints that the story of the matrix does not reach: of commands, garbage collection, calibrations and
//! reconstructions.

use std::path::Path;

use pinstack_science::{
    archive,
    imaging::{Raster, codec},
    synth::{DotTarget, Light, Rig, Scene, Stage, target_stack},
};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::{
    service::{armed_command, clean_up, command, text},
    story::Story,
};

/// Failpoints of `pinstack token`.
const TOKENS: [&str; 2] = ["rows.add_token", "rows.revoke_token"];
/// Failpoints of garbage collection.
const CLEANING: [&str; 2] = ["rows.expire_job_uploads", "results.prune"];
/// Failpoint of a calibration.
const CALIBRATION: &str = "copy.write";
/// Failpoint of reconstructions without a request.
const AUTO: &str = "rows.scan_examined";

/// All of these failpoints.
pub fn steps() -> Vec<&'static str> {
    let of_bucket = crate::bucket::steps();
    [&TOKENS[..], &CLEANING, &[CALIBRATION, AUTO], &crate::copies::STEPS, &crate::moving::STEPS, &of_bucket].concat()
}

fn listed(data: &Path) -> String {
    text(&command(data, &["token", "list"]))
}

#[test]
fn a_token_exists_completely_or_not_at_all_wherever_its_creation_is_killed() {
    for (time, is_there) in [(0, false), (1, true)] {
        let folder = TempDir::new().expect("a folder");
        let data = folder.path().join("data");
        let at = |step: &str| format!("{step}={time}*off->1*return(kill)->off");
        let add = ["token", "add", "ann", "--scope", "read"];
        assert!(!armed_command(&data, &add, &at(TOKENS[0])).status.success());
        assert_eq!(listed(&data).contains("ann\tread"), is_there, "killed before or after it was stored");
        if !is_there {
            assert!(command(&data, &add).status.success());
        }
        let revoke = ["token", "revoke", "ann"];
        assert!(!armed_command(&data, &revoke, &at(TOKENS[1])).status.success());
        assert_eq!(listed(&data).contains("revoked"), is_there);
    }
}

#[tokio::test]
async fn expired_zips_are_removed_and_results_kept_wherever_garbage_collection_is_killed() {
    for time in [0, 1] {
        let mut story = Story::begin("").await;
        story.profile().await.expect("a profile");
        let stack = story.post("a").await.expect("a stack");
        let image = story.image(&stack).await.expect("an image");
        let data = story.data();
        let broken = clean_up(&data, Some(&format!("{}={time}*off->1*return(kill)->off", CLEANING[0])));
        assert!(!broken.status.success(), "{}", text(&broken));
        let done = clean_up(&data, None);
        assert!(done.status.success(), "{}", text(&done));
        let uploads = std::fs::read_dir(data.join("blobs/uploads")).expect("a folder").count();
        assert_eq!(uploads, 0, "the row says that the zip is removed, and it is");
        let shown = story.ended(&stack).await.expect("a stack");
        assert_eq!(shown["upload"]["removed"], true, "{shown}");
        assert_eq!(story.image(&stack).await.expect("an image"), image);
        let copy = data.with_extension("copy");
        let copied = command(&data, &["backup", "--to", copy.to_str().expect("UTF-8")]);
        assert!(copied.status.success(), "{}", text(&copied));
        story.end().await;
    }
}

#[tokio::test]
async fn unpublished_results_are_removed_although_garbage_collection_was_killed() {
    // the worker dies after it stored its results and before it ended the job; then the job is cancelled
    let mut story = Story::begin("rows.finish=1*return(kill)->off").await;
    story.profile().await.expect("a profile");
    let stack = story.post("a").await.expect("a stack");
    while story.ended(&stack).await.is_ok() {}
    story.cancel(&stack).await.expect("an answer");
    let ended = story.ended(&stack).await.expect("a stack");
    assert_eq!(ended["state"], "cancelled", "{ended}");
    let results = story.data().join("blobs/results");
    let left = || std::fs::read_dir(&results).expect("a folder").count();
    assert_eq!(left(), 1);
    let broken = armed_command(&story.data(), &["gc"], &format!("{}=return(kill)", CLEANING[1]));
    assert!(!broken.status.success(), "{}", text(&broken));
    assert!(command(&story.data(), &["gc"]).status.success());
    assert_eq!(left(), 0);
    story.end().await;
}

fn target() -> Vec<u8> {
    let rig = Rig::sized(240, 180, 5);
    packed(&target_stack(&rig, &DotTarget::for_rig(&rig, 12)))
}

fn packed(slices: &[Raster]) -> Vec<u8> {
    let members = slices.iter().enumerate().map(|(i, s)| (format!("{i}.jpg"), codec::encode_jpeg(s, 95)));
    let file = tempfile::NamedTempFile::new().expect("a file");
    archive::pack(file.reopen().expect("a file"), members).expect("a zip");
    std::fs::read(file.path()).expect("the zip")
}

#[tokio::test]
async fn a_calibration_makes_one_revision_wherever_it_is_killed_or_the_disk_becomes_full() {
    for (step, times) in [(CALIBRATION, 0..1), ("rows.finish", 0..2), ("artifact.make", 2..3)] {
        for time in times {
            for fault in ["kill", "full"] {
                let armed = format!("{step}={time}*off->1*return({fault})->off");
                let mut story = Story::begin(&armed).await;
                let job = story.calibrate("", target()).await.expect("accepted before anything breaks");
                let ended = loop {
                    if let Ok(ended) = story.ended(&job).await {
                        break ended;
                    }
                };
                assert_eq!(ended["state"], "succeeded", "{armed}: {ended}");
                let revisions: Value = story.revisions().await.expect("a list");
                assert_eq!(revisions.as_array().map(Vec::len), Some(1), "{armed}: {revisions}");
                assert_eq!(revisions[0]["calibration_id"], ended["id"], "{armed}");
                story.end().await;
            }
        }
    }
}

#[tokio::test]
async fn a_calibration_by_a_stored_stack_makes_one_revision_wherever_it_is_killed() {
    let rig = Rig { softness_px: 0.5, ..Rig::sized(420, 280, 5) };
    let stage = Stage::new(&rig, &Scene::weave(1));
    let slices: Vec<Raster> = (0..rig.slices()).map(|i| stage.render(Light::Front, i)).collect();
    let homographies = vec![json!([1, 0, 0, 0, 1, 0, 0, 0, 1]); slices.len()];
    let profile =
        json!({ "image_width": 420, "image_height": 280, "reference_index": 0, "homographies": homographies });
    // the first end of a job is that of the stack
    for (step, times) in [(CALIBRATION, 0..2), ("rows.finish", 1..3)] {
        for time in times {
            let armed = format!("{step}={time}*off->1*return(kill)->off");
            let mut story = Story::begin(&armed).await;
            story.sends(packed(&slices));
            story.put_profile(&profile).await.expect("a profile");
            let stack = story.post("a").await.expect("a stack");
            while story.ended(&stack).await.is_err() {}
            let id = stack.rsplit('/').next().expect("an id");
            let named = json!({ "stacks": [id] }).to_string().into_bytes();
            let job = story.calibrate("?source=stacks", named).await.expect("accepted before anything breaks");
            let ended = loop {
                if let Ok(ended) = story.ended(&job).await {
                    break ended;
                }
            };
            assert_eq!(ended["state"], "succeeded", "{armed}: {ended}");
            assert!(!story.broke.is_empty(), "{armed}: nothing was killed");
            let revisions: Value = story.revisions().await.expect("a list");
            assert_eq!(revisions.as_array().map(Vec::len), Some(2), "{armed}: {revisions}");
            story.image(&stack).await.expect("the stack keeps its image");
            story.upload(&stack).await.expect("the stack keeps its zip");
            story.end().await;
        }
    }
}
