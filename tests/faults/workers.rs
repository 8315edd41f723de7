//! Two processes on one store, one of which is stopped during a job.

use std::{path::Path, time::Duration};

use rustix::process::Signal;
use sqlx::{ConnectOptions, sqlite::SqliteConnectOptions};
use tempfile::TempDir;

use crate::{
    input::{profile, zip},
    service::{LOOK, Service, command, verified},
};

async fn json(url: &str) -> serde_json::Value {
    let client = reqwest::Client::builder().no_proxy().build().expect("a client");
    client.get(url).send().await.expect("an answer").json().await.expect("JSON")
}

async fn prepared(url: &str) -> String {
    let client = reqwest::Client::builder().no_proxy().build().expect("a client");
    client.put(format!("{url}/v1/profiles/rig/lens")).json(&profile()).send().await.expect("a profile");
    let posted = client.post(format!("{url}/v1/stacks?rig=rig&lens=lens")).body(zip()).send().await.expect("a stack");
    posted.headers()["location"].to_str().expect("a path").to_owned()
}

/// A worker that is stopped at the failpoint `step`, and the path of its stack.
async fn stopped_once(step: &str, time: usize) -> (TempDir, Service, String) {
    let folder = TempDir::new().expect("a folder");
    let data = folder.path().join("data");
    let asleep = format!("{step}={}*off->1*return(stop)->off", time - 1);
    let sleeper = Service::start(&data, Some(&asleep), &[]).await.expect("it listens");
    let stack = prepared(&sleeper.url).await;
    while !sleeper.is_stopped() {
        tokio::time::sleep(LOOK).await;
    }
    (folder, sleeper, stack)
}

async fn holds_the_lock(data: &Path) -> bool {
    let options = SqliteConnectOptions::new().filename(data.join("pinstack.sqlite")).busy_timeout(Duration::ZERO);
    let mut connection = options.connect().await.expect("the database");
    sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await.is_err()
}

/// Stops a worker at the failpoint `step`, lets another process end its job, and continues the worker: it must publish
/// nothing.
async fn stopped_at(step: &str, time: usize) {
    // a process that is stopped within a transaction holds the lock of the database, and all others wait for it: such a
    // run tests nothing
    let (folder, mut sleeper, stack) = loop {
        let found = stopped_once(step, time).await;
        if !holds_the_lock(&found.0.path().join("data")).await {
            break found;
        }
    };
    let data = folder.path().join("data");
    let other = Service::start(&data, None, &[]).await.expect("a second process on the same store");
    let ended = loop {
        let stack = json(&format!("{}{stack}", other.url)).await;
        if stack["state"] != "running" && stack["state"] != "queued" {
            break stack;
        }
        tokio::time::sleep(LOOK).await;
    };
    assert_eq!((ended["state"].as_str(), ended["attempt"].as_u64()), (Some("succeeded"), Some(2)), "{ended}");

    sleeper.signal(Signal::CONT);
    sleeper.signal(Signal::TERM);
    assert!(sleeper.ended().await.success(), "it continues, observes that it lost the lease, and ends normally");
    let after = json(&format!("{}{stack}", other.url)).await;
    assert_eq!(after, ended, "the stopped worker published nothing");
    other.stop().await;
    verified(|arguments| command(&data, arguments));
}

#[tokio::test]
async fn a_worker_that_was_stopped_during_a_job_publishes_nothing_when_it_continues() {
    stopped_at("artifact.make", 1).await;
}

#[tokio::test]
async fn a_worker_that_was_stopped_during_publication_publishes_nothing_when_it_continues() {
    // the first call is that of the upload
    stopped_at("publish.rename", 2).await;
}

#[tokio::test]
async fn a_worker_that_was_stopped_before_the_end_of_its_job_publishes_nothing_when_it_continues() {
    // it ends the job in one transaction: stopped within it, it would stop all others
    stopped_at("worker.end", 1).await;
}
