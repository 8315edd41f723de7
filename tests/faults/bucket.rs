//! Several processes on one Postgres database and one bucket, without a common folder, as on several machines.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use pinstack_science::{archive, imaging::Raster, imaging::codec};
use reqwest::StatusCode;
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::{sync::Semaphore, task::JoinSet};

use crate::{
    input::{profile, zip},
    matrix::{DEATHS, day, deaths},
    relay::{Mood, Moody, Relay, Target},
    service::{LOOK, Service, command, text},
    site::{AWAY, Site},
    steps,
    story::Story,
};

/// Failpoints of the bucket that a day reaches.
const DAILY: [&str; 6] = ["s3.put", "s3.copy", "s3.remove", "s3.download", "s3.compose", "s3.composed"];
/// Failpoints of a zip that is stored in parts.
const IN_PARTS: [&str; 3] = ["s3.begin", "s3.part", "s3.complete"];
/// Failpoints of the first start.
const FIRST: [&str; 3] = ["rows.store", "s3.create", "rows.bucket"];
/// All failpoints that the matrix on a data folder does not reach.
pub fn steps() -> Vec<&'static str> {
    [&DAILY[..], &IN_PARTS, &FIRST].concat()
}

/// Days that run at a time: most of their time they wait for leases.
const SIDE_BY_SIDE: usize = 6;
/// Calls at which a failpoint of the bucket fires.
const TIMES: usize = 4;
/// Failpoints of rows that are killed in the shorter test: one each of a stack, an upload, a job and a deletion.
const FEW_ROWS: [&str; 4] = ["rows.enqueue", "rows.complete_upload", "rows.finish", "rows.delete"];

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_database_and_its_bucket_belong_together() {
    let (site, stranger) = (Site::fresh().await, Site::fresh().await);
    let settings = site.settings("all", &site.database, &site.endpoint);
    site.api("api", &settings).await.stop().await;
    let says = |name: &str, arguments: &[&str], settings: &Path| {
        let settings = settings.to_str().expect("UTF-8");
        let done = command(&site.data(name), &[arguments, &["--config", settings]].concat());
        (done.status.success(), text(&done))
    };
    let (works, text) = says("operator", &["doctor"], &settings);
    assert!(works && text.contains("storage: s3://") && text.contains("accepts the key"), "{text}");

    let other_bucket = stranger.settings("other-bucket", &site.database, &site.endpoint);
    let (works, text) = says("operator", &["gc"], &other_bucket);
    assert!(!works && text.contains("the files of this database are in s3://"), "{text}");
    let other_database = site.settings("other-database", &stranger.database, &site.endpoint);
    let (works, text) = says("operator", &["gc"], &other_database);
    assert!(!works && text.contains("belongs to another database"), "{text}");
    // which decides nothing for that database
    let right = stranger.settings("right", &stranger.database, &site.endpoint);
    stranger.api("api", &right).await.stop().await;

    let folder = site.folder.path().join("folder.toml");
    std::fs::write(&folder, format!("database_url = {:?}\n", site.database)).expect("a file");
    let (works, text) = says("operator", &["gc"], &folder);
    assert!(!works && text.contains("storage_url is not set, but the files of this database are in s3://"), "{text}");
    let alone = site.folder.path().join("alone.toml");
    std::fs::write(&alone, "storage_url = \"s3://bucket/lab\"\n").expect("a file");
    let (works, text) = says("operator", &["gc"], &alone);
    assert!(!works && text.contains("needs database_url"), "{text}");
    let missing = site.folder.path().join("missing.toml");
    let text = std::fs::read_to_string(&settings).expect("UTF-8").replace(&site.bucket, "there-is-no-such-bucket");
    std::fs::write(&missing, text).expect("a file");
    let (works, text) = says("operator", &["doctor"], &missing);
    assert!(!works && text.contains("check the name of the bucket"), "{text}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_data_folder_moves_into_a_bucket_and_back() {
    let site = Site::fresh().await;
    let folder = TempDir::new().expect("a folder");
    let data = folder.path().join("data");
    std::fs::create_dir(&data).expect("a folder");
    let mut before = Story::on(&data).await;
    before.profile().await.expect("a profile");
    let stack = before.post("a").await.expect("a stack");
    let image = before.image(&stack).await.expect("an image");
    before.end_without_looking().await;

    let settings = site.settings("all", &site.database, &site.endpoint);
    let run = |arguments: &[&str]| {
        let done = command(&site.data("new"), &[arguments, &["--config", settings.to_str().expect("UTF-8")]].concat());
        assert!(done.status.success(), "{}", text(&done));
    };
    run(&["restore", "--from", data.to_str().expect("UTF-8")]);
    let api = site.api("api", &settings).await;
    let downloaded = site.image(&api, &stack).await;
    api.stop().await;
    site.verify(&settings);

    let back = folder.path().join("back");
    run(&["backup", "--to", back.to_str().expect("UTF-8")]);
    run(&["backup", "--to", back.to_str().expect("UTF-8")]);
    let mut after = Story::on(&back).await;
    assert_eq!(after.image(&stack).await.expect("an image"), image);
    assert!(!downloaded.is_empty());
    after.end().await;
}

/// A stack whose zip has more than one part: 12 MB of noise, stored.
fn large() -> (Vec<u8>, Value) {
    let (width, height) = (1024_usize, 700_usize);
    let slice = |seed: u64| {
        let mut state = seed;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        };
        let raster = Raster::eight(width, height, 3, (0..width * height * 3).map(|_| noise()).collect());
        let mut png = Vec::new();
        codec::encode_png(&mut png, &raster, &codec::Metadata::default()).expect("a picture");
        png
    };
    let file = tempfile::NamedTempFile::new().expect("a file");
    let members = (0..6).map(|i| (format!("front/{i}.png"), slice(i)));
    archive::pack(file.reopen().expect("a file"), members).expect("a zip");
    let identity = json!([1, 0, 0, 0, 1, 0, 0, 0, 1]);
    let profile = json!({
        "image_width": width, "image_height": height, "reference_index": 0, "homographies": vec![identity; 6]
    });
    (std::fs::read(file.path()).expect("the zip"), profile)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn machines_without_a_common_folder_share_stacks_and_uploads() {
    let site = Site::fresh().await;
    let settings = site.settings("all", &site.database, &site.endpoint);
    let (one, two) = tokio::join!(site.api("api-1", &settings), site.api("api-2", &settings));
    let worker = site.worker("worker-1", &settings, None);
    site.put_profile(&one, &profile()).await;
    let zip = zip();
    let stack = site.post(&one, "a", &zip).await;
    site.succeeded(&two, &stack).await;
    let image = site.image(&two, &stack).await;
    assert_eq!(image, site.image(&one, &stack).await);

    // a resumable upload that begins at one process and is continued and completed at the other
    let metadata = "rig cmln,lens bGVucw==";
    let create = site.client.post(format!("{}/v1/uploads", one.url)).header("tus-resumable", "1.0.0");
    let create = create.header("upload-length", zip.len()).header("upload-metadata", metadata).send().await;
    let upload = create.expect("an answer").headers()["location"].to_str().expect("a path").to_owned();
    let piece = async |api: &Service, from: usize, to: usize| {
        let patch = site.client.patch(format!("{}{upload}", api.url)).header("tus-resumable", "1.0.0");
        let patch = patch.header("upload-offset", from).header("content-type", "application/offset+octet-stream");
        patch.body(zip[from..to].to_vec()).send().await.expect("an answer")
    };
    let (third, half) = (zip.len() / 3, zip.len() / 2);
    for (api, from, to) in [(&one, 0, third), (&two, third, half)] {
        let answer = piece(api, from, to).await;
        assert_eq!(
            (answer.status(), answer.headers()["upload-offset"].to_str().expect("a number")),
            (StatusCode::NO_CONTENT, to.to_string().as_str())
        );
    }
    let wrong = piece(&one, third, half).await;
    assert_eq!(wrong.status(), StatusCode::CONFLICT, "the offset is known to both");
    let last = piece(&one, half, zip.len()).await;
    let in_pieces = last.headers()["pinstack-job"].to_str().expect("a path").to_owned();
    site.succeeded(&two, &in_pieces).await;
    assert_eq!(image, site.image(&one, &in_pieces).await, "the same zip gives the same bytes");

    // the second process makes a new stack from a zip that the first one received
    let again = site.client.post(format!("{}{stack}/rerun", two.url)).send().await.expect("an answer");
    let again = again.headers()["location"].to_str().expect("a path").to_owned();
    site.succeeded(&one, &again).await;
    let deleted = site.client.delete(format!("{}{stack}", one.url)).send().await.expect("an answer");
    assert_eq!(deleted.status(), StatusCode::NO_CONTENT);
    assert_eq!(image, site.image(&two, &again).await, "its zip and results are its own");

    for process in [one, two, worker] {
        process.stop().await;
    }
    site.verify(&settings);
}

/// Kills a service at these failpoints, each with the calls at which its stories begin.
async fn killed(steps: impl Iterator<Item = (String, Vec<usize>)>) {
    let turns = Arc::new(Semaphore::new(SIDE_BY_SIDE));
    let mut days = JoinSet::new();
    for (name, calls) in steps {
        let turns = Arc::clone(&turns);
        days.spawn(async move {
            let (mut broke, is_first) = (0, calls.contains(&0));
            for from in calls {
                let _turn = turns.acquire().await.expect("open");
                let site = Site::fresh().await;
                let settings = site.settings("all", &site.database, &site.endpoint);
                let faults = deaths(&name, from);
                let day = async { day(Story::begin_with(&faults, Some(settings)).await).await };
                let breaks = tokio::time::timeout(Duration::from_secs(300), day).await;
                broke += breaks.unwrap_or_else(|_| panic!("{faults:?}: it hangs")).len();
            }
            (name, broke, is_first)
        });
    }
    let mut failed = Vec::new();
    while let Some(day) = days.join_next().await {
        match day {
            // what the rows do on their own is the matter of the matrix on a data folder
            Ok((name, broke, is_first)) if broke > 0 || !is_first || name.starts_with("rows.") => {
                println!("{name}: killed {broke} times");
            }
            Ok((name, ..)) => failed.push(format!("{name} is never reached")),
            Err(error) => failed.push(error.to_string()),
        }
    }
    assert!(failed.is_empty(), "{} of the failpoints: {failed:#?}", failed.len());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn nothing_acknowledged_is_lost_wherever_a_service_with_a_bucket_is_killed() {
    killed([&FEW_ROWS[..], &DAILY, &FIRST].concat().into_iter().map(|name| (name.to_owned(), vec![0]))).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "more cases of a test"]
async fn more_deaths_of_a_service_with_a_bucket_lose_nothing_acknowledged() {
    let elsewhere = crate::elsewhere::steps();
    let is_other = |name: &String| !elsewhere.contains(&name.as_str()) && !FEW_ROWS.contains(&name.as_str());
    let of_rows = steps::names().into_iter().filter(|name| name.starts_with("rows.")).filter(is_other);
    let later = DAILY.iter().map(|name| ((*name).to_owned(), (0..TIMES).step_by(DEATHS).skip(1).collect()));
    killed(of_rows.map(|name| (name, vec![0])).chain(later)).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_zip_in_parts_is_stored_whole_or_not_at_all_wherever_the_service_is_killed() {
    let (zip, profile) = large();
    for step in IN_PARTS {
        let site = Site::fresh().await;
        let settings = site.settings("all", &site.database, &site.endpoint);
        let flags = ["--workers", "0", "--config", settings.to_str().expect("UTF-8")];
        let fault = format!("{step}=1*return(kill)->off");
        let mut victim = Service::start(&site.data("api-1"), Some(&fault), &flags).await.expect("it listens");
        site.put_profile(&victim, &profile).await;
        let url = format!("{}/v1/stacks?rig=rig&lens=lens", victim.url);
        let lost = site.client.post(url).header("Idempotency-Key", "a").body(zip.clone()).send().await;
        assert!(lost.is_err() && !victim.ended().await.success(), "{step}: it was killed before it answered");
        let api = site.api("api-2", &settings).await;
        assert_eq!(site.shown(&api, "/v1/stacks").await["items"], json!([]), "{step}");
        let stack = site.post(&api, "a", &zip).await;
        let stored = site.client.get(format!("{}{stack}/upload", api.url)).send().await.expect("an answer");
        assert!(stored.bytes().await.expect("the zip") == zip, "{step}: the zip is stored completely");
        let worker = site.worker("worker", &settings, None);
        site.succeeded(&api, &stack).await;
        api.stop().await;
        worker.stop().await;
        site.verify(&settings);
    }
}

/// While the bucket is in this mood, nothing is accepted and nothing is lost; after it, all goes on.
async fn survives(mood: Mood) {
    let site = Site::fresh().await;
    let bucket = Moody::before(&site.endpoint).await;
    let settings = site.settings("all", &site.database, &bucket.url);
    let api = site.api("api", &settings).await;
    site.put_profile(&api, &profile()).await;
    let zip = zip();
    let waiting = site.post(&api, "before", &zip).await;

    bucket.becomes(mood);
    let (status, text) = site.try_post(&api, "meanwhile", &zip).await.expect_err("it cannot be stored");
    assert!(AWAY.contains(&status) && text.contains("\"code\":\"unavailable\""), "{status} {text}");
    let listed = site.shown(&api, "/v1/stacks").await;
    assert_eq!(
        listed["items"].as_array().map(Vec::len),
        Some(1),
        "what could not be stored was not accepted: {listed}"
    );
    // a worker that cannot read, or not write
    let worker = site.worker("worker", &settings, None);
    let hurt = bucket.hurt();
    while bucket.hurt() == hurt {
        tokio::time::sleep(LOOK).await;
    }
    bucket.becomes(Mood::Good);

    let ended = site.succeeded(&api, &waiting).await;
    assert_eq!(ended["attempt"], 1, "the bucket is no fault of the job: {ended}");
    let meanwhile = site.post(&api, "meanwhile", &zip).await;
    site.succeeded(&api, &meanwhile).await;
    assert_eq!(site.image(&api, &waiting).await, site.image(&api, &meanwhile).await);
    api.stop().await;
    worker.stop().await;
    site.verify(&site.settings("good", &site.database, &site.endpoint));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_bucket_that_fails_for_a_while_loses_nothing() {
    survives(Mood::Failing).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_bucket_that_lies_about_what_it_stores_loses_nothing() {
    survives(Mood::Lying).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "needs postgresql, moto, curl"]
async fn a_worker_that_is_cut_off_in_mid_job_publishes_nothing() {
    let site = Site::fresh().await;
    let settings = site.settings("all", &site.database, &site.endpoint);
    let api = site.api("api", &settings).await;
    site.put_profile(&api, &profile()).await;
    // the network of one worker, to the database (on a socket of this machine) and to the bucket
    let (path, rest) = site.database.split_once("host=").expect("a socket").1.split_once('&').expect("options");
    let database = Relay::to(Target::Unix(PathBuf::from(path).join(".s.PGSQL.5432"))).await;
    let bucket = Relay::to(Target::Tcp(site.endpoint.trim_start_matches("http://").to_owned())).await;
    let remote = format!("postgres://postgres@{}/postgres?{rest}", database.address);
    let lonely = site.settings("lonely", &remote, &format!("http://{}", bucket.address));
    let mut sleeper = site.worker("sleeper", &lonely, Some("artifact.make=1*sleep(4000)->off"));

    let stack = site.post(&api, "a", &zip()).await;
    site.until(&api, &stack, &["running"]).await;
    database.cut();
    bucket.cut();
    let other = site.worker("other", &settings, None);
    let ended = site.succeeded(&api, &stack).await;
    assert_eq!(ended["attempt"], 2, "the other worker took the job over: {ended}");
    let image = site.image(&api, &stack).await;
    database.mend();
    bucket.mend();
    sleeper.signal(rustix::process::Signal::TERM);
    sleeper.ended().await;
    assert_eq!(site.shown(&api, &stack).await, ended, "the worker that was cut off published nothing");
    assert_eq!(site.image(&api, &stack).await, image);
    api.stop().await;
    other.stop().await;
    site.verify(&settings);
}
